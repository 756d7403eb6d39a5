"""LK-TECH, Gyems and MyActuator RMD-L motors on RS-485: every packet of both directions, once.

    3E | COMMAND | ID | LENGTH | SUM of these four | DATA ... | SUM of the data

The second sum is not there where there are no data. An answer has the command of its request: the
count of its data tells it, and where it has none, or those that were sent, it is the request once
more. A goal is answered by what the motor measured. No packet names an address: those of the table
are the number of the command times 16. Sources: README.md beside this file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from construct import (
    Byte,
    Bytes,
    Check,
    Const,
    Enum,
    GreedyBytes,
    Int16sl,
    Int16ul,
    Int32sl,
    Int32ul,
    Int64sl,
    Struct,
    Terminated,
    this,
)

from sniffer.ground.checksums import SUM8
from sniffer.ground.registers import RegisterMap
from sniffer.protocols.packets import MUST, OPTIONAL, Command, Member, Packet, PacketFamily, Seal

MOST: Final = 64
"""Bytes of data that are believed: the longest that was seen, what a motor is called, has 58."""

PACKET: Final = Packet(
    "header" / Const(b"\x3e"),
    "code" / Byte * "command; an answer has that of its request",
    "servo_id" / Byte * "1..32",
    Check((this.servo_id >= 1) & (this.servo_id <= 32)),
    "length" / Byte * "bytes of data",
    Check(this.length <= MOST),
    "head_sum" / Seal(Byte, SUM8, "header", "code", "servo_id", "length"),
    "data" / Bytes(this.length),
    "data_sum" / Seal(Byte, SUM8, "data", some=True),
)

NONE: Final = Struct(Terminated)
GAINS: Final = Struct(
    "angle_kp" / Byte,
    "angle_ki" / Byte,
    "speed_kp" / Byte,
    "speed_ki" / Byte,
    "current_kp" / Byte,
    "current_ki" / Byte,
    Terminated,
)
SPIN: Final = "spin" / Enum(Byte, clockwise=0, counterclockwise=1)
ANGLE: Final = "angle" / Int16ul * "0.01 degrees"
LIMIT: Final = "most_speed" / Int32ul * "0.01 degrees a second"
STATE: Final = 0x9C0
"""Where the table has temperature, current, speed and encoder, with which goals are answered."""


def _read(name: str, about: int, count: int) -> Command:
    """Return a command that asks for ``count`` bytes of what it is about."""
    return Command(name, NONE, MUST, answer=count, at=about * 16)


def _move(name: str, about: int, *fields: Any) -> Command:
    """Return a command that gives a goal, and is answered by the state."""
    params = Struct(*fields, Terminated)
    return Command(name, params, MUST, answer=7, at=about * 16, answer_at=STATE)


FAMILY: Final = PacketFamily(
    name="lktech",
    title="LK-TECH, Gyems and MyActuator RMD-L motors",
    bauds=(9600, 19200, 57600, 115200, 230400, 460800, 1000000, 2000000),
    baud=115200,
    packet=PACKET,
    commands={
        0x12: Command("read_model", NONE, MUST, answer=58),
        0x19: Command("set_origin", NONE, OPTIONAL),
        0x30: _read("read_pid", 0x30, 6),
        0x31: Command("write_pid_ram", GAINS, MUST, at=0x300, repeats=True),
        0x32: Command("write_pid_rom", GAINS, MUST, at=0x300, repeats=True),
        0x80: Command("motor_off", NONE, MUST, repeats=True),
        0x81: Command("motor_stop", NONE, MUST, repeats=True),
        0x88: Command("motor_run", NONE, MUST, repeats=True),
        0x92: _read("read_multi_turn_angle", 0x92, 8),
        0x94: _read("read_single_turn_angle", 0x94, 4),
        0x9C: _read("read_state", 0x9C, 7),
        0xA1: _move("torque_control", 0xA1, "current" / Int16sl),
        0xA2: _move("speed_control", 0xA2, "speed" / Int32sl * "0.01 degrees a second"),
        0xA3: _move("multi_turn_control", 0xA3, "angle" / Int64sl * "0.01 degrees"),
        0xA4: _move("multi_turn_control_2", 0xA3, "angle" / Int64sl * "0.01 degrees", LIMIT),
        0xA5: _move("single_turn_control", 0xA5, SPIN, ANGLE, Const(b"\0")),
        0xA6: _move("single_turn_control_2", 0xA5, SPIN, ANGLE, Const(b"\0"), LIMIT),
        0xA7: _move("increment_control", 0xA7, "increment" / Int32sl * "0.01 degrees"),
        0xA8: _move("increment_control_2", 0xA7, "increment" / Int32sl * "0.01 degrees", LIMIT),
    },
    feedback=Struct("data" / GreedyBytes),
    echoes=True,
    models=(RegisterMap.from_toml(Path(__file__).with_name("lk-mg.toml")),),
    # No source states how long an answer may take; clients wait 20 ms, and 100 to switch on.
    window_ns=20_000_000,
    most=MOST,
)

PROTOCOL: Final = Member(FAMILY)
