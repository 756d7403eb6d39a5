"""IRROBOT mightyZAP, "IR protocol": every packet of both directions, declared once.

    FF FF FF | ID | SIZE | COMMAND or ERROR | FACTOR ... | CHECKSUM

Sources: mightyZAP user manual v1.02, (2) Packet Description and (4) Command Example;
12Lf IR Protocol page, sections 1.2 and 2. Multi-byte values are little-endian.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

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
    Renamed,
    Struct,
    Terminated,
    this,
)

from sniffer.ground.checksums import COMPLEMENT_SUM
from sniffer.ground.model import IF_ALL, IF_READ, MUST, NEVER
from sniffer.ground.registers import load_models

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

LONGEST: Final = 5 + 255
"""Bytes of the longest packet: header, id, SIZE and what that can count."""

MODELS: Final = load_models("mightyzap-l12", "mightyzap-12lf")

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

EMPTY: Final = Struct(Terminated)
ADDRESS_DATA: Final = Struct("address" / Byte, "data" / GreedyBytes, Check(lambda x: x.data))
FEEDBACK: Final = Struct(
    "error" / FlagsEnum(Byte, **{name: 1 << bit for bit, name in ERRORS.items()}),
    "data" / GreedyBytes,
)
SYMMETRIC: Final = Struct(
    "address" / Byte,
    "length" / Byte * "data bytes for each servo",
    Check(this.length >= 1),
    "targets" / GreedyRange(Struct("servo_id" / Byte, "data" / Bytes(this._.length))),
    Check(lambda x: x.targets),
    Terminated,
)


@dataclass(frozen=True, slots=True)
class Command:
    """One command: its factors, and whether a servo answers it."""

    name: str
    factors: Any
    reply: int


COMMANDS: Final[Mapping[int, Command]] = MappingProxyType(
    {
        0xF1: Command("echo", EMPTY, MUST),
        0xF2: Command("load_data", Struct("address" / Byte, "length" / Byte, Terminated), IF_READ),
        0xF3: Command("store_data", ADDRESS_DATA, IF_ALL),
        0xF4: Command("send_data", ADDRESS_DATA, IF_ALL),
        0xF5: Command("execution", EMPTY, IF_ALL),
        0xF6: Command("factory_reset", Struct("option" / Byte, Terminated), IF_ALL),
        0xF8: Command("restart", EMPTY, IF_ALL),
        # the vendor's own software development kit sends this one; no manual has it
        0xF9: Command("mightyzap_factory_reset", Struct("option" / Byte, Terminated), IF_ALL),
        0x73: Command("symmetric_store", SYMMETRIC, NEVER),
    }
)
"""Command codes. Replies follow the Feedback Return Mode (0: echo only, 1: also load data, 2: all).
Source: user manual v1.02, (2) 4. COMMAND, and (5) 8) Feedback Return Mode."""


def leading(code: int, factors: bytes) -> dict[str, int]:
    """Return the one-byte fields that a command's factors begin with, as far as there are bytes.

    They can be read although the body as a whole is not as the grammar has it.
    """
    names: list[str] = []
    for con in COMMANDS[code].factors.subcons if code in COMMANDS else ():
        name, inner = con.name, con
        while isinstance(inner, Renamed):
            inner = inner.subcon
        if inner is not Byte:
            break
        names.append(name)
    return dict(zip(names, factors, strict=False))


ECHO, LOAD, STORE, SEND, EXECUTE, FACTORY_RESET = 0xF1, 0xF2, 0xF3, 0xF4, 0xF5, 0xF6
SDK_FACTORY_RESET, SYMMETRIC_STORE = 0xF9, 0x73
WRITES: Final = (STORE, SEND)
OPTION_ID: Final = 1
"""Factory reset option bit 0: the servo's id goes back to 0. Source: (4) 6) Factory Reset."""

FEEDBACK_REGISTER: Final = 0x10
"""Address of the feedback return mode: a write of it is answered under the old mode or under the
new one, the manual does not say. Source: user manual v1.02, (3) Data Map."""

ID_REGISTER: Final = 3
"""Address of the servo id. Source: user manual v1.02, (3) Data Map."""
