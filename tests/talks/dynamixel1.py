"""DYNAMIXEL 1.0 talk, labelled: ROBOTIS e-Manual, Protocol 1.0, and the control table of MX-28."""

from __future__ import annotations

from typing import Final

from sniffer.testing import Exchange, Talk
from tests.talks.status_packets import (
    ACTION,
    ALL,
    BULK_READ,
    NAMES,
    PING,
    READ,
    REBOOT,
    REG,
    RESET,
    SYNC_WRITE,
    WRITE,
    ByAddress,
    flags,
    packet,
)

INSTRUCTIONS: Final = NAMES | {RESET: "factory_reset", REBOOT: "reboot", BULK_READ: "bulk_read"}
ERRORS: Final = (
    *("input_voltage", "angle_limit", "overheating", "range", "checksum", "overload"),
    "instruction",
)
HEADER: Final = b"\xff\xff"
SAY: Final = ByAddress(
    "examples/protocols/dynamixel1/mx-28.toml", INSTRUCTIONS, flags(*ERRORS), refusals=0x58
)
read, write, plain, odd = SAY.read, SAY.write, SAY.plain, SAY.odd


def bulk(*targets: tuple[int, int, bytes]) -> Exchange:
    """Read other registers of each servo; they answer one after the other."""
    params = b"\0" + b"".join(bytes([len(data), servo, at]) for servo, at, data in targets)
    return SAY.several(BULK_READ, params, *((who, at, 0, data) for who, at, data in targets))


READS: Final = [
    *SAY.table(),
    *(read(who, 0x24, b"\x10\x02") for who in (1, 2, 3)),
    *(read(who, 0x2B, b"\x20") for who in (1, 2)),
    *(read(1, 0x24, b"\x10\x02\x05", 1 << bit) for bit in range(7)),
    *(read(1, 0x24, b"\x10\x02", status) for status in (READ, WRITE, REG)),
    *(read(2, 0x24, b"\x10\x02\x00\x01", status) for status in (PING, ACTION, RESET, REBOOT)),
    read(1, 0x00, bytes(253)),
    *SAY.like_packets(0x1E, HEADER),
    read(1, 0x1E, b"\xfa\x00\x00"),
    SAY.read_failed(1, 0x24, 2, 8),
    SAY.read_failed(2, 0x24, 2, 0x20),
]
WRITES: Final = [
    *(write(who, 0x1E, b"\x10\x02", code=code) for who in (1, 2, 3) for code in (WRITE, REG)),
    write(1, 0x1E, b"\x10"),
    write(1, 0x1E, b"\x10\x02\x05"),
    *(write(1, 0x1E, b"\x10\x02", status) for status in (0x20, 0x08, 0x40, 1, 5, 6)),
    SAY.told(ALL, 0x1E, b"\x10\x02"),
    # over the id, over the return level, and just before and behind them
    write(1, 0x03, b"\x05", by=5),
    write(1, 0x03, b"\x05"),
    write(1, 0x02, b"\x09"),
    write(1, 0x04, b"\x22"),
    write(1, 0x10, b"\x02"),
    write(1, 0x0E, b"\x00\x02"),
    write(1, 0x11, b"\x24"),
    SAY.sync_write(0x1E, (1, b"\x10\x02"), (2, b"\x20\x03")),
    SAY.sync_write(0x1E, (1, b"\x10\x02")),
    bulk((1, 0x1E, b"\x10\x02"), (2, 0x24, b"\x20\x03\x01")),
    bulk((1, 0x1E, b"\x10\x02")),
]
OTHERS: Final = [
    *(plain(who, code) for who in (1, 2) for code in (PING, ACTION, REBOOT)),
    plain(2, RESET, by=1),
    plain(3, RESET),
    SAY.to_all(RESET),
    SAY.to_all(ACTION),
    odd(REG, b"\x1e\x10"),
    odd(SYNC_WRITE, b"\x1e\x02\x01\x10", ALL),
    odd(SYNC_WRITE, b"\x1e\x02\x01\x10\x02\x02", ALL),
    odd(BULK_READ, b"\x00\x02\x01", ALL),
    odd(BULK_READ, b"\x00\x02\x01\x1e\x02", ALL),
    Exchange("unknown_e5", packet(1, 0xE5, b"\x01"), (packet(1, 0),), {}, ()),
]


SCENES: Final = [
    [write(1, 0x03, b"\x07", code=REG), plain(1, ACTION, by=7)],
    [write(4, 0x1E, b"\x10\x02"), write(4, 0x10, b"\x01"), SAY.told(4, 0x1E, b"\x10\x02")],
    # a servo of which nobody knows whether it answers more than pings and reads
    *([SAY.told(5, 0x1E, b"\x10\x02", code), read(5, 0x24, b"\x10\x02")] for code in (WRITE, REG)),
    *([SAY.unanswered(5, code)] for code in (ACTION, REBOOT, RESET)),
    [write(6, 0x10, b"\x00"), Exchange("read", packet(6, READ, b"\x24\x02"), (), {})],
]

TALK: Final = Talk(
    [*READS, *WRITES, *OTHERS],
    SCENES,
    # Nothing in a packet tells its direction. A status packet whose error is an instruction that it
    # would do as, is one without the request before it; an instruction that comes instead of the
    # answer, and has its length, is taken for the answer, which states no values then.
    ambiguous={
        "lost, then another: *": 43,
        "answered twice: *": 9,
        "answer from another id: *": 15,
        "answer to another command: *": 18,
        "two in flight: *": 36,
        "answer late: *": 9,
        "answer cut: *": 34,
        "answer damaged: *": 50,
        "request damaged: *": 36,
        "silence inside: *": 82,
    },
    absent={
        "* one byte *": "an instruction that does not fit is a status packet, as far as it tells",
        "a reset that keeps the id": "each gives id 1",
    },
    harmless={
        "sync_write: one address on": "targets are read from the packet, not by the column",
        "action: no other id may answer": "a new id that was staged says which",
    },
)
