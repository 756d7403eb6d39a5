"""RoboBuilder wCK modules: the protocol as the core sees it."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.ground.checksums import XOR7
from sniffer.ground.codes import REQUEST
from sniffer.ground.model import I16, I64, NS, Frames, Gap, Mask
from sniffer.protocols.base import (
    LETS_GO,
    TURNS_ELSEWHERE,
    FieldSpan,
    FrameView,
    joined,
    no_clues,
)
from sniffer.protocols.dissection import Leaf, leaves
from sniffer.protocols.wck import block, controller, reading, slow
from sniffer.protocols.wck.explain import explain
from sniffer.protocols.wck.grammar import (
    COMMANDS,
    INDEX,
    INSTRUCTIONS,
    MODELS,
    OPS,
    READ_10BIT_TEXT,
    REGISTERS,
    REPLIES,
    REPLY,
    SUB_INSTRUCTIONS,
    UNKNOWN_BASE,
    UNKNOWN_OP,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sniffer.ground.checksums import Sum
    from sniffer.ground.registers import Register, RegisterMap

FAST_NS: Final = 5 * NS // 1000
"""Reads and moves are answered within 0.3 to 1 ms of the command's last byte. Source: manual 1.07,
2-3, table Command Response Time, less the time the bytes take; the rest is left to busy servos."""

SLOW_NS: Final = 200 * NS // 1000
"""Set commands are answered after 120 ms, when the EEPROM is written. Source: as above; the table
has no row for the run-time sets, which are allowed as much, nor for the I/O write."""

CONTROLLER_NS: Final = 500 * NS // 1000
"""RoboBuilder's controller has no stated time; the client this is known from waits as long."""

TAIL_NS: Final = 500 * NS // 1000
"""Above every answer to a set command, and the 65 ms a module is deaf at power-on. Source: as
above; 2-3, Reset Time after Power Supply."""


class Wck:
    """See ``sniffer.protocols.base.BusProtocol``."""

    name = "wck"
    title = "RoboBuilder wCK"
    bauds: tuple[int, ...] = (4800, 9600, 38400, 57600, 115200, 230400, 460800, 921600)
    baud = 115200
    longest = block.LONGEST
    reach = 0  # a reply is the next two bytes, or it is none
    tail_ns = TAIL_NS
    everyone: tuple[int, ...] = (-1,)  # a move or a break to all of them names no id
    blank = b""
    ordered = True
    models: tuple[RegisterMap, ...] = MODELS
    registers: tuple[Register, ...] = joined(MODELS)
    ends_goal = MappingProxyType(
        {INDEX["passive"]: LETS_GO, INDEX["break"]: LETS_GO, INDEX["wheel"]: TURNS_ELSEWHERE}
    )

    frame = staticmethod(block.frame)
    describe = staticmethod(block.describe)
    states_itself = staticmethod(reading.states_itself)
    values = staticmethod(reading.values)
    slow_parse = staticmethod(slow.parse)
    slow_describe = staticmethod(slow.describe)
    slow_states_itself = staticmethod(slow.states_itself)
    slow_parts = staticmethod(slow.parts)
    slow_clues = staticmethod(no_clues)
    slow_values = staticmethod(slow.values)

    def op_name(self, op: int) -> str:
        """Return the command's name; a code the manual does not have is ``unknown_<hex>``."""
        if op >= controller.BASE:
            return controller.op_name(op)
        return OPS[op].name if op < UNKNOWN_BASE else f"unknown_{op - UNKNOWN_BASE:02x}"

    def refused(self, status: I16) -> Mask:
        """Tell nothing: replies have no status."""
        return np.zeros(len(status), bool)

    def window_ns(self, frames: Frames) -> I64:
        """Return the reply window: short, but for commands that may write the EEPROM."""
        slow_one = block.SLOW[np.minimum(frames.op, UNKNOWN_OP)]
        window = np.where(slow_one, SLOW_NS, FAST_NS)
        return np.where(frames.op >= controller.BASE, CONTROLLER_NS, window).astype(np.int64)

    def status_names(self, status: int) -> tuple[str, ...]:
        """Name nothing: replies have no status."""
        del status
        return ()

    def fields(self, raw: bytes, row: FrameView) -> dict[str, Any]:
        """Return what is no register: counts, motions, bytes that only together are a value."""
        if controller.is_packet(raw):
            return controller.fields(raw)
        index = min(row.op, UNKNOWN_OP)
        name = OPS[index].name
        if row.kind != REQUEST:
            fields = {**REPLIES[index].parse(raw)}
        elif name == "position_read_10bit":
            return {}
        else:
            fields = {**COMMANDS[index].parse(raw).body.value}
        out: dict[str, Any] = {}
        match name:
            case "sync_position_move":
                out["count"], out["last_id"] = fields["data2"].count, fields["data2"].count - 1
            case "motion_data_write" if "motion" in fields:
                out["motion"] = [_motion(word) for word in fields["motion"]]
            case "passive" if row.kind != REQUEST:
                out["echo"] = fields["data2"]
            case "break" if row.kind != REQUEST:
                out["id"] = fields["id"]
            case "unknown" | "rbc_direct_control_end":
                out["data"] = raw[row.data_start : row.data_start + row.data_length].hex()
        for key in ("target_h3", "target_l7", "h3", "l7"):
            if key in fields:
                out[key.removeprefix("target_")] = fields[key]
        if "digital_output" in fields:
            out |= {f"channel_{k + 1}": fields["digital_output"] >> k & 1 for k in range(2)}
        if "overload" in fields:
            out |= _milliamperes(fields["overload"])
        return out

    def explain(self, run: bytes, start: int, *, awaited: bool = False) -> list[Gap]:
        """Look for headers: what follows is a damaged or truncated command, the rest noise."""
        return explain(run, start, awaited=awaited)

    def checksum_of(self, raw: bytes) -> tuple[Sum, bytes, int] | None:
        """Return the checksum, what it takes in, and the last byte; a reply has none."""
        if len(raw) <= REPLY:
            return None
        if controller.is_packet(raw):
            return controller.PLAN.checksum_of(raw)
        kind, body = block.KIND[raw[block.DATA2] << 8 | raw[block.DATA1]], raw[1:-1]
        if kind == block.SYNC:
            body = raw[block.PARAMS : -1]
        if _is_text_sum(kind, raw):
            body = raw[block.DATA1 : block.PARAMS] + raw[block.PARAMS + 1 : -1]
        return XOR7, body, raw[-1]

    def dissect(self, raw: bytes, row: FrameView) -> list[FieldSpan]:
        """Return the frame's bytes by their grammar, Data1 and Data2 with their bit fields."""
        if controller.is_packet(raw):
            return [_packet_span(leaf) for leaf in leaves(controller.PACKET, raw)]
        index = min(row.op, UNKNOWN_OP)
        if row.kind != REQUEST:
            return [span for leaf in leaves(REPLIES[index], raw) for span in _spans(leaf, raw)]
        grammar = COMMANDS[index]
        if _is_text_sum(index, raw):
            grammar = READ_10BIT_TEXT
        return [span for leaf in leaves(grammar, raw) for span in _spans(leaf, raw)]


