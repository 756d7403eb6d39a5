"""What most protocols that are written by hand have alike: the rest of ``BusProtocol``.

Who has no status, no answers that stand without their request, or no checksum says nothing of it.
What a protocol must say itself, nobody can guess: names and numbers, frames, their oracle.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sniffer.ground.model import Gap
from sniffer.protocols.base import FieldSpan, joined
from sniffer.protocols.shapes import slow_spans

if TYPE_CHECKING:
    from sniffer.ground.checksums import Sum
    from sniffer.ground.clues import Clue
    from sniffer.ground.model import I16, I64, Frames, Mask
    from sniffer.ground.registers import Register, RegisterMap
    from sniffer.protocols.base import FrameView, SlowFrame, State


class ByHand:
    """A protocol less what only it knows; a method of it replaces one of these.

    A class below it says ``name``, ``title``, ``bauds``, ``baud``, ``longest``, ``reach``,
    ``tail_ns``, ``models``; ``frame``, ``describe``, ``values``; the oracle's ``slow_parse`` and
    ``slow_describe``; and ``op_name``. ``answers_within_ns`` is the time that clients wait; where
    it says none, an answer may come until ``tail_ns``, which nothing crosses.
    """

    interface = 1
    auto = False
    everyone: tuple[int, ...] = ()
    blank = b""
    ordered = False
    tail_ns: int
    answers_within_ns: int | None = None
    models: tuple[RegisterMap, ...]
    registers: tuple[Register, ...]

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "models" in vars(cls):
            cls.registers = joined(cls.models)

    # -- columns ----

    def refused(self, status: I16) -> Mask:
        """Tell nothing: no status says so."""
        return np.zeros(len(status), bool)

    def states_itself(self, frames: Frames) -> Mask:
        """Tell nothing: what an answer is about, its request says."""
        return np.zeros(len(frames), bool)

    def window_ns(self, frames: Frames) -> I64:
        """Return the same for every request."""
        within = self.tail_ns if self.answers_within_ns is None else self.answers_within_ns
        return np.full(len(frames), within, np.int64)

    # -- the oracle ----

    def slow_states_itself(self, frame: SlowFrame) -> bool:
        """Tell the same of one."""
        del frame
        return False

    def slow_parts(self, frame: SlowFrame) -> list[tuple[int, int, bytes]]:
        """Return what stands from its address on, if it has one."""
        return [(frame.servo_id, frame.address, frame.data)] if frame.address >= 0 else []

    def slow_clues(self, frame: SlowFrame) -> list[Clue]:
        """Return nothing: addresses tell."""
        del frame
        return []

    def slow_values(self, frame: SlowFrame, state: State) -> list[tuple[int, int, int, int]]:
        """Split what each servo is brought or says by its table."""
        return slow_spans(self.models, state, self.slow_parts(frame))

    # -- words ----

    def status_names(self, status: int) -> tuple[str, ...]:
        """Name nothing."""
        del status
        return ()

    def fields(self, raw: bytes, row: FrameView) -> dict[str, Any]:
        """Return the bytes of the data, where no register says what they are."""
        if row.registers or not row.data_length:
            return {}
        return {"data": raw[row.data_start : row.data_start + row.data_length].hex()}

    def dissect(self, raw: bytes, row: FrameView) -> list[FieldSpan]:
        """Return what stands before the data, the data, and what stands behind."""
        edges = (0, row.data_start, row.data_start + row.data_length, len(raw))
        names = ("head", "data", "tail")
        return [
            FieldSpan(a, b - a, name, raw[a:b].hex(" ").upper())
            for name, a, b in zip(names, edges, edges[1:], strict=False)
            if b > a
        ]

    def checksum_of(self, raw: bytes) -> tuple[Sum, bytes, int] | None:
        """Return nothing: there is none."""
        del raw
        return None

    def explain(self, run: bytes, start: int, *, awaited: bool = False) -> list[Gap]:
        """Say that an answer was cut where one is awaited, and else that it is noise."""
        reason = "truncated" if awaited else "noise"
        return [Gap(start, len(run), reason, {"have": len(run)} if awaited else {})]
