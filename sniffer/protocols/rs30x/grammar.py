"""Futaba RS30x (RS305CR): every packet of both directions, declared once.

    FA AF | ID | FLAG  | ADDRESS | LENGTH | COUNT | DATA: LENGTH * COUNT bytes | SUM   short, long
    FD DF | ID | FLAGS | ADDRESS | LENGTH | COUNT = 1 | DATA: LENGTH bytes     | SUM   return packet
    07 (ACK) or 08 (NACK), one bare byte, without header and checksum

Source: Futaba RS305CR manual (2021-09), 4. packet format: short, long and return packet. Multi-byte
values are little-endian. What only siblings' manuals or real controllers show is marked so.
"""

from __future__ import annotations

import functools
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from construct import (
    BitStruct,
    Byte,
    Bytes,
    Check,
    Checksum,
    Const,
    Flag,
    GreedyRange,
    Nibble,
    OneOf,
    RawCopy,
    Struct,
    Terminated,
    this,
)

from sniffer.ground.checksums import XOR8
from sniffer.ground.registers import bit_names, load_models

if TYPE_CHECKING:
    from collections.abc import Mapping

MODELS: Final = load_models(
    "rs305cr", "rs204md", "rs301cr", "rs302cd", "rs303mr", "rs304md", "rs405cb", "rs406cb"
)

LONG: Final = 0x00
"""The id of a long packet, which names its servos inside. Source: RS305CR manual, long packet."""

EVERYONE: Final = 0xFF
"""Moves all servos, answered by none. Source: RS305CR manual, short packet, ID."""

HIGHEST_ID: Final = 0x7F
"""Servos are 1 to 127; 128 to 254 are no ids. Source: RS305CR manual, short packet, ID."""

COMMAND_ADDRESS: Final = 0xFF
"""ADDRESS of flash write, reboot and factory reset. Source: RS305CR manual, flag bits 6 to 4."""

MOST_DATA: Final = 254
"""Bytes of LENGTH * COUNT beyond which a request is not believed. The manual gives no bound; a long
packet that sets position and time of 31 servos has 155."""

ID_REGISTER: Final = 4
"""Address of the servo id; a new id holds at once. Source: RS305CR manual, 4.2 No. 4."""

DEFAULT_ID: Final = 1
"""The id of a servo after a factory reset. Source: RS305CR manual, flag bit 4, which says so, and
table 4.5 No. 4."""

ACK_BYTE: Final = 0x07
"""Source: RS305CR manual, flag bits 3 to 0, (3) ACK packet."""

NACK_BYTE: Final = 0x08
"""The RS305CR manual promises a NACK without its value; this one is from a sibling's (RS204MD)."""

NACK: Final = 0x100
"""Status of a NACK: behind the eight bits of a return packet's flags, so that none collides. An ACK
has no status."""

FLASH_BIT, REBOOT_BIT, RESET_BIT = 0x40, 0x20, 0x10
COMMAND_BITS: Final = FLASH_BIT | REBOOT_BIT | RESET_BIT
REPLY_BITS: Final = 0x0F
"""Flag bits of a short packet. Source: RS305CR manual, table 4.1."""

FLAGS: Final = BitStruct(
    "unused" / Flag,
    "flash_write" / Flag,
    "reboot" / Flag,
    "factory_reset" / Flag,
    "reply" / Nibble,
)
"""The FLAG byte of a short packet. Source: RS305CR manual, table 4.1."""

STATUS: Final[Mapping[int, str]] = MappingProxyType(
    {
        1: "packet_not_processable",
        3: "flash_write_error",
        5: "temperature_alarm",
        7: "temperature_limit",
    }
)
"""Bits of a return packet's FLAGS, the others are 0. Source: RS305CR manual, table 4.3."""

REFUSALS: Final = 1 << 1 | 1 << 3 | NACK
"""Status bits that say that the servo did not do what it was told."""


class ReturnForm(NamedTuple):
    """What a reply nibble asks for; address and length are -1 where the packet gives them."""

    name: str
    address: int = -1
    length: int = -1


REPLIES: Final[Mapping[int, ReturnForm]] = MappingProxyType(
    {
        0x1: ReturnForm("ack"),
        0x3: ReturnForm("return_0_29", 0, 30),
        0x5: ReturnForm("return_30_59", 30, 30),
        0x7: ReturnForm("return_20_29", 20, 10),
        0x9: ReturnForm("return_42_59", 42, 18),
        0xB: ReturnForm("return_30_41", 30, 12),
        0xD: ReturnForm("return_60_127", 60, 68),
        0xF: ReturnForm("return_address_length"),
    }
)
"""Flag bits 3 to 0; 0 asks for nothing, the others are not defined. D reads beyond the map's end at
No. 59. Source: RS305CR manual, table 4.2."""

ASKS_ACK, ASKS_ADDRESS = 0x1, 0xF