def _packet_span(leaf: Leaf) -> FieldSpan:
    """Return a field of a controller's packet; bytes in hexadecimal."""
    value = leaf.value
    words = value.hex(" ").upper() if isinstance(value, bytes) else str(value)
    return FieldSpan(leaf.offset, leaf.length, leaf.path.replace("_", " "), words, leaf.docs)


def _is_text_sum(kind: int, raw: bytes) -> bool:
    """Tell whether a 10-bit read has the checksum of its section rather than that of note 5."""
    return kind == block.READ_10BIT and XOR7(raw[1:-1]) != raw[-1]


def _named(number: int, names: Mapping[int, str]) -> dict[str, Any]:
    out: dict[str, Any] = {"number": number}
    if number in names:
        out["name"] = names[number]
    return out


def _motion(word: Any) -> dict[str, Any]:
    main, sub = word.command.instruction, word.command.sub
    out: dict[str, Any] = {"command": main << 4 | sub, "instruction": _named(main, INSTRUCTIONS)}
    if main in SUB_INSTRUCTIONS:
        out["sub"] = _named(sub, SUB_INSTRUCTIONS[main])
    else:
        out["sub"] = sub
    return {**out, "data": word.data}


def _milliamperes(code: int) -> dict[str, int]:
    """Return the current that a code of the over load setting stands for, where it is listed."""
    name = MODELS[0].registers[REGISTERS["overload"]].values.get(code, "")
    return {"overload_ma": int(name.removesuffix(" mA"))} if name else {}


def _spans(leaf: Leaf, raw: bytes) -> list[FieldSpan]:
    """Return a field in words: a byte's bit fields side by side, a list item by item."""
    name = leaf.path.rpartition(".")[2]
    value = leaf.value
    if isinstance(value, list):
        size = leaf.length // max(len(value), 1)
        item = {"targets": "target of id", "motion": "instruction"}[name]
        return [
            FieldSpan(leaf.offset + i * size, size, f"{item} {i}", *_item(one))
            for i, one in enumerate(value)
        ]
    shown = raw[leaf.offset : leaf.offset + leaf.length].hex().upper()
    if isinstance(value, dict):
        bits = {k: v for k, v in value.items() if k != "_io"}
        text = ", ".join(f"{k} {v}" for k, v in bits.items())
        return [FieldSpan(leaf.offset, leaf.length, name, f"{shown}: {text}", _units(bits))]
    if name == "header":
        return [FieldSpan(leaf.offset, leaf.length, name, shown)]
    note = XOR7.formula if name == "checksum" else leaf.docs or _units({name: value})
    return [FieldSpan(leaf.offset, leaf.length, name, f"{shown} = {value}", note)]


def _item(one: Any) -> tuple[str, str]:
    """Return a target, or an instruction of a motion, in words."""
    if isinstance(one, int):
        return f"{one:02X} = {one}", _units({"goal_position": one})
    main, sub = one.command.instruction, one.command.sub
    word = SUB_INSTRUCTIONS.get(main, {}).get(sub, "")
    return f"{INSTRUCTIONS.get(main, main)}, sub {sub}, data {one.data}", word


def _units(fields: Mapping[str, int]) -> str:
    """Return what the register table makes of values that bear a register's name."""
    out: list[str] = []
    for name, raw in fields.items():
        if name not in REGISTERS:
            continue
        register = MODELS[0].registers[REGISTERS[name]]
        names = register.names(raw)
        if register.unit:
            out.append(f"{raw * register.scale:.2f} {register.unit}")
        elif names is not None:
            out.append(names if isinstance(names, str) else " ".join(names) or "none")
    return ", ".join(out)
