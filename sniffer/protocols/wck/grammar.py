"""RoboBuilder wCK: every packet of both directions, declared once.

    FF | Data1 | Data2 | ... | CHECKSUM        command; Data1 is mode << 5 | id
    byte | byte                                reply: no header, no checksum, no id

What a reply means, and that it is one, only the command before it tells. ``OPS`` is the one table:
bits and bytes of each command by name, bytes of its reply by name. A name that is also a register's
(``schemas/registers/wck.toml``) is its value; a reply byte named like a byte of its command must
repeat it; ``again`` is a byte that must repeat the byte before it.

Source: RoboBuilder wCK series user's manual 1.07, A-1 Communication Protocol, A-6 Protocol Table.
"""

from __future__ import annotations

import itertools
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from construct import (
    Array,
    BitsInteger,
    BitStruct,
    Byte,
    Check,
    Checksum,
    Const,
    Default,
    Nibble,
    OneOf,
    RawCopy,
    Struct,
    this,
)

from sniffer.ground.checksums import XOR7
from sniffer.ground.registers import load_models

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

HEADER: Final = 0xFF
"""First byte of every command. Source: manual 1.07, A-1, Header."""

EVERYONE: Final = 31
"""In the id bits: all modules. Source: manual 1.07, A-1-1 (2) and (6)."""

MODELS: Final = load_models("wck")
REGISTERS: Final = MODELS[0].index

REPLY: Final = 2
"""Bytes of every reply. Source: manual 1.07, A-6, Response Packet."""

MOTION_MOST: Final = 8
"""Greatest motion count, in words. Source: manual 1.07, A-1-3 (24) Motion Data Write."""


MASKS: Final[Mapping[str, int]] = MappingProxyType({"digital_output": 0b11})
"""Bits that count in a byte, where others are arbitrary. Source: manual 1.07, A-1-3 (22), (23)."""


class Bits(NamedTuple):
    """A bit field of Data1 or Data2, and the values a command allows in it."""

    name: str
    width: int
    allowed: Sequence[int]


class Op(NamedTuple):
    """One command and its reply.

    ``params`` are the bytes behind Data2, ``tail`` what follows them in the two commands of
    variable length. ``reply_ff`` tells which of the reply bytes may be FF; the first is at most
    ``reply_most``. ``slow``: the servo may write its EEPROM before it answers.
    """

    name: str
    data1: tuple[Bits, ...]
    data2: tuple[Bits, ...]
    params: tuple[str, ...] = ()
    reply: tuple[str, ...] = ()
    tail: tuple[Any, ...] = ()
    reply_ff: tuple[bool, bool] = (False, False)
    reply_most: int = 0xFF
    slow: bool = False

    @property
    def length(self) -> int:
        """Bytes of the shortest whole command: header, Data1, Data2, parameters, checksum."""
        return 4 + len(self.params)


def byte_values(bits: Sequence[Bits]) -> tuple[int, ...]:
    """Return every byte value that a row of bit fields allows."""
    out: list[int] = []
    for fields in itertools.product(*(b.allowed for b in bits)):
        value = 0
        for field, b in zip(fields, bits, strict=True):
            value = value << b.width | field
        out.append(value)
    return tuple(out)


def _mode(*modes: int, ids: Sequence[int] = range(31), name: str = "mode") -> tuple[Bits, ...]:
    return (Bits(name, 3, modes), Bits("id", 5, ids))


def _code(code: int) -> tuple[Bits, ...]:
    return (Bits("command", 8, (code,)),)


def _rest(low: int, width: int) -> Bits:
    return Bits("arbitrary", width, range(low, 1 << width))


_MOVE: Final = _mode(0, 1, 2, 3, 4, name="torque_level")
_SYNC: Final = _mode(0, 1, 2, 3, 4, ids=(EVERYONE,), name="torque_level")
_SET: Final = _mode(7)
_TEN: Final = _mode(7, ids=range(32))
_FREE: Final = ("arbitrary3", "arbitrary4")

MOTION_WORD: Final = Struct(
    "command" / BitStruct("instruction" / Nibble, "sub" / Nibble), "data" / Byte
)
"""One instruction of a self-running motion. Source: manual 1.07, 3-11 Self-running Motion."""


def _set(name: str, code: int, params: tuple[str, ...], **more: Any) -> Op:
    """Return a set command: its reply repeats what it set."""
    return Op(name, _SET, _code(code), params, params, slow=True, **more)


