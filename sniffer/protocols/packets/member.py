"""A declaration as the core sees it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.codes import ON_ITS_OWN, REQUEST
from sniffer.ground.model import DeclarationError, SnifferError
from sniffer.protocols.base import RESTARTS, joined, no_clues
from sniffer.protocols.packets.columns import FamilyColumns
from sniffer.protocols.packets.declare import LISTED
from sniffer.protocols.packets.parts import Readings
from sniffer.protocols.packets.slow import Slow
from sniffer.protocols.packets.words import Words
from sniffer.protocols.reports import unheard_of

if TYPE_CHECKING:
    from sniffer.ground.model import I16, I64, Frames, Mask
    from sniffer.ground.registers import RegisterMap
    from sniffer.protocols.base import SlowFrame
    from sniffer.protocols.packets.declare import PacketFamily


RESTART_NAMES: Final = frozenset({"restart", "reboot"})
"""What manuals call the command by which a servo begins anew."""


class Member(Words):
    """See ``sniffer.protocols.base.BusProtocol``.

    Args:
        family: what the protocol declares; it is walked once, here.

    Raises:
        DeclarationError: the declaration holds something that columns have no form for, or says
            what a fault means that nothing reports.
    """

    interface = 1
    auto = True  # a header and a checksum tell its packets from noise
    blank = b""
    ordered = False

    def __init__(self, family: PacketFamily) -> None:
        columns, slow = FamilyColumns(family), Slow(family)
        super().__init__(columns)
        self.name, self.title = family.name, family.title
        self.bauds, self.baud = family.bauds, family.baud
        self.longest, self.reach = columns.longest, columns.reach
        self._states_address = columns.told is not None and columns.told.states_address
        self.tail_ns, self.everyone = family.tail_ns, family.everyone
        self.models, self.registers = family.models, joined(family.models)
        self.frame, self.describe = columns.frame, columns.describe
        readings = Readings(columns)
        self.values, self.targets = readings.values, readings.targets
        self.slow_parse, self.slow_describe = slow.parse, slow.describe
        self.slow_parts, self.slow_values = slow.parts, slow.values
        self.slow_clues = no_clues
        named = ((op, command.name) for op, command in family.commands.items())
        if unknown := unheard_of(self):
            raise DeclarationError(f"{self.name}: {unknown}")
        self.ends_goal = {op: RESTARTS for op, name in named if name in RESTART_NAMES}

    def with_models(self, tables: tuple[RegisterMap, ...]) -> Member:
        """Return the protocol with further models behind its own.

        Raises:
            SnifferError: one of them has its id or return mode where the others have it not.
        """
        try:
            return Member(replace(self.family, models=(*self.models, *tables)))
        except TypeError as error:
            raise SnifferError(str(error)) from None

    def refused(self, status: I16) -> Mask:
        """Tell which error bytes say that the command was not carried out."""
        return np.asarray((status & self.family.refusals) != 0)

    def window_ns(self, frames: Frames) -> I64:
        """Return the reply window, alike for every command."""
        return np.full(len(frames), self.family.window_ns)

    def answer_begins(self, request: bytes) -> bytes:
        """Return the head of an answer without an error, where that follows from the request.

        It does where an answer is an error and the data that were asked for, under the request's
        header.
        """
        family, plan = self.family, self.plan
        if family.tells_more or family.echoes or family.stuffing is not None or not plan.size:
            return b""
        if self.slow_parse(request, 0, len(request)) is None:
            return b""
        data = self.slow_describe(request, REQUEST, None).token
        tail = data + (family.answers is not None)  # the error stands behind a constant code
        sizes = np.flatnonzero(plan.sizes(family.most) == plan.size_with(tail))
        at, width = plan.at[plan.size], plan.width[plan.size]
        if not len(sizes) or data < 0:
            return b""
        head = request[:at] + int(sizes[0]).to_bytes(width, "little")
        return head + bytes((family.answers or 0,)) if plan.at["code"] == len(head) else head

    def states_itself(self, frames: Frames) -> Mask:
        """Tell which responses name an address: what others' bytes are, only the request says.

        An answer that comes on its own says what its code has it say, whoever asked.
        """
        own = frames.token == ON_ITS_OWN
        if not self._states_address and not own.any():
            return np.zeros(len(frames), bool)
        named = (frames.kind != REQUEST) & (frames.address >= 0)
        return np.asarray(named & (own | self._states_address) & (frames.token != LISTED))

    def slow_states_itself(self, frame: SlowFrame) -> bool:
        """Tell the same of one."""
        named = self._states_address or frame.token == ON_ITS_OWN
        named = named and frame.kind != REQUEST and frame.address >= 0
        return named and frame.token != LISTED
