"""IRROBOT mightyZAP, "IR protocol": every packet of both directions, declared once.

    FF FF FF | ID | SIZE | COMMAND or ERROR | FACTOR ... | CHECKSUM

Sources: mightyZAP user manual v1.02, (2) Packet Description and (4) Command Example;
12Lf IR Protocol page, sections 1.2 and 2. Multi-byte values are little-endian.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Final

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
from sniffer.ground.registers import load_models
from sniffer.protocols.packets import (
    IF_ALL,
    IF_READ,
    MUST,
    NEVER,
    RELEASES,
    RESETS,
    STAGED,
    Command,
    PacketFamily,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

BROADCAST: Final = 0xFE
"""Moves all servos, answered by none. Source: user manual v1.02, (2) 2. ID."""

STAND_ALONE: Final = 0x00
"""Every servo obeys it, under its own id. Source: user manual v1.02, (2) 2. ID."""

ERRORS: Final[Mapping[int, str]] = MappingProxyType(
    {
        0: "input_voltage",
        1: "stroke_limit",
        2: "overheating",
        3: "range",
        4: "checksum",
        5: "overload",
        6: "instruction",
    }
)
"""Bits of the ERROR byte. Source: user manual v1.02, (2) Feedback Packet, 4. ERROR; the 12Lf page
lists bits 5 and 0 only."""

REFUSALS: Final = 1 << 6 | 1 << 4 | 1 << 3
"""Error bits that say the command was not carried out: instruction, checksum, range."""

HEADER: Final = b"\xff\xff\xff"

PACKET: Final = Struct(
    "header" / Const(HEADER),
    "body"
    / RawCopy(
        Struct(
            "servo_id" / Byte * "0..253 a servo, 254 all of them",
            Check(this.servo_id != 255),
            "size" / Byte * "factors + 2",
            Check(this.size >= 2),
            "code" / Byte * "command, or the error byte of a feedback",
            "factors" / Bytes(this.size - 2),
        )
    ),
    "checksum" / Checksum(Byte, COMPLEMENT_SUM, this.body.data),
)

FEEDBACK: Final = Struct(
    "error" / FlagsEnum(Byte, **{name: 1 << bit for bit, name in ERRORS.items()}),
    "data" / GreedyBytes,
)

EMPTY: Final = Struct(Terminated)
ADDRESS_LENGTH: Final = Struct("address" / Byte, "length" / Byte, Terminated)
ADDRESS_DATA: Final = Struct("address" / Byte, "data" / GreedyBytes, Check(this.data))
OPTION: Final = Struct("option" / FlagsEnum(Byte, servo_id=1, baud_rate=2), Terminated)
SYMMETRIC: Final = Struct(
    "address" / Byte,
    "length" / Byte * "data bytes for each servo",
    Check(this.length >= 1),
    "targets" / GreedyRange(Struct("servo_id" / Byte, "data" / Bytes(this._.length))),
    Check(this.targets),
    Terminated,
)

NEW_ID: Final = (1, 0)
"""Factory reset option bit 0: the servo's id goes back to 0. Source: (4) 6) Factory Reset."""

ECHO, LOAD, STORE, SEND, EXECUTE, FACTORY_RESET = 0xF1, 0xF2, 0xF3, 0xF4, 0xF5, 0xF6
RESTART, SDK_FACTORY_RESET, SYMMETRIC_STORE = 0xF8, 0xF9, 0x73

COMMANDS: Final[Mapping[int, Command]] = MappingProxyType(
    {
        ECHO: Command("echo", EMPTY, MUST),
        LOAD: Command("load_data", ADDRESS_LENGTH, IF_READ),
        STORE: Command("store_data", ADDRESS_DATA, IF_ALL),
        SEND: Command("send_data", ADDRESS_DATA, IF_ALL, STAGED),
        EXECUTE: Command("execution", EMPTY, IF_ALL, RELEASES),
        FACTORY_RESET: Command("factory_reset", OPTION, IF_ALL, RESETS, NEW_ID),
        RESTART: Command("restart", EMPTY, IF_ALL),
        # the vendor's own software development kit sends this one; no manual has it
        SDK_FACTORY_RESET: Command("mightyzap_factory_reset", OPTION, IF_ALL, RESETS, NEW_ID),
        SYMMETRIC_STORE: Command("symmetric_store", SYMMETRIC, NEVER),
    }
)
"""Command codes. Replies follow the Feedback Return Mode (0: echo only, 1: also load data, 2: all).
Source: user manual v1.02, (2) 4. COMMAND, and (5) 8) Feedback Return Mode."""

OPTION_ID: Final = NEW_ID[0]

WINDOW_NS: Final = 10_000_000
"""Return delay is at most 255 us (user manual v1.02, Data Map 0x05); the vendor's guide asks
controllers to leave 10 ms around a read, so an answer later than that is late."""

FAMILY: Final = PacketFamily(
    name="mightyzap",
    title="IRROBOT mightyZAP (IR protocol)",
    bauds=(9600, 19200, 38400, 57600, 115200, 200000, 250000, 400000),
    baud=57600,
    packet=PACKET,
    commands=COMMANDS,
    feedback=FEEDBACK,
    models=load_models("mightyzap-l12", "mightyzap-12lf"),
    window_ns=WINDOW_NS,
    tail_ns=100_000_000,  # clients give up after 20 to 100 ms
    certain=0x80,  # bit 7 of an error byte is always 0
    begins=True,
    silent=(BROADCAST,),
    anyone=(STAND_ALONE,),
    refusals=REFUSALS,
    words=("command", "error", "feedback"),
)
"""The id and the feedback return mode, writes of which change who answers and what is answered,
stand where the register tables say so by ``effect``."""

MODELS: Final = FAMILY.models