def _read(name: str, code: int, *reply: str, **more: Any) -> Op:
    return Op(name, _SET, _code(code), _FREE, reply, **more)


_KNOWN: Final = (
    Op("position_move", _MOVE, (Bits("goal_position", 8, range(255)),), (), ("load", "position")),
    Op(
        "sync_position_move",
        _SYNC,
        (_rest(0, 3), Bits("count", 5, range(1, 32))),
        tail=("targets" / Array(this.data2.count, Byte),),
    ),
    Op("status_read", _mode(5), (_rest(0, 8),), (), ("load", "position")),
    Op("passive", _mode(6), (Bits("mode", 4, (1,)), _rest(0, 4)), (), ("data2", "position")),
    Op(
        "wheel",
        _mode(6),
        (Bits("wheel_direction", 4, (3, 4)), Bits("wheel_speed", 4, range(16))),
        (),
        ("rotation_count", "position"),
        reply_ff=(True, False),
    ),
    Op(
        "break",
        _mode(6, ids=(EVERYONE,)),
        (Bits("mode", 4, (2,)), _rest(0, 4)),
        (),
        ("id", "position"),
        reply_most=30,
    ),
    _set("baud_rate_set", 0x08, ("baud_rate", "again")),
    _set("pd_gain_set", 0x09, ("p_gain", "d_gain")),
    _read("pd_gain_read", 0x0A, "p_gain", "d_gain"),
    _set("i_gain_set", 0x15, ("i_gain", "again")),
    _read("i_gain_read", 0x16, "i_gain", "again"),
    _set("runtime_pd_gain_set", 0x0B, ("runtime_p_gain", "runtime_d_gain")),
    _set("runtime_i_gain_set", 0x18, ("runtime_i_gain", "again")),
    _set("id_set", 0x0C, ("servo_id", "again")),
    _set("speed_set", 0x0D, ("speed", "acceleration")),
    _read("speed_read", 0x0E, "speed", "acceleration"),
    Op("runtime_speed_set", _SET, _code(0x17), ("runtime_speed", "runtime_acceleration")),
    _set("overload_set", 0x0F, ("overload", "again")),
    _read("overload_read", 0x10, "overload", "again"),
    _set("boundary_set", 0x11, ("lower_boundary", "upper_boundary")),
    _read("boundary_read", 0x12, "lower_boundary", "upper_boundary"),
    Op(
        "io_write",
        _SET,
        _code(0x64),
        ("digital_output", "again"),
        ("digital_output", "again"),
        reply_ff=(True, True),
    ),
    # an 8-bit AD value of FF is 5 V, so the second byte may be FF as well
    _read("io_read", 0x65, "digital_output", "ad_input", reply_ff=(True, True)),
    Op(
        "motion_data_write",
        _SET,
        _code(0x96),
        ("motion_count",),
        ("motion_count", "again"),
        tail=(
            Check(this.motion_count <= MOTION_MOST),
            "motion" / Array(this.motion_count, MOTION_WORD),
        ),
        slow=True,
    ),
    _read("motion_data_read", 0x97, "motion_count", "again"),
    # not for a module: it ends the direct control mode of RoboBuilder's controller (controller.py);
    # in no manual, third-party clients send it with 01 00 and wait for nothing
    Op("rbc_direct_control_end", _mode(7, ids=(0,)), _code(0xFB), ("data3", "data4")),
    Op(
        "position_move_10bit",
        _TEN,
        _code(0xC8),
        ("id", "torque_10bit", "target_h3", "target_l7"),
        ("h3", "l7"),
        reply_most=7,
    ),
    Op(
        "position_read_10bit",
        _TEN,
        _code(0xC9),
        ("id", "again"),
        ("h3", "l7"),
        reply_most=7,
    ),
)

_TAKEN: Final = {
    code for op in _KNOWN if op.data1 in (_SET, _TEN) for code in byte_values(op.data2)
}

OPS: Final[tuple[Op, ...]] = (
    *_KNOWN,
    # the manual times a Resolution Set and a Resolution Read without giving their codes
    Op(
        "unknown",
        _SET,
        (Bits("command", 8, tuple(k for k in range(HEADER) if k not in _TAKEN)),),
        ("data3", "data4"),
        ("byte1", "byte2"),
        slow=True,
    ),
)
"""All commands, the unknown set command last. Sources: manual 1.07, A-1-1 to A-1-4, A-6; for what
is unknown 2-3, table Command Response Time. Reply bytes that may be FF: (5) No of Rotation 0..255,
(22) D/O Value with arbitrary upper bits, (23) the same and an 8-bit AD; all others end at 254."""

