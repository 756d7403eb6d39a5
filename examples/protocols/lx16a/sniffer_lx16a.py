"""LewanSoul and Hiwonder LX bus servos: every packet of both directions, declared once.

    55 55 | ID | LENGTH | COMMAND | PARAMETER ... | CHECKSUM

An answer has the command of its request; that it is one, only the count of its parameters tells: a
read has none. A command is about one thing, no packet names an address: those of the table are the
number of the command that writes it, or else reads it, times 16. Source: LewanSoul Bus Servo
Communication Protocol: 3 (packet), 4, Table 2 (commands), Table 4 (what is returned).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from construct import (
    Byte,
    Bytes,
    Check,
    Checksum,
    Const,
    Enum,
    GreedyBytes,
    Int16ul,
    RawCopy,
    Struct,
    Terminated,
    this,
)

from sniffer.ground.checksums import COMPLEMENT_SUM
from sniffer.ground.registers import RegisterMap
from sniffer.protocols.packets import (
    MANY,
    MUST,
    NEVER,
    RELEASES,
    STAGED,
    Command,
    Member,
    PacketFamily,
)

BROADCAST: Final = 0xFE
LONGEST: Final = 7  # LENGTH of the longest command, and of the longest answer

PACKET: Final = Struct(
    "header" / Const(b"\x55\x55"),
    "body"
    / RawCopy(
        Struct(
            "servo_id" / Byte * "0..253 a servo, 254 all of them",
            Check(this.servo_id != 255),
            "length" / Byte * "parameters + 3",
            Check((this.length >= 3) & (this.length <= LONGEST)),
            "code" / Byte * "command; an answer has that of its request",
            "params" / Bytes(this.length - 3),
        )
    ),
    "checksum" / Checksum(Byte, COMPLEMENT_SUM, this.body.data),
)

NONE: Final = Struct(Terminated)
MOVE: Final = Struct("position" / Int16ul, "time_ms" / Int16ul, Terminated)
LIMITS: Final = Struct("least" / Int16ul, "most" / Int16ul, Terminated)
MODE: Final = Struct(
    "mode" / Enum(Byte, servo=0, motor=1), "zero" / Byte, "speed" / Int16ul, Terminated
)


def _byte(name: str) -> Any:
    """Return parameters of one byte."""
    return Struct(name / Byte, Terminated)


def _read(name: str, about: int, count: int, to_all: int = NEVER) -> Command:
    """Return a command that asks for ``count`` bytes of what ``about`` writes."""
    return Command(name, NONE, MUST, to_all=to_all, answer=count, at=about * 16)


def _write(name: str, params: Any, about: int, effect: int = 0) -> Command:
    """Return a command that nobody answers."""
    return Command(name, params, NEVER, effect, at=about * 16)


FAMILY: Final = PacketFamily(
    name="lx16a",
    title="LewanSoul and Hiwonder LX bus servos",
    bauds=(115200,),
    baud=115200,
    packet=PACKET,
    commands={
        1: _write("move_time_write", MOVE, 1),
        2: _read("move_time_read", 1, 4),
        7: _write("move_time_wait_write", MOVE, 1, STAGED),
        8: _read("move_time_wait_read", 8, 4),
        11: Command("move_start", NONE, NEVER, RELEASES),
        12: Command("move_stop", NONE, NEVER),
        13: _write("id_write", _byte("new_id"), 13),
        14: _read("id_read", 13, 1, to_all=MANY),
        17: _write("angle_offset_adjust", _byte("offset"), 17),
        18: Command("angle_offset_write", NONE, NEVER),
        19: _read("angle_offset_read", 17, 1),
        20: _write("angle_limit_write", LIMITS, 20),
        21: _read("angle_limit_read", 20, 4),
        22: _write("vin_limit_write", LIMITS, 22),
        23: _read("vin_limit_read", 22, 4),
        24: _write("temp_max_limit_write", _byte("limit_degc"), 24),
        25: _read("temp_max_limit_read", 24, 1),
        26: _read("temp_read", 26, 1),
        27: _read("vin_read", 27, 2),
        28: _read("pos_read", 28, 2),
        29: _write("servo_or_motor_mode_write", MODE, 29),
        30: _read("servo_or_motor_mode_read", 29, 4),
        31: _write("load_or_unload_write", _byte("load"), 31),
        32: _read("load_or_unload_read", 31, 1),
        33: _write("led_ctrl_write", _byte("led"), 33),
        34: _read("led_ctrl_read", 33, 1),
        35: _write("led_error_write", _byte("alarms"), 35),
        36: _read("led_error_read", 35, 1),
    },
    feedback=Struct("data" / GreedyBytes),
    echoes=True,
    models=(RegisterMap.from_toml(Path(__file__).with_name("lx-16a.toml")),),
    # No source states how long an answer may take: "immediately". A client waits 30 ms.
    window_ns=30_000_000,
    most=LONGEST,
    silent=(BROADCAST,),
)

PROTOCOL: Final = Member(FAMILY)
