"""Feetech talk, labelled: Communication Protocol User Manual, STS/SMS memory table."""

from __future__ import annotations

from typing import Final

from sniffer.testing import Exchange, Talk
from tests.talks import of_package
from tests.talks.status_packets import (
    ACTION,
    ALL,
    NAMES,
    PING,
    READ,
    REG,
    RESET,
    SYNC_READ,
    SYNC_WRITE,
    WRITE,
    ByAddress,
    flags,
    packet,
)

PACKAGE: Final = "examples/protocols/feetech"
INSTRUCTIONS: Final = NAMES | {RESET: "reset", SYNC_READ: "sync_read"}
ERRORS: Final = ("voltage", "encoder", "temperature", "current", "", "overload")
"""The state of the servo (memory table, address 65): nothing in it says that a write is refused."""
HEADER: Final = b"\xff\xff"


def speaks(model: str) -> ByAddress:
    """Return what is said to servos of one model."""
    return ByAddress(f"{PACKAGE}/{model}.toml", INSTRUCTIONS, flags(*ERRORS))


SAY: Final = speaks("sts3215")
read, write, plain, odd = SAY.read, SAY.write, SAY.plain, SAY.odd
GOAL: Final = b"\x00\x08\x00\x00\xe8\x03"


READS: Final = [
    *SAY.table(),
    *(read(who, 0x38, b"\x10\x02") for who in (1, 2, 3)),
    *(read(who, 0x3F, b"\x20") for who in (1, 2)),
    *(read(1, 0x38, b"\x10\x02\x05", 1 << bit) for bit in (0, 1, 2, 3, 5)),
    *(read(1, 0x38, b"\x10\x02", status) for status in (READ, WRITE, REG)),
    *(read(2, 0x38, b"\x10\x02\x00\x01", status) for status in (PING, ACTION, RESET)),
    read(1, 0x00, bytes(253)),
    *SAY.like_packets(0x2A, HEADER),
    read(1, 0x2A, b"\xfa\x00\x00"),
    SAY.read_failed(1, 0x38, 2, 8),
    SAY.read_failed(2, 0x38, 2, 0x20),
]
WRITES: Final = [
    *(write(who, 0x2A, GOAL, code=code) for who in (1, 2, 3) for code in (WRITE, REG)),
    write(1, 0x2A, b"\x10"),
    write(1, 0x2A, b"\x10\x02\x05"),
    *(write(1, 0x2A, b"\x10\x02", status) for status in (0x20, 0x08, 1, 5, 6)),
    SAY.told(ALL, 0x2A, GOAL),
    # over the id, and just before and behind it
    write(1, 0x05, b"\x07", by=7),
    write(1, 0x05, b"\x07"),
    write(1, 0x04, b"\x09"),
    write(1, 0x06, b"\x01"),
    write(1, 0x08, b"\x01"),
    SAY.sync_write(0x2A, (1, GOAL), (2, GOAL)),
    SAY.sync_write(0x2A, (1, b"\x10\x02")),
    SAY.sync_read(0x38, (1, 0, b"\x10\x02"), (2, 0, b"\x20\x03")),
    SAY.sync_read(0x38, (1, 0, b"\x10\x02")),
    SAY.sync_read(0x3E, (2, 0x21, b"\x79"), (1, 0, b"\x77")),
]
OTHERS: Final = [
    *(plain(who, code) for who in (1, 2) for code in (PING, ACTION, RESET)),
    Exchange("ping", packet(ALL, PING), (packet(1, 0), packet(2, 0)), {}, ()),
    SAY.to_all(RESET),
    SAY.to_all(ACTION),
    odd(REG, b"\x2a\x10"),
    odd(SYNC_WRITE, b"\x2a\x02\x01\x10", ALL),
    odd(SYNC_WRITE, b"\x2a\x02\x01\x10\x02\x02", ALL),
    odd(SYNC_READ, b"\x38\x02", ALL),
    *(
        Exchange("unknown_e5", packet(who, 0xE5, b"\x01"), (packet(who, 0),), {}, ())
        for who in (1, 2)
    ),
]
SCENES: Final = [
    [write(1, 0x05, b"\x07", code=REG), plain(1, ACTION, by=7)],
    # a servo of which nobody knows whether it answers more than pings and reads
    *([SAY.told(4, 0x2A, GOAL, code), read(4, 0x38, b"\x10\x02")] for code in (WRITE, REG)),
    *([SAY.unanswered(4, code)] for code in (ACTION, RESET)),
    # and one that answers those at any level
    [write(5, 0x08, b"\x00"), read(5, 0x38, b"\x10\x02")],
]

TALK: Final = Talk(
    [*of_package(PACKAGE), *READS, *WRITES, *OTHERS],
    SCENES,
    # As with DYNAMIXEL 1.0: nothing in a packet tells its direction.
    ambiguous={
        "lost, then another: *": 39,
        "answered twice: *": 7,
        "answer from another id: *": 6,
        "answer to another command: *": 14,
        "two in flight: *": 28,
        "answer late: *": 7,
        "answer cut: *": 39,
        "answer damaged: *": 63,
        "request damaged: *": 28,
        "silence inside: *": 65,
    },
    absent={
        "a reset that gives a new id": "the manual says nothing of the id",
        "* one byte *": "an instruction that does not fit is a response, as far as it tells",
    },
    harmless={
        "sync_write: one address on": "targets are read from the packet, not by the column",
        "action: no other id may answer": "a new id that was staged says which",
    },
)