INDEX: Final[Mapping[str, int]] = MappingProxyType({op.name: i for i, op in enumerate(OPS)})
UNKNOWN_OP: Final = INDEX["unknown"]
UNKNOWN_BASE: Final = 256
"""``Frames.op`` of an unknown set command is this plus its code; of the others the row of OPS."""

FIRSTS: Final = tuple(frozenset(byte_values(op.data1)) for op in OPS)
SECONDS: Final = tuple(frozenset(byte_values(op.data2)) for op in OPS)
"""Values of Data1 and Data2 that select each command."""


def _byte(bits: Sequence[Bits]) -> Any:
    return BitStruct(
        *(b.name / Default(OneOf(BitsInteger(b.width), b.allowed), b.allowed[0]) for b in bits)
    )


_DOCS: Final = MappingProxyType(
    {
        "h3": "position, upper 3 bits",
        "l7": "position, lower 7 bits",
        "target_h3": "target position, upper 3 bits",
        "target_l7": "target position, lower 7 bits",
        "data2": "Data2 of the command",
        "id": "of the module",
    }
)


def _bytes(names: Sequence[str]) -> list[Any]:
    out: list[Any] = []
    for i, name in enumerate(names):
        if name == "again":
            out.append(name / Default(Byte, this[names[i - 1]]) * f"{names[i - 1]} once more")
        else:
            byte = Default(Byte, 0) if name in _FREE else Byte
            out.append(name / byte * _DOCS.get(name, ""))
    return out


def _packet(op: Op, covered: Any = this.body.data) -> Any:
    body = Struct(
        "data1" / _byte(op.data1), "data2" / _byte(op.data2), *_bytes(op.params), *op.tail
    )
    return Struct(
        "header" / Const(bytes([HEADER])),
        "body" / RawCopy(body),
        "checksum" / Checksum(Byte, XOR7, covered),
    )


def _targets(packet: Any) -> bytes:
    return bytes(packet.body.data[2:])


def _without_data3(packet: Any) -> bytes:
    data = packet.body.data
    return bytes(data[:2] + data[3:])


COMMANDS: Final = tuple(
    _packet(op, _targets if op.name == "sync_position_move" else this.body.data) for op in OPS
)
"""The grammar of each row of OPS. The checksum of a synchronized move takes the targets only:
manual 1.07, A-1-1 (2), Checksum."""

READ_10BIT_TEXT: Final = _packet(OPS[INDEX["position_read_10bit"]], _without_data3)
"""The same command with the checksum that its section gives, (byte2 XOR byte3 XOR byte5); note 5 of
A-6 has every byte. They differ unless the id is 0. Source: manual 1.07, A-1-4 (27)."""

REPLIES: Final = tuple(Struct(*_bytes(op.reply)) for op in OPS)
"""The grammar of each reply, empty where a command has none."""


def build(name: str, **fields: Any) -> bytes:
    """Build a command from its fields; ``data1`` and ``data2`` are dictionaries of bit fields."""
    built: bytes = COMMANDS[INDEX[name]].build({"body": {"value": fields}})
    return built


INSTRUCTIONS: Final[Mapping[int, str]] = MappingProxyType(
    {
        0: "none",
        1: "position_control",
        2: "motion_type",
        3: "delay_time",
        4: "dio",
        5: "position_conditional_decision",
        6: "ad_conditional_decision",
        7: "repetition",
        8: "end_of_program",
    }
)
"""Main instructions of a motion. Source: manual 1.07, 3-11 Self-running Motion."""

_COMPARE: Final = MappingProxyType({1: "==", 2: ">", 3: "<", 4: ">=", 5: "<="})

SUB_INSTRUCTIONS: Final[Mapping[int, Mapping[int, str]]] = MappingProxyType(
    {
        2: MappingProxyType({1: "passive", 2: "power_down", 3: "wheel_ccw", 4: "wheel_cw"}),
        5: _COMPARE,
        6: _COMPARE,
    }
)
"""Sub-instructions by main instruction, where they are names. Source: as above."""
