"""Makerbase MKS SERVO42D and SERVO57D on RS-485: every packet of both directions, declared once.

    FA | ADDRESS | CODE | DATA ... | CHECKSUM        FB | ADDRESS | CODE | DATA ... | CHECKSUM

There is no length: the code tells how many bytes of data follow, another count in an answer, whose
header is FB. A move is answered at once, and once more when it is done. Source: Makerbase, MKS
SERVO42&57D_RS485 User Manual V1.0.9, Parts 4, 5 and 9 to 11.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from construct import (
    Byte,
    Bytes,
    Const,
    Enum,
    GreedyBytes,
    Int16ub,
    Int32sb,
    Int32ub,
    Struct,
    Terminated,
)

from sniffer.ground.checksums import SUM8
from sniffer.ground.registers import RegisterMap
from sniffer.protocols.packets import (
    BY_CODE,
    IF_ALL,
    MUST,
    RESETS,
    Command,
    Member,
    Packet,
    PacketFamily,
    Seal,
)

BROADCAST: Final = 0

PACKET: Final = Packet(
    "header" / Const(b"\xfa"),
    "servo_id" / Byte * "1..255 a motor, 0 all of them",
    "code" / Byte * "command; an answer has that of its request",
    "params" / Bytes(BY_CODE),
    "checksum" / Seal(Byte, SUM8, "header", "servo_id", "code", "params"),
)

DATA: Final = Struct("data" / GreedyBytes)
RESULT: Final = Struct("result" / Enum(Byte, failed=0, success=1))
MOVED: Final = Struct(
    "result" / Enum(Byte, failed=0, started=1, complete=2, limit_switch=3, synchronous=5)
)

NONE: Final = Struct(Terminated)


def _byte(name: str) -> Any:
    """Return parameters of one byte."""
    return Struct(name / Byte, Terminated)


def _read(name: str, code: int, count: int) -> Command:
    """Return a command that asks for ``count`` bytes of data."""
    return Command(name, NONE, MUST, answer=count, at=code * 16, feedback=DATA)


def _set(name: str, params: Any, code: int) -> Command:
    """Return a command whose parameters are settings, answered by what became of it."""
    return Command(name, params, IF_ALL, at=code * 16, feedback=RESULT)


def _act(name: str, params: Any = NONE) -> Command:
    """Return a command about no register, answered by what became of it."""
    return Command(name, params, IF_ALL, feedback=RESULT)


def _move(name: str, code: int, what: Any) -> Command:
    """Return a command that is answered at once, and once more when the motor is there."""
    params = Struct("speed" / Int16ub * "RPM", "acceleration" / Byte, what, Terminated)
    return Command(name, params, IF_ALL, at=code * 16, feedback=MOVED, later={"result": (2, 3)})


FAMILY: Final = PacketFamily(
    name="mks",
    title="Makerbase MKS SERVO42D and SERVO57D (RS-485)",
    bauds=(9600, 19200, 25000, 38400, 57600, 115200, 256000),
    baud=38400,
    packet=PACKET,
    commands={
        0x30: _read("read_encoder", 0x30, 6),
        0x31: _read("read_axis", 0x31, 6),
        0x32: _read("read_speed", 0x32, 2),
        0x33: _read("read_pulses", 0x33, 4),
        0x35: _read("read_raw_axis", 0x35, 6),
        0x39: _read("read_error", 0x39, 4),
        0x3A: _read("read_enable", 0x3A, 1),
        0x3B: _read("read_zero_status", 0x3B, 2),
        0x3D: _act("release_stall"),
        0x3E: _read("read_stall", 0x3E, 1),
        0x3F: Command("restore", NONE, IF_ALL, RESETS, new_id=(0, 1), feedback=RESULT),
        0x41: _act("restart"),
        0x80: _act("calibrate", _byte("zero")),
        0x82: _set("set_mode", _byte("mode"), 0x82),
        0x84: _set("set_subdivisions", _byte("subdivisions"), 0x84),
        0x85: _set("set_en_level", _byte("level"), 0x85),
        0x86: _set("set_direction", _byte("direction"), 0x86),
        0x88: _set("set_stall_protection", _byte("enable"), 0x88),
        0x8A: _set("set_baud", _byte("baud"), 0x8A),
        0x8B: _set("set_address", _byte("address_to_be"), 0x8B),
        0x8C: _set("set_respond", Struct("respond" / Byte, "active" / Byte, Terminated), 0x8C),
        0x92: _act("set_zero"),
        0x9B: _set("set_holding_current", _byte("ratio"), 0x9B),
        0x9D: _set(
            "set_position_protection",
            Struct("enable" / Byte, "time" / Int16ub, "errors" / Int16ub, Terminated),
            0x9D,
        ),
        0xF1: _read("read_status", 0xF1, 1),
        0xF3: _set("enable", _byte("enable"), 0xF3),
        0xF4: _move("move_axis_by", 0xF4, "axis" / Int32sb),
        0xF5: _move("move_axis_to", 0xF5, "axis" / Int32sb),
        0xF6: Command(
            "run",
            Struct("speed" / Int16ub * "bit 15: CW", "acceleration" / Byte, Terminated),
            IF_ALL,
            at=0xF60,
            feedback=MOVED,
            later={"result": (2,)},
        ),
        0xF7: _act("emergency_stop"),
        0xFD: _move("move_pulses_by", 0xFD, "pulses" / Int32ub),
        0xFE: _move("move_pulses_to", 0xFE, "pulses" / Int32sb),
    },
    feedback=RESULT,
    answer_header=b"\xfb",
    models=(RegisterMap.from_toml(Path(__file__).with_name("servo42d.toml")),),
    # No source states how long an answer may take.
    window_ns=20_000_000,
    silent=(BROADCAST,),
    reports={"stalled": "blocked"},
)

PROTOCOL: Final = Member(FAMILY)
