"""IRROBOT mightyZAP linear servos (L12 family, 12Lf): the protocol as the core sees it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.ground.model import I16, I64, MALFORMED, REQUEST, Frames, Gap, Mask
from sniffer.ground.registers import bit_names
from sniffer.protocols.base import FieldSpan, FrameView, joined, no_clues
from sniffer.protocols.dissection import leaves
from sniffer.protocols.explaining import by_size
from sniffer.protocols.mightyzap import block, slow
from sniffer.protocols.mightyzap.block import PLAN
from sniffer.protocols.mightyzap.grammar import (
    BROADCAST,
    COMMANDS,
    ERRORS,
    FACTORY_RESET,
    LOAD,
    PACKET,
    REFUSALS,
    SDK_FACTORY_RESET,
    SYMMETRIC_STORE,
    leading,
)

if TYPE_CHECKING:
    from sniffer.ground.checksums import Checksum
    from sniffer.protocols.explaining import Runs, Torn

NO_ID: Final = 0xFF
"""No servo has it: of a run of header bytes, the last three are the header."""

WINDOW_NS: Final = 10_000_000
"""Return delay is at most 255 us (user manual v1.02, Data Map 0x05); the vendor's guide asks
controllers to leave 10 ms around a read, so an answer later than that is late."""


class MightyZap:
    """See ``sniffer.protocols.base.BusProtocol``."""

    name = "mightyzap"
    title = "IRROBOT mightyZAP (IR protocol)"
    bauds: tuple[int, ...] = (9600, 19200, 38400, 57600, 115200, 200000, 250000, 400000)
    baud = 57600
    longest = block.REACH
    reach = block.REACH
    tail_ns = 100_000_000  # clients give up after 20 to 100 ms
    everyone: tuple[int, ...] = (0, BROADCAST)
    blank = b""
    ordered = False
    models = block.MODELS
    registers = joined(block.MODELS)

    frame = staticmethod(block.frame)
    describe = staticmethod(block.describe)
    states_itself = staticmethod(block.states_itself)
    values = staticmethod(block.values)
    slow_parse = staticmethod(slow.parse)
    slow_describe = staticmethod(slow.describe)
    slow_states_itself = staticmethod(slow.states_itself)
    slow_parts = staticmethod(slow.parts)
    slow_clues = staticmethod(no_clues)
    slow_values = staticmethod(slow.values)

    def op_name(self, op: int) -> str:
        """Return the command's name; a code no manual has is ``unknown_<hex>``."""
        if op < 0:
            return "feedback"
        return COMMANDS[op].name if op in COMMANDS else f"unknown_{op:02x}"

    def refused(self, status: I16) -> Mask:
        """Tell which error bytes say that the command was not carried out."""
        return np.asarray((status & REFUSALS) != 0)

    def window_ns(self, frames: Frames) -> I64:
        """Return the reply window, alike for every command."""
        return np.full(len(frames), WINDOW_NS)

    def status_names(self, status: int) -> tuple[str, ...]:
        """Name the bits of an error byte."""
        return tuple(bit_names(ERRORS, status))

    def fields(self, raw: bytes, row: FrameView) -> dict[str, Any]:
        """Return address, length, option, or the error bits."""
        data = raw[row.data_start : row.data_start + row.data_length]
        if row.kind != REQUEST:
            out: dict[str, Any] = {
                "error": {"number": row.status, "names": list(self.status_names(row.status))}
            }
            if data and row.address < 0:
                out["data"] = data.hex()
            return out
        if row.op == LOAD and not row.flags & MALFORMED:
            return {"address": row.address, "length": raw[row.data_start]}
        if row.op in (FACTORY_RESET, SDK_FACTORY_RESET) and data:
            resets = bit_names({0: "servo_id", 1: "baud_rate"}, data[0])
            out = {"option": {"number": data[0], "names": resets}}
            return out if len(data) == 1 else {**out, "factors": data.hex()}
        out = {}
        if row.flags & MALFORMED:
            out |= leading(row.op, data)
        if row.address >= 0:
            out["address"] = row.address
            if row.op == SYMMETRIC_STORE:
                out["length"] = data[0]
        elif data:
            out["factors"] = data.hex()
        return out

    def explain(self, run: bytes, start: int, *, awaited: bool = False) -> list[Gap]:
        """Look for headers: what follows one is a damaged or a truncated packet, the rest noise."""
        del awaited  # headers tell
        return block.explain(run, start)

    def survey(self, runs: Runs) -> Torn:
        """Tell the same of all runs of a pass at once."""
        return by_size(runs, PLAN, NO_ID)

    def dissect(self, raw: bytes, row: FrameView) -> list[FieldSpan]:
        """Return the packet's fields, the factors split by their command's grammar."""
        packet = leaves(PACKET, raw)
        out: list[FieldSpan] = []
        for leaf in packet:
            name = leaf.path.rpartition(".")[2]
            if name == "code":
                if row.kind == REQUEST:
                    out.append(
                        FieldSpan(
                            leaf.offset, 1, "command", f"{leaf.value:02X} {self.op_name(row.op)}"
                        )
                    )
                else:
                    names = ", ".join(self.status_names(leaf.value)) or "none"
                    out.append(FieldSpan(leaf.offset, 1, "error", f"{leaf.value:02X} {names}"))
            elif name == "factors":
                out += self._factors(leaf.offset, leaf.value, row)
            elif name == "header":
                out.append(FieldSpan(leaf.offset, leaf.length, name, leaf.value.hex(" ").upper()))
            else:
                out.append(FieldSpan(leaf.offset, leaf.length, name, str(leaf.value), leaf.docs))
        return out

    def checksum_of(self, raw: bytes) -> tuple[Checksum, bytes, int]:
        """Return the checksum, the bytes from the id on, and the last byte."""
        return PLAN.checksum, raw[PLAN.sum_from : -1], raw[-1]

    def _factors(self, offset: int, data: bytes, row: FrameView) -> list[FieldSpan]:
        command = COMMANDS.get(row.op) if row.kind == REQUEST else None
        if not data:
            return []
        if command is None or row.flags & MALFORMED:
            read = leading(row.op, data) if row.kind == REQUEST else {}
            rest = data[len(read) :]
            out = [FieldSpan(offset + i, 1, k, str(v)) for i, (k, v) in enumerate(read.items())]
            at = offset + len(read)
            return out + [FieldSpan(at, len(rest), "data", rest.hex(" ").upper())] * bool(rest)
        return [
            FieldSpan(
                offset + leaf.offset,
                leaf.length,
                leaf.path,
                leaf.value.hex(" ").upper() if isinstance(leaf.value, bytes) else str(leaf.value),
                leaf.docs,
            )
            for leaf in leaves(command.factors, data)
        ]
