"""CubeMars AK motors in servo mode, on the serial line: every packet of both directions, once.

    02 | LENGTH | COMMAND | PARAMETER ... | CRC high, low | 03

The length counts command and parameters, so does the CRC. No packet names a motor: a line has one.
An answer has the command of its request: the count of its bytes tells it. No packet names an
address: those of the table are the number of the command times 256. Sources: README.md beside
this file. VESC controllers speak the same packets, with other numbers behind some commands.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from construct import (
    Byte,
    Bytes,
    Check,
    Const,
    Enum,
    GreedyBytes,
    Int16ub,
    Int32sb,
    Struct,
    Terminated,
    this,
)

from sniffer.ground.crc import Crc16
from sniffer.ground.registers import RegisterMap
from sniffer.protocols.packets import (
    MUST,
    NEVER,
    OPTIONAL,
    Command,
    Member,
    Packet,
    PacketFamily,
    Seal,
)

MOST: Final = 96
"""Bytes of command and parameters that are believed: the longest answer has 73."""

PACKET: Final = Packet(
    "header" / Const(b"\x02"),
    "length" / Byte * "bytes of command and parameters",
    Check((this.length >= 1) & (this.length <= MOST)),
    "code" / Byte * "command; an answer has that of its request",
    "params" / Bytes(this.length - 1),
    "crc" / Seal(Int16ub, Crc16(0x1021), "code", "params"),
    "end" / Const(b"\x03"),
)

NONE: Final = Struct(Terminated)
ORIGIN: Final = Struct("kept" / Enum(Byte, until_power_off=0, for_good=1), Terminated)
PATH: Final = Struct("angle" / Int32sb, "speed" / Int32sb, "acceleration" / Int32sb, Terminated)


def _goal(name: str, code: int, what: str, unit: str) -> Command:
    """Return a command of one number that nobody answers."""
    return Command(name, Struct(what / Int32sb * unit, Terminated), NEVER, at=code * 256)


FAMILY: Final = PacketFamily(
    name="cubemars",
    title="CubeMars AK motors, servo mode on the serial line",
    bauds=(921600,),
    baud=921600,
    packet=PACKET,
    commands={
        0x04: Command("get_values", NONE, MUST, answer=72, at=0x400),
        0x05: _goal("set_duty", 0x05, "duty", "0.00001"),
        0x06: _goal("set_current", 0x06, "current", "mA"),
        0x07: _goal("set_current_brake", 0x07, "current", "mA"),
        0x08: _goal("set_rpm", 0x08, "speed", "electrical revolutions a minute"),
        0x09: _goal("set_pos", 0x09, "angle", "0.000001 degrees"),
        0x0A: _goal("set_handbrake", 0x0A, "current", "mA"),
        0x0B: Command("set_detect", Struct("what" / Byte, Terminated), NEVER),
        0x16: Command("rotor_position", NONE, NEVER, answer=4, answer_at=0x1600),
        0x14: Command("terminal_command", Struct("data" / GreedyBytes), OPTIONAL),
        0x5B: Command("set_pos_spd", PATH, NEVER, at=0x5B00),
        0x5C: _goal("set_pos_multi", 0x5C, "angle", ""),
        0x5D: _goal("set_pos_single", 0x5D, "angle", ""),
        0x5F: Command("set_origin", ORIGIN, NEVER),
    },
    feedback=Struct("data" / GreedyBytes),
    echoes=True,
    sole_id=0,
    models=(RegisterMap.from_toml(Path(__file__).with_name("ak.toml")),),
    # No source states how long an answer may take; clients wait 100 ms.
    window_ns=100_000_000,
    most=MOST,
    reports={
        "over_voltage": "input_voltage",
        "under_voltage": "input_voltage",
        "over_temp_fet": "overheating",
        "over_temp_motor": "overheating",
        "abs_over_current": "overload",
    },
)

PROTOCOL: Final = Member(FAMILY)
