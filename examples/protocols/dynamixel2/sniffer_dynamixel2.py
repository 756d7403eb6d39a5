"""ROBOTIS DYNAMIXEL, Protocol 2.0: every packet of both directions, declared once.

    FF FF FD 00 | ID | LENGTH (2) | INSTRUCTION | PARAMETER ... | CRC (2)

In a status packet the instruction is 55 and the first parameter the error. Behind FF FF FD inside a
packet stands one more FD. All numbers have the low byte first.

Source: ROBOTIS e-Manual, DYNAMIXEL Protocol 2.0: Instruction Packet, Status Packet, Packet Process,
Instruction Details. Fast Sync Read and Fast Bulk Read: the same, and open firmware that answers
them (their status packet is read by place, without stuffing).
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from construct import (
    Byte,
    Bytes,
    Check,
    Checksum,
    Const,
    Enum,
    GreedyBytes,
    GreedyRange,
    Int16ul,
    RawCopy,
    Struct,
    Terminated,
    this,
)

from sniffer.ground.crc import Crc16
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

if TYPE_CHECKING:
    import numpy.typing as npt

BROADCAST: Final = 0xFE

MOST: Final = 1024
"""A longer LENGTH is not believed. The manual gives no bound but 16 bits, and a false header would
hold a live bus back for 64 KiB; the control tables end below 1024."""

CRC: Final = Crc16(0x8005)
"""Source: ROBOTIS e-Manual, CRC Calculation. It covers the header, too."""

PACKET: Final = Struct(
    "body"
    / RawCopy(
        Struct(
            "header" / Const(b"\xff\xff\xfd\x00"),
            "servo_id" / Byte * "0..252 a servo, 254 all of them",
            Check((this.servo_id != 255) & (this.servo_id != 253)),
            "length" / Int16ul * "parameters + 3",
            Check((this.length >= 3) & (this.length <= MOST)),
            "code" / Byte * "instruction, 55 in a status packet",
            "params" / Bytes(this.length - 3),
        )
    ),
    "checksum" / Checksum(Int16ul, CRC, this.body.data),
)

STATUS: Final = Struct(
    "code" / Const(b"\x55"),
    "error"
    / Enum(
        Byte,
        result_fail=1,
        instruction=2,
        crc=3,
        data_range=4,
        data_length=5,
        data_limit=6,
        access=7,
    ),
    "data" / GreedyBytes,
)

ALERT: Final = 0x80
"""Error bit 7: the device has a problem, its Hardware Error Status tells which."""


class FdBehindHeader:
    """FF FF FD inside a packet is sent as FF FF FD FD. Source: Packet Process."""

    def plain(self, params: bytes) -> bytes:
        """Return the parameters without what was stuffed in."""
        return params.replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")

    def find(self, data: npt.NDArray[np.uint8]) -> npt.NDArray[np.int64]:
        """Return where stuffed bytes begin; two FD in a row are rare, so they are looked for."""
        found = np.flatnonzero((data[2:-1] == 0xFD) & (data[3:] == 0xFD))
        whole = (data[found] == 0xFF) & (data[found + 1] == 0xFF)
        return found.compress(whole)


EMPTY: Final = Struct(Terminated)
READ: Final = Struct("address" / Int16ul, "length" / Int16ul, Terminated)
WRITE: Final = Struct("address" / Int16ul, "data" / GreedyBytes, Check(this.data))
RESET: Final = Struct("option" / Enum(Byte, all=0xFF, but_id=1, but_id_and_baud=2), Terminated)
CLEAR: Final = Struct("option" / Enum(Byte, turns=1), Const(b"DXL\x22"), Terminated)
BACKUP: Final = Struct("option" / Enum(Byte, store=1, restore=2), Const(b"CTRL"), Terminated)


def _alike(target: Any) -> Any:
    """Return the parameters of a command to several servos that have one address and length."""
    return Struct(
        "address" / Int16ul,
        "length" / Int16ul * "bytes of each servo",
        Check(this.length >= 1),
        "targets" / GreedyRange(target),
        Check(this.targets),
        Terminated,
    )


def _each(*data: Any) -> Any:
    """Return the parameters of one where each servo has its own."""
    target = Struct("servo_id" / Byte, "address" / Int16ul, "length" / Int16ul, *data)
    return Struct("targets" / GreedyRange(target), Check(this.targets), Terminated)


SYNC_READ: Final = _alike(Struct("servo_id" / Byte))
SYNC_WRITE: Final = _alike(Struct("servo_id" / Byte, "data" / Bytes(this._.length)))
BULK_READ: Final = _each()
BULK_WRITE: Final = _each("data" / Bytes(this.length))

FAMILY: Final = PacketFamily(
    name="dynamixel2",
    title="ROBOTIS DYNAMIXEL (Protocol 2.0)",
    bauds=(9600, 57600, 115200, 1000000, 2000000, 3000000, 4000000, 4500000),
    baud=57600,
    packet=PACKET,
    # Replies follow the Status Return Level (0: ping only, 1: also read, 2: all).
    commands={
        0x01: Command("ping", EMPTY, MUST, to_all=MANY, answer=3),
        0x02: Command("read", READ, IF_READ),
        0x03: Command("write", WRITE, IF_ALL),
        0x04: Command("reg_write", WRITE, IF_ALL, STAGED),
        0x05: Command("action", EMPTY, IF_ALL, RELEASES),
        # option FF, and no other with bit 2: the id goes back to 1
        0x06: Command("factory_reset", RESET, IF_ALL, RESETS, new_id=(4, 1)),
        0x08: Command("reboot", EMPTY, IF_ALL),
        0x10: Command("clear", CLEAR, IF_ALL),
        0x20: Command("control_table_backup", BACKUP, IF_ALL),
        0x82: Command("sync_read", SYNC_READ, NEVER, to_all=MANY),
        0x83: Command("sync_write", SYNC_WRITE, NEVER),
        0x8A: Command("fast_sync_read", SYNC_READ, NEVER, to_all=MANY, together=True),
        0x92: Command("bulk_read", BULK_READ, NEVER, to_all=MANY),
        0x93: Command("bulk_write", BULK_WRITE, NEVER),
        0x9A: Command("fast_bulk_read", BULK_READ, NEVER, to_all=MANY, together=True),
    },
    feedback=STATUS,
    models=(RegisterMap.from_toml(Path(__file__).with_name("xm430-w210.toml")),),
    # A status packet comes after the return delay, at most 508 us; a controller's own time-out is
    # longer, and nobody states one.
    window_ns=10_000_000,
    most=MOST,
    silent=(BROADCAST,),
    refusals=0x7F,
    alerts={ALERT: "alert"},
    reports={
        "result_fail": "packet_not_processable",
        "crc": "checksum",
        "data_range": "packet_not_processable",
        "data_length": "packet_not_processable",
        "data_limit": "stroke_limit",
        "access": "packet_not_processable",
    },
    stuffing=FdBehindHeader(),
)

PROTOCOL: Final = Member(FAMILY)
