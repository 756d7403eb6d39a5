"""Futaba RS30x command servos (RS305CR): the protocol as the core sees it."""

from __future__ import annotations

import functools
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from construct import ConstructError

from sniffer.ground.codes import REQUEST
from sniffer.ground.model import MALFORMED
from sniffer.ground.registers import numbered
from sniffer.protocols.base import RESTARTS, FieldSpan, joined, no_clues
from sniffer.protocols.dissection import leaves
from sniffer.protocols.rs30x import block, damage, slow
from sniffer.protocols.rs30x.block import PLAN
from sniffer.protocols.rs30x.grammar import (
    ACK,
    ACK_BYTE,
    EVERYONE,
    LONG,
    LONG_WRITE,
    MODELS,
    NACK,
    OPS,
    PACKET,
    REBOOT,
    REFUSALS,
    RESET_WITH_DATA,
    RETURN,
    answer_head,
    flag_names,
    long_data,
    status_names,
)
from sniffer.protocols.shapes import Addressed

if TYPE_CHECKING:
    from sniffer.ground.checksums import Sum
    from sniffer.ground.model import I16, I64, U8, Frames, Gap, Mask
    from sniffer.ground.registers import RegisterMap
    from sniffer.protocols.base import FrameView
    from sniffer.protocols.dissection import Leaf
    from sniffer.protocols.explaining import Runs, Torn

WINDOW_NS: Final = 100_000 + 255 * 50_000
"""A reply begins 100 us + 50 us * n behind its request; n is the return delay, one byte, and seldom
seen on the bus: the bound is that of the greatest. Source: RS305CR manual, 4.2 No. 7."""


