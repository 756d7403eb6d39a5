"""RoboBuilder wCK modules: the protocol as the core sees it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from sniffer.checksums import XOR7
from sniffer.model import I16, I64, NS, REQUEST, Frames, Gap, Mask
from sniffer.protocols.base import FieldSpan, FrameView, joined
from sniffer.protocols.dissection import Leaf, leaves
from sniffer.protocols.wck import block, slow
from sniffer.protocols.wck.explain import explain
from sniffer.protocols.wck.grammar import (
    COMMANDS,
    DIRECTIONS,
    INDEX,
    INSTRUCTIONS,
    OPS,
    READ_10BIT_TEXT,
    REPLIES,
    SUB_INSTRUCTIONS,
    TORQUES,
    UNKNOWN_BASE,
    UNKNOWN_OP,
)
from sniffer.registers import Register, RegisterMap

FAST_NS: Final = 5 * NS // 1000
"""Reads and moves are answered within 0.3 to 1 ms of the command's last byte. Source: manual 1.07,
2-3, table Command Response Time, less the time the bytes take; the rest is left to busy servos."""

SLOW_NS: Final = 200 * NS // 1000
"""Set commands are answered after 120 ms, when the EEPROM is written. Source: as above; the table has
no row for the run-time sets, the I/O write is taken for a fast one."""

TAIL_NS: Final = 500 * NS // 1000
"""Above every answer to a set command, and the 65 ms a module is deaf at power-on. Source: as above;
2-3, Reset Time after Power Supply."""


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
    models: tuple[RegisterMap, ...] = block.MODELS
    registers: tuple[Register, ...] = joined(block.MODELS)

    frame = staticmethod(block.frame)
    describe = staticmethod(block.describe)
    values = staticmethod(block.values)
    slow_parse = staticmethod(slow.parse)
    slow_describe = staticmethod(slow.describe)
    slow_values = staticmethod(slow.values)

    def op_name(self, op: int) -> str:
        """Return the command's name; a code the manual does not have is ``unknown_<hex>``."""
        return OPS[op].name if op < UNKNOWN_BASE else f"unknown_{op - UNKNOWN_BASE:02x}"

    def refused(self, status: I16) -> Mask:
        """Tell nothing: replies have no status."""
        return np.zeros(len(status), bool)

    def window_ns(self, frames: Frames) -> I64:
        """Return the reply window: short, but for commands that may write the EEPROM."""
        slow_one = block.SLOW[np.minimum(frames.op, UNKNOWN_OP)]
        return np.where(slow_one, SLOW_NS, FAST_NS).astype(np.int64)

    def status_names(self, status: int) -> tuple[str, ...]:
        """Name nothing: replies have no status."""
        del status
        return ()

    def fields(self, raw: bytes, row: FrameView) -> dict[str, Any]:
        """Return what is no register: torque and direction by name, counts, motions, raw bytes."""
        index = min(row.op, UNKNOWN_OP)
        name = OPS[index].name
        if row.kind != REQUEST:
            return _reply_fields(name, raw)
        grammar = COMMANDS[index]
        if name == "position_read_10bit":
            return {}
        body = grammar.parse(raw).body.value
        out: dict[str, Any] = {}
        if "torque_level" in body.data1:
            out["torque"] = _named(body.data1.torque_level, TORQUES)
        match name:
            case "wheel":
                out["direction"] = _named(body.data2.wheel_direction, DIRECTIONS)
            case "sync_position_move":
                out["count"], out["last_id"] = body.data2.count, body.data2.count - 1
            case "motion_data_write":
                out["motion"] = [_motion(word) for word in body.motion]
            case "position_move_10bit":
                out["h3"], out["l7"] = body.target_h3, body.target_l7
            case "unknown":
                out["code"], out["data"] = body.data2.command, raw[3:-1].hex()
        return out

    def explain(self, run: bytes, start: int) -> list[Gap]:
        """Look for headers: what follows one is a damaged or a truncated command, the rest noise."""
        return explain(run, start)

    def dissect(self, raw: bytes, row: FrameView) -> list[FieldSpan]:
        """Return the frame's bytes by their grammar, Data1 and Data2 with their bit fields."""
        index = min(row.op, UNKNOWN_OP)
        if row.kind != REQUEST:
            return [span for leaf in leaves(REPLIES[index], raw) for span in _spans(leaf)]
        grammar = COMMANDS[index]
        if row.op == block.READ_10BIT and XOR7(raw[1:-1]) != raw[-1]:
            grammar = READ_10BIT_TEXT
        return [span for leaf in leaves(grammar, raw) for span in _spans(leaf)]


def _named(number: int, names: Mapping[int, str]) -> dict[str, Any]:
    out: dict[str, Any] = {"number": number}
    if number in names:
        out["name"] = names[number]
    return out


def _motion(word: Any) -> dict[str, Any]:
    main, sub = word.command.instruction, word.command.sub
    out = {"instruction": _named(main, INSTRUCTIONS)}
    if main in SUB_INSTRUCTIONS:
        out["sub"] = _named(sub, SUB_INSTRUCTIONS[main])
    else:
        out["sub"] = sub
    return {**out, "data": word.data}


def _reply_fields(name: str, raw: bytes) -> dict[str, Any]:
    match name:
        case "passive":
            return {"echo": raw[0]}
        case "break":
            return {"id": raw[0]}
        case "position_move_10bit" | "position_read_10bit":
            return {"h3": raw[0], "l7": raw[1]}
        case "unknown":
            return {"data": raw.hex()}
        case _:
            return {}


def _spans(leaf: Leaf) -> list[FieldSpan]:
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
    if isinstance(value, bytes):
        return [FieldSpan(leaf.offset, leaf.length, name, value.hex().upper())]
    if isinstance(value, dict):
        bits = {k: v for k, v in value.items() if k != "_io"}
        texts = [f"{k} {v}" + _word(TORQUES if k == "torque_level" else {}, v) for k, v in bits.items()]
        return [FieldSpan(leaf.offset, leaf.length, name, ", ".join(texts), _units(bits))]
    note = XOR7.formula if name == "checksum" else leaf.docs or _units({name: value})
    return [FieldSpan(leaf.offset, leaf.length, name, f"{value:02X} = {value}", note)]


def _item(one: Any) -> tuple[str, str]:
    if isinstance(one, int):
        return f"{one:02X} = {one}", _units({"goal_position": one})
    main, sub = one.command.instruction, one.command.sub
    named = _word(SUB_INSTRUCTIONS.get(main, {}), sub)
    return f"{INSTRUCTIONS.get(main, main)}, sub {sub}{named}, data {one.data}", ""


def _word(names: Mapping[int, str], number: int) -> str:
    return f" ({names[number]})" if number in names else ""


def _units(fields: Mapping[str, int]) -> str:
    """Return what the register table makes of values that bear a register's name."""
    out: list[str] = []
    for name, raw in fields.items():
        if name not in block.REGISTERS:
            continue
        register = block.MODELS[0].registers[block.REGISTERS[name]]
        names = register.names(raw)
        if register.unit:
            out.append(f"{raw * register.scale:.2f} {register.unit}")
        elif names is not None:
            out.append(names if isinstance(names, str) else " ".join(names) or "none")
    return ", ".join(out)