WRITE, READ, FLASH_WRITE, REBOOT, FACTORY_RESET, LONG_WRITE, RETURN_OP, ACK_OP = range(8)
OPS: Final[Mapping[int, str]] = MappingProxyType(
    {
        WRITE: "write",
        READ: "read",
        FLASH_WRITE: "flash_write",
        REBOOT: "reboot",
        FACTORY_RESET: "factory_reset",
        LONG_WRITE: "long_write",
        RETURN_OP: "return",
        ACK_OP: "ack",
    }
)
"""``return`` is a return packet that nobody asked for; an answer carries its request's name."""

ACK_TOKEN: Final = 1 << 16
"""What the bare byte has in common with its request; returns share address << 8 | length."""

NO_TOKEN: Final = 1 << 17
"""What a request shares with no reply: its nibble is not defined, or zero."""


def _packet(header: bytes, *rest: Any) -> Any:
    """Return the frame that short, long and return packets share."""
    return Struct(
        "header" / Const(header),
        "body"
        / RawCopy(
            Struct(
                "servo_id" / Byte * "1..127 a servo, 0 a long packet, 255 all of them",
                Check((this.servo_id <= HIGHEST_ID) | (this.servo_id == EVERYONE)),
                "flags" / Byte,
                "address" / Byte * "in the memory map",
                "length" / Byte * "bytes of one block",
                "count" / Byte * "blocks",
                *rest,
            )
        ),
        "checksum" / Checksum(Byte, XOR8, this.body.data),
    )


PACKET: Final = _packet(
    b"\xfa\xaf",
    Check(this.length * this.count <= MOST_DATA),
    "data" / Bytes(this.length * this.count),
)
"""Short and long packets."""

RESET_GUARDS: Final = (
    (this.flags & RESET_BIT) != 0,
    this.address == COMMAND_ADDRESS,
    this.length * this.count == 0,
)
RESET_WITH_DATA: Final = _packet(
    b"\xfa\xaf", *(Check(guard) for guard in RESET_GUARDS), "data" / Const(b"\xff")
)
"""Factory reset with the data byte FF that the text asks for although LENGTH * COUNT is 0; the
example has none (then it is a ``PACKET``). Source: RS305CR manual, flag bit 4."""

LOWEST_ID: Final = 1

RETURN_HEADER: Final = b"\xfd\xdf"

RETURN: Final = _packet(
    RETURN_HEADER,
    Check((this.servo_id >= LOWEST_ID) & (this.servo_id <= HIGHEST_ID)),
    Check(this.count == 1),
    "data" / Bytes(this.length),
)
"""Return packet: a servo's own, 1..127; LENGTH counts the data bytes. Source: RS305CR manual,
return packet."""

ACK: Final = Struct("answer" / OneOf(Byte, (ACK_BYTE, NACK_BYTE)) * "07 ACK, 08 NACK")
"""The answer to reply nibble 1."""


def answer_head(servo_id: int, flags: int, address: int, length: int) -> bytes:
    """Return with what the answer to a short packet begins, of a servo without an alarm.

    Source: RS305CR manual, table 4.2 and return packet.
    """
    form = REPLIES.get(flags & REPLY_BITS)
    if form is None:
        return b""
    if flags & REPLY_BITS == ASKS_ACK:
        return bytes((ACK_BYTE,))
    told = (address, length) if form.length < 0 else (form.address, form.length)
    return RETURN_HEADER + bytes((servo_id, 0, *told, 1))


def long_data(length: int) -> Any:
    """Return the grammar of a long packet's data; ``length``, at least 2, is a servo's bytes.

    Source: RS305CR manual, long packet, Length = VID (1) + data.
    """
    return Struct(
        "servos" / GreedyRange(Struct("servo_id" / Byte * "VID", "data" / Bytes(length - 1))),
        Terminated,
    )


def carries_registers(servo_id: Any, op: Any, address: Any, length: Any) -> Any:
    """Tell whether the data behind a command's flag bits are registers that it sets.

    Source: RS301CR/RS302CD manual 1.0, No. 6: flash write and reboot in one packet with the write.
    """
    command = (op == FLASH_WRITE) | (op == REBOOT) | (op == FACTORY_RESET)
    return command & (length > 0) & (address != COMMAND_ADDRESS) & (servo_id != LONG)


def op_of(servo_id: int, flags: int, data: bytes) -> int:
    """Tell what a short or long packet commands, flag bits first."""
    for bit, op in ((FLASH_BIT, FLASH_WRITE), (REBOOT_BIT, REBOOT), (RESET_BIT, FACTORY_RESET)):
        if flags & bit:
            return op
    if flags & REPLY_BITS and not data:
        return READ
    return LONG_WRITE if servo_id == LONG else WRITE


@functools.cache
def flag_names(flags: int) -> tuple[str, ...]:
    """Name what a request's FLAG byte asks for."""
    names = {4: "factory_reset", 5: "reboot", 6: "flash_write"}
    out = bit_names(names, flags & ~REPLY_BITS)
    nibble = flags & REPLY_BITS
    if nibble:
        out.append(REPLIES[nibble].name if nibble in REPLIES else f"undefined_{nibble:x}")
    return tuple(out)


@functools.cache
def status_names(status: int) -> tuple[str, ...]:
    """Name the bits of a return packet's FLAGS, or a NACK."""
    return ("nack",) if status == NACK else tuple(bit_names(STATUS, status))
