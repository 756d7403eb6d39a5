"""HerkuleX talk, labelled: DRS-0101 user manual, commands and register maps, and the table."""

from __future__ import annotations

from functools import reduce
from operator import xor
from typing import Final

from sniffer.testing import Exchange, Label, Talk
from tests.talks import due, halves, stated, table, unanswered

MODEL: Final = "examples/protocols/herkulex/drs-0101.toml"
EEP: Final = 0x100
EEP_WRITE, EEP_READ, RAM_WRITE, RAM_READ, I_JOG, S_JOG, STAT, ROLLBACK, REBOOT = range(1, 10)
NAMES: Final = (
    *("eep_write", "eep_read", "ram_write", "ram_read", "i_jog", "s_jog"),
    *("stat", "rollback", "reboot"),
)
ERRORS: Final = (
    *("input_voltage", "allowed_pot", "temperature", "invalid_packet", "overload"),
    *("driver_fault", "eep_distorted"),
)
REFUSED: Final = 8
HEADER: Final = b"\xff\xff"
MOST: Final = 223
JOG: Final = b"\x00\x02\x04"


def packet(who: int, code: int, data: bytes = b"") -> bytes:
    """Put a packet together: both checksums stand before the data."""
    head = bytes([len(data) + 7, who, code])
    one = reduce(xor, head + data) & 0xFE
    return HEADER + head + bytes([one, ~one & 0xFE]) + data


def ack(who: int, code: int, data: bytes = b"", status: int = 0, detail: int = 0x40) -> bytes:
    """Put an answer together."""
    return packet(who, code + 0x40, data + bytes([status, detail]))


def _errors(status: int) -> tuple[str, ...]:
    return tuple(name for bit, name in enumerate(ERRORS) if status >> bit & 1)


def _space(address: int, eep: int, ram: int) -> tuple[int, int]:
    """Return the command for an address of the table, and the address on the wire."""
    return (eep, address - EEP) if address >= EEP else (ram, address)


def read(who: int, address: int, data: bytes, status: int = 0) -> Exchange:
    """Read registers; the answer repeats address and length."""
    code, at = _space(address, EEP_READ, RAM_READ)
    span = bytes([at, len(data)])
    answer = ack(who, code, span + data, status)
    labels = stated(MODEL, address, data)
    return Exchange(NAMES[code - 1], packet(who, code, span), (answer,), labels, _errors(status))


def write(
    who: int, address: int, data: bytes, status: int = 0, *, to_all: bool = False, by: int = -1
) -> Exchange:
    """Write registers; what is refused does not become true."""
    code, at = _space(address, EEP_WRITE, RAM_WRITE)
    labels = {} if status & REFUSED else stated(MODEL, address, data)
    answer = (ack(who if by < 0 else by, code, b"", status),)
    request = packet(who, code, bytes([at, len(data)]) + data)
    told = () if to_all else answer
    return Exchange(NAMES[code - 1], request, told, labels, _errors(status) if told else None)


def say(code: int, data: bytes = b"", who: int = 1, status: int = 0) -> Exchange:
    """Say a command without registers."""
    answer = (ack(who, code, b"", status),)
    return Exchange(NAMES[code - 1], packet(who, code, data), answer, {}, _errors(status))


def jog(code: int, ids: tuple[int, ...], who: int = 254) -> Exchange:
    """Move servos, each as it is told."""
    each = {I_JOG: b"\x3c", S_JOG: b""}[code]
    data = (b"" if each else b"\x3c") + b"".join(JOG + bytes([i]) + each for i in ids)
    labels: dict[Label, int] = {}
    for i in ids:
        labels[i, "jog"], labels[i, "jog_set"] = 512, 4
        if each:
            labels[i, "jog_play_time"] = 60
    answers = () if who == 254 else (ack(who, code),)
    return Exchange(NAMES[code - 1], packet(who, code, data), answers, labels)


def odd(code: int, data: bytes) -> Exchange:
    """Say a command with too few or too many bytes."""
    return Exchange(NAMES[code - 1], packet(1, code, data), None)


def _numbers(n: int, first: int = 1) -> bytes:
    return bytes((first + 7 * k) % 126 for k in range(n))


