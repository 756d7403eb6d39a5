"""Feetech serial bus servos (STS, SMS, SCS): every packet of both directions, declared once.

    FF FF | ID | LENGTH | INSTRUCTION or ERROR | PARAMETER ... | CHECKSUM

The packets are those of DYNAMIXEL's Protocol 1.0 with a sync read; what differs is the tables, and
that potentiometer servos (SCS) have the high byte of a number first. So there are two of them, and
``--model scs009`` says it where the bus does not. As there, an error byte may equal an instruction:
what the request before awaits decides. Source: Feetech, Communication Protocol User Manual, 1.1
Instruction Package, 1.2 Response Package, 1.3 Instruction Types.
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
            "code" / Byte * "instruction, or the error byte of a response",
            "params" / Bytes(this.length - 2),
        )
    ),
    "checksum" / Checksum(Byte, COMPLEMENT_SUM, this.body.data),
)

RESPONSE: Final = Struct(
    "error"
    / FlagsEnum(
        Byte,
        voltage=1 << 0,
        encoder=1 << 1,
        temperature=1 << 2,
        current=1 << 3,
        overload=1 << 5,
    ),
    "data" / GreedyBytes,
)
"""Source: memory table, address 65: the error byte is the servo's state."""

EMPTY: Final = Struct(Terminated)
READ: Final = Struct("address" / Byte, "length" / Byte, Terminated)
WRITE: Final = Struct("address" / Byte, "data" / GreedyBytes, Check(this.data))


def _several(*data: object) -> Struct:
    """Return the parameters of a command to several servos."""
    return Struct(
        "address" / Byte,
        "length" / Byte * "bytes of each servo",
        Check(this.length >= 1),
        "targets" / GreedyRange(Struct("servo_id" / Byte, *data)),
        Check(this.targets),
        Terminated,
    )


SYNC_READ: Final = _several()
SYNC_WRITE: Final = _several("data" / Bytes(this._.length))

FAMILY: Final = PacketFamily(
    name="feetech",
    title="Feetech serial bus servos (STS, SMS, SCS)",
    bauds=(38400, 57600, 76800, 115200, 128000, 250000, 500000, 1000000),
    baud=1000000,
    packet=PACKET,
    # Reads and pings are always answered, the others by the response level (0: not, 1: all). A ping
    # to all is answered by each, one behind the other: users' programs look for servos so.
    commands={
        0x01: Command("ping", EMPTY, MUST, to_all=MANY),
        0x02: Command("read", READ, MUST),
        0x03: Command("write", WRITE, IF_ALL),
        0x04: Command("reg_write", WRITE, IF_ALL, STAGED),
        0x05: Command("action", EMPTY, IF_ALL, RELEASES),
        0x06: Command("reset", EMPTY, IF_ALL, RESETS),
        0x82: Command("sync_read", SYNC_READ, NEVER, to_all=MANY, each=MUST),
        0x83: Command("sync_write", SYNC_WRITE, NEVER),
    },
    feedback=RESPONSE,
    models=tuple(
        RegisterMap.from_toml(Path(__file__).with_name(f"{model}.toml"))
        for model in ("sts3215", "scs009")
    ),
    # A response comes after the return delay, at most 508 us; a controller's own time-out is
    # longer, and nobody states one.
    window_ns=10_000_000,
    # Who asks anew does so later than this, and what he asks may fit as the answer that is missing.
    tail_ns=20_000_000,  # above the 16 ms for which adapters hold bytes
    certain=0x80,  # bits 6 and 7 of an error byte have no meaning
    doubt=True,
    silent=(BROADCAST,),
    words=("instruction", "error", "response"),
    reports={"voltage": "input_voltage", "temperature": "overheating", "current": "overload"},
)

PROTOCOL: Final = Member(FAMILY)