class Rs30x:
    """See ``sniffer.protocols.base.BusProtocol``."""

    name = "rs30x"
    title = "Futaba RS30x (RS305CR)"
    # RS305CR manual, table 4.6; the last one only siblings have (RS301CR manual, Table 4.6: 0AH)
    bauds: tuple[int, ...] = (
        9600,
        14400,
        19200,
        28800,
        38400,
        57600,
        76800,
        115200,
        153600,
        230400,
        460800,
    )
    baud = 115200
    longest = block.REACH
    reach = block.REACH
    tail_ns = 100_000_000  # many times the reply window; what takes longer (flash) is not answered
    everyone: tuple[int, ...] = (EVERYONE,)
    leading: tuple[int, ...] = (LONG,)
    blank = b""
    ordered = False
    ends_goal = MappingProxyType({REBOOT: RESTARTS})
    keeps = "flash_write"
    """The command before which no setting is written to memory. Source: RS305CR manual, 4.2: No. 4
    to 29 are in RAM; flag bit 6."""

    frame = staticmethod(block.frame)
    describe = staticmethod(block.describe)
    states_itself = staticmethod(block.states_itself)
    slow_parse = staticmethod(slow.parse)
    slow_describe = staticmethod(slow.describe)
    slow_states_itself = staticmethod(slow.states_itself)
    slow_parts = staticmethod(slow.parts)
    slow_clues = staticmethod(no_clues)

    def __init__(self, models: tuple[RegisterMap, ...] = MODELS) -> None:
        self.models = models
        self.registers = joined(models)
        self.values = functools.partial(block.values, shapes=Addressed(models, first=0))
        self.slow_values = functools.partial(slow.values, models=models)

    def with_models(self, tables: tuple[RegisterMap, ...]) -> Rs30x:
        """Return the protocol with further models behind its own."""
        return Rs30x(numbered((*self.models, *tables)))

    def op_name(self, op: int) -> str:
        """Return the manual's word for what a packet does."""
        return OPS[op]

    def refused(self, status: I16) -> Mask:
        """Tell which answers say that the packet was not processed, or the flash not written."""
        return np.asarray((status & REFUSALS) != 0)

    def window_ns(self, frames: Frames) -> I64:
        """Return the reply window, alike for every request."""
        return np.full(len(frames), WINDOW_NS)

    def reply_delay_ns(self, name: str, raw: int) -> int | None:
        """Return the return delay. Source: RS305CR manual, 4.2 No. 7."""
        return 100_000 + 50_000 * raw if name == "return_delay" else None

    def answer_begins(self, request: bytes) -> bytes:
        """Return the head of the return packet that a short packet asks for, or the ACK."""
        try:
            asked = PACKET.parse(request).body.value
        except ConstructError:
            return b""
        return answer_head(asked.servo_id, asked.flags, asked.address, asked.length)

    def status_names(self, status: int) -> tuple[str, ...]:
        """Name the errors and alarms of a return packet, or a NACK."""
        return status_names(status)

    def fields(self, raw: bytes, row: FrameView) -> dict[str, Any]:
        """Return the head of the packet, flags by number and name; of a bare byte, if it is ACK."""
        if len(raw) == 1:
            acked = row.status != NACK
            return {"ack": acked, "answer": {"number": raw[0], "name": "ACK" if acked else "NACK"}}
        asked = row.kind == REQUEST
        body = _grammar(raw, row).parse(raw).body.value
        names = flag_names(body.flags) if asked else status_names(body.flags)
        out: dict[str, Any] = {
            "id": body.servo_id,
            "flags": {"number": body.flags, "names": list(names)},
            "address": body.address,
            "length": body.length,
            "count": body.count,
        }
        if asked and row.address < 0 and body.data:
            out["data"] = body.data.hex()
        return out

    def telling_bytes(self, frames: Frames, data: U8) -> I64:
        """Return the head of a packet: data that is of registers ``fields`` does not look at."""
        del data
        f = frames
        head = (f.length > 1) & ((f.address >= 0) | (f.kind != REQUEST))
        return np.where(head, PLAN.tail_at, f.length)

    def explain(self, run: bytes, start: int, *, awaited: bool = False) -> list[Gap]:
        """Look for headers: what follows one is a damaged or a truncated packet, the rest noise."""
        del awaited  # headers tell
        return block.explain(run, start)

    def survey(self, runs: Runs) -> Torn:
        """Tell the same of all runs of a pass at once."""
        return damage.survey(runs)

    def dissect(self, raw: bytes, row: FrameView) -> list[FieldSpan]:
        """Return the packet's fields, the data of a long packet servo by servo."""
        out: list[FieldSpan] = []
        for leaf in leaves(_grammar(raw, row), raw):
            if leaf.path == "body.flags":
                names = flag_names(leaf.value) if row.kind == REQUEST else status_names(leaf.value)
                words = f"{leaf.value:02X} {', '.join(names) or 'none'}"
                out.append(FieldSpan(leaf.offset, leaf.length, "flags", words))
            elif leaf.path == "body.data" and row.op == LONG_WRITE and row.kind == REQUEST:
                out += _long(leaf, raw, row)
            else:
                out.append(_span(leaf))
        return out

    def checksum_of(self, raw: bytes) -> tuple[Sum, bytes, int] | None:
        """Return the checksum, the bytes from the id on, and the last byte; an ACK has none."""
        if len(raw) == 1:
            return None
        return PLAN.checksum_of(raw)


def _grammar(raw: bytes, row: FrameView) -> Any:
    """Return the grammar that a frame which holds was read by."""
    if len(raw) == 1:
        return ACK
    if row.kind != REQUEST:
        return RETURN
    try:
        PACKET.parse(raw)
    except ConstructError:
        return RESET_WITH_DATA
    return PACKET


def _span(leaf: Leaf, offset: int = 0) -> FieldSpan:
    """Return a field as it stands; bytes in hexadecimal."""
    value = leaf.value
    words = value.hex(" ").upper() if isinstance(value, bytes) else str(value)
    if leaf.path == "answer":
        words = f"{value:02X} {'ack' if value == ACK_BYTE else 'nack'}"
    elif leaf.path == "checksum":
        words = f"{value:02X}"
    return FieldSpan(
        leaf.offset + offset, leaf.length, leaf.path.removeprefix("body."), words, leaf.docs
    )


def _long(data: Leaf, raw: bytes, row: FrameView) -> list[FieldSpan]:
    """Split a long packet's data; what its grammar does not fit stays in one piece."""
    if row.flags & MALFORMED:
        return [_span(data)]
    length = PACKET.parse(raw).body.value.length
    return [_span(leaf, data.offset) for leaf in leaves(long_data(length), data.value)]


__all__ = ["WINDOW_NS", "Rs30x"]