ALL_OF: Final = [r for r in table(MODEL) if r.address < 0x200]
READS: Final = [
    *(read(1, r.address, _numbers(r.width, k)) for k, r in enumerate(ALL_OF)),
    *(read(2, a, _numbers(n, a)) for a, n in halves(MODEL) if a + n <= 0x150),
    read(2, 0x3A, b"\x00\x02"),
    read(2, 0x36, _numbers(10)),
    read(1, 0, b""),
    read(2, EEP + 6, b"\x02"),
    read(2, EEP + 0x27, b"\x03\x04"),
    read(1, 0x3A, HEADER),
    read(1, 0x3A, b"\x01" + HEADER + b"\x01"),
    read(2, 0x3A, b"\x01" + HEADER),
    read(2, 0x3A, HEADER + b"\x01\x02"),
    read(1, 0x20, packet(2, RAM_READ, b"\x3a\x02") + b"\x01"),
    read(1, 0, _numbers(MOST - 11)),
    *(read(1, 0x36, b"\x70", 1 << bit) for bit in range(7)),
]
WRITES: Final = [
    write(1, 0x34, b"\x60"),
    write(2, 0x35, b"\x01"),
    write(1, 0x34, b"\x60", REFUSED),
    write(1, 0x30, b"\x00\x00"),
    write(1, EEP + 0x1E, b"\xc8\x00\xe8\x03"),
    write(2, EEP + 6, b"\x05"),
    write(254, 0x34, b"\x60", to_all=True),
    write(254, EEP + 4, b"\x10", to_all=True),
    write(1, 0, b"\x05", by=5),
    write(1, 0, b"\x06\x02\x7f", by=6),
    write(1, 1, b"\x02"),
    write(2, 2, b"\x35\x7f"),
    write(2, 0x15, b"\x03"),
]
OTHERS: Final = [
    *(jog(code, ids) for code in (I_JOG, S_JOG) for ids in ((1,), (1, 2), (3, 1, 2))),
    *(jog(code, (1,), 1) for code in (I_JOG, S_JOG)),
    say(STAT),
    say(STAT, who=2, status=16),
    Exchange("stat", packet(254, STAT), (ack(1, STAT), ack(2, STAT)), {}, ()),
    *(say(ROLLBACK, b"\x01\x01", who) for who in (1, 2)),
    *(say(REBOOT, who=who) for who in (1, 2)),
    Exchange("unknown_2a", packet(1, 0x2A, b"\x01"), None),
]
ODD: Final = [
    *(odd(code, data) for code in (EEP_WRITE, RAM_WRITE) for data in (b"\x34\x01", b"\x34\x00")),
    *(odd(code, b"\x34\x01\x60\x60") for code in (EEP_WRITE, RAM_WRITE)),
    *(odd(code, data) for code in (EEP_READ, RAM_READ) for data in (b"\x34", b"\x34\x01\x01")),
    *(
        odd(code, data)
        for code in (I_JOG, S_JOG)
        for data in (JOG, JOG + b"\x01", JOG + b"\x01<\x01")
    ),
    *(odd(code, b"\x01") for code in (STAT, REBOOT, ROLLBACK)),
    odd(ROLLBACK, b"\x01\x01\x01"),
]

TALK: Final = Talk(
    due([*READS, *WRITES, *OTHERS, *ODD], "*_read", "stat"),
    unanswered([*WRITES, *OTHERS], "*_write", "*_jog", "re*", "rollback"),
    # A packet within the data of one that is torn is a packet.
    ambiguous={
        "answer cut: ram_read": 2,
        "answer damaged: ram_read": 2,
        "silence inside: ram_read": 10,
    },
    absent={
        "stat one byte less": "it has no data",
        "reboot one byte less": "it has no data",
        "a frame that ends as the header begins": "flags end an answer, bit 7 unused",
        "a status like *": "the code tells an answer, and the state stands elsewhere",
        "an answer that reads as a command": "the code tells an answer",
        "a scene: staged, then released": "nothing is staged",
        "a reset that gives a new id": "which id is kept in EEP, reboot does not say",
        "jog*, * byte": "a JOG is never about half a number",
    },
    harmless={
        "i_jog: one address on": "the bytes of targets are read from the packet",
        "s_jog: one address on": "the bytes of targets are read from the packet",
    },
)
