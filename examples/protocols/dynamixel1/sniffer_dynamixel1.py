"""ROBOTIS DYNAMIXEL, Protocol 1.0: every packet of both directions, declared once.

    FF FF | ID | LENGTH | INSTRUCTION or ERROR | PARAMETER ... | CHECKSUM

Nothing in a packet tells whether it asks or answers: an error byte may equal an instruction, and a
status packet may be as long as one. What the request before awaits decides; an answer that could be
an instruction as well is marked (``doubt``), and no values are read from it: a controller that goes
on reading a servo that is not there looks the same. Source: ROBOTIS e-Manual, DYNAMIXEL Protocol
1.0: Instruction Packet, Status Packet, Instruction Details.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from construct import (
    Byte,
    Bytes,
    Check,
    Checksum,
    Const,
    FlagsEnum,
    GreedyBytes,
    GreedyRange,
    RawCopy,
    Struct,
    Terminated,
    this,
)

from sniffer.ground.checksums import COMPLEMENT_SUM
from sniffer.ground.registers import RegisterMap
from sniffer.protocols.packets import (
    IF_ALL,
    IF_READ,
    MANY,
    MUST,
    NEVER,
    RELEASES,
    RESETS,
    STAGED,
    Command,
    Member,
    PacketFamily,
)

BROADCAST: Final = 0xFE

PACKET: Final = Struct(
    "header" / Const(b"\xff\xff"),
    "body"
    / RawCopy(
        Struct(
            "servo_id" / Byte * "0..253 a servo, 254 all of them",
            Check(this.servo_id != 255),
            "length" / Byte * "parameters + 2",
            Check(this.length >= 2),
            "code" / Byte * "instruction, or the error byte of a status packet",
            "params" / Bytes(this.length - 2),
        )
    ),
    "checksum" / Checksum(Byte, COMPLEMENT_SUM, this.body.data),
)

STATUS: Final = Struct(
    "error"
    / FlagsEnum(
        Byte,
        input_voltage=1 << 0,
        angle_limit=1 << 1,
        overheating=1 << 2,
        range=1 << 3,
        checksum=1 << 4,
        overload=1 << 5,
        instruction=1 << 6,
    ),
    "data" / GreedyBytes,
)

EMPTY: Final = Struct(Terminated)
READ: Final = Struct("address" / Byte, "length" / Byte, Terminated)
WRITE: Final = Struct("address" / Byte, "data" / GreedyBytes, Check(this.data))
SYNC_WRITE: Final = Struct(
    "address" / Byte,
    "length" / Byte * "bytes of each servo",
    Check(this.length >= 1),
    "targets" / GreedyRange(Struct("servo_id" / Byte, "data" / Bytes(this._.length))),
    Check(this.targets),
    Terminated,
)
BULK_READ: Final = Struct(
    Const(b"\x00"),
    "targets" / GreedyRange(Struct("length" / Byte, "servo_id" / Byte, "address" / Byte)),
    Check(this.targets),
    Terminated,
)

FAMILY: Final = PacketFamily(
    name="dynamixel1",
    title="ROBOTIS DYNAMIXEL (Protocol 1.0)",
    bauds=(9600, 19200, 57600, 115200, 200000, 250000, 400000, 500000, 1000000, 2000000, 3000000),
    baud=57600,
    packet=PACKET,
    # Replies follow the Status Return Level (0: ping only, 1: also read, 2: all).
    commands={
        0x01: Command("ping", EMPTY, MUST),
        0x02: Command("read", READ, IF_READ),
        0x03: Command("write", WRITE, IF_ALL),
        0x04: Command("reg_write", WRITE, IF_ALL, STAGED),
        0x05: Command("action", EMPTY, IF_ALL, RELEASES),
        0x06: Command("factory_reset", EMPTY, IF_ALL, RESETS, new_id=(0, 1)),
        0x08: Command("reboot", EMPTY, IF_ALL),
        0x83: Command("sync_write", SYNC_WRITE, NEVER),
        0x92: Command("bulk_read", BULK_READ, NEVER, to_all=MANY),
    },
    feedback=STATUS,
    models=(RegisterMap.from_toml(Path(__file__).with_name("mx-28.toml")),),
    # A status packet comes after the return delay, at most 508 us; a controller's own time-out is
    # longer, and nobody states one.
    window_ns=10_000_000,
    # Who asks anew does so later than this, and what he asks may fit as the answer that is missing.
    tail_ns=20_000_000,  # above the 16 ms for which adapters hold bytes
    certain=0x80,  # bit 7 of an error byte is always 0
    doubt=True,
    silent=(BROADCAST,),
    reports={"angle_limit": "stroke_limit"},
    refusals=1 << 6 | 1 << 4 | 1 << 3,  # instruction, checksum, range
)

PROTOCOL: Final = Member(FAMILY)
