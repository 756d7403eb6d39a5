"""RS30x talk, labelled: RS305CR manual, 4. packet format, 4.2 memory map, table 4.1 to 4.3."""

from __future__ import annotations

from typing import Final

from sniffer.protocols.rs30x.grammar import OPS, REPLIES
from sniffer.testing import Exchange, Label, Talk
from tests.streams.rs30x import long, packet, reset_with_data, returned, write
from tests.talks import blocks, due, halves, of_vectors, stated

MODEL: Final = "rs305cr"
EVERYONE: Final = 255
ACK, NACK = b"\x07", b"\x08"
ERRORS: Final = {
    1: "packet_not_processable",
    3: "flash_write_error",
    5: "temperature_alarm",
    7: "temperature_limit",
}
HEADER: Final = b"\xfa\xaf"


def _errors(status: int) -> tuple[str, ...]:
    return tuple(name for bit, name in ERRORS.items() if status >> bit & 1)


def read(who: int, address: int, data: bytes, status: int = 0) -> Exchange:
    """Read any registers (reply nibble F)."""
    answer = returned(who, address, data, status)
    labels = stated(MODEL, address, data)
    return Exchange(
        "read", packet(who, 0x0F, address, len(data)), (answer,), labels, _errors(status)
    )


def block(who: int, nibble: int) -> Exchange:
    """Read the registers that a reply nibble names."""
    named = REPLIES[nibble]
    data = bytes((named.address + k) * 7 % 251 for k in range(named.length))
    answer = returned(who, named.address, data)
    return Exchange("read", packet(who, nibble), (answer,), stated(MODEL, named.address, data), ())


def told(who: int, address: int, data: bytes, answer: bytes = ACK) -> Exchange:
    """Write registers and have it acknowledged, or refused."""
    labels = stated(MODEL, address, data) if answer == ACK else {}
    errors = () if answer == ACK else ("nack",)
    return Exchange("write", write(who, address, data, 1), (answer,), labels, errors)


def back(who: int, address: int, data: bytes, status: int = 0, by: int | None = None) -> Exchange:
    """Write registers and have the present ones returned (reply nibble 9)."""
    now = bytes(range(18))
    servo = who if by is None else by
    labels: dict[Label, int] = dict(stated(MODEL, 42, now, servo))
    if not status & 0x0A:
        labels |= stated(MODEL, address, data)
    answer = returned(servo, 42, now, status)
    return Exchange("write", write(who, address, data, 9), (answer,), labels, _errors(status))


def silent(who: int, address: int, data: bytes) -> Exchange:
    """Write registers without a reply."""
    return Exchange("write", write(who, address, data), (), stated(MODEL, address, data))


def spread(address: int, *servos: tuple[int, bytes]) -> Exchange:
    """Write registers of several servos."""
    labels: dict[Label, int] = {}
    for servo, data in servos:
        labels |= stated(MODEL, address, data, servo)
    return Exchange("long_write", long(address, *servos), (), labels)


def order(name: str, who: int, flags: int) -> Exchange:
    """Say one of the three commands; nobody answers."""
    return Exchange(name, packet(who, flags, 0xFF), (), {})


READS: Final = [
    *(block(who, nibble) for who in (1, 2) for nibble in REPLIES if REPLIES[nibble].address >= 0),
    *(read(1, address, bytes(k * 7 % 251 for k in range(n))) for address, n in blocks(MODEL)),
    *(read(1, address, bytes(k * 5 % 251 for k in range(n))) for address, n in halves(MODEL)),
    *(read(who, 42, b"\x10\x02") for who in (1, 2, 127)),
    *(read(1, 42, b"\x10\x02", 1 << bit) for bit in ERRORS),
    read(1, 42, b""),
    read(2, 36, b"\x01"),
    read(1, 0, bytes(k * 3 % 256 for k in range(255))),
    read(1, 30, HEADER + b"\x01\x02"),
    read(1, 30, b"\x01" + HEADER + b"\x01\x02"),
    read(1, 30, b"\x01\x02" + HEADER),
    read(1, 30, packet(1, 9)),
    read(1, 42, bytes([0xFA ^ 1 ^ 42 ^ 2 ^ 1 ^ 0x11, 0x11])),  # its sum is FA
    # what is asked for here no manual defines
    Exchange("read", packet(1, 2), None),
]
WRITES: Final = [
    *(told(who, 30, b"\x10\x02") for who in (1, 2)),
    *(told(who, 30, b"\x10\x02", NACK) for who in (1, 2)),
    *(back(who, 30, b"\x10\x02") for who in (1, 2)),
    *(back(1, 30, b"\x10\x02", status) for status in (0x02, 0x08, 0x80)),
    *(silent(who, 30, b"\x10\x02") for who in (1, 2, EVERYONE)),
    silent(1, 30, b"\x10"),
    silent(1, 30, b"\x10\x02\x32"),
    silent(1, 30, HEADER),
    # over the id, and just before and behind it
    silent(1, 4, b"\x05"),
    back(1, 4, b"\x05", by=5),
    back(1, 4, b"\x05"),
    silent(1, 2, b"\x09\x00"),
    silent(1, 5, b"\x01"),
    spread(30, (1, b"\x10\x02"), (2, b"\x20\x03")),
    spread(30, (1, b"\x10\x02\x32\x00"), (2, b"\x20\x03\x64\x00")),
    spread(36, (1, b"\x01"), (2, b"\x01"), (3, b"\x00")),
    spread(36, (1, b"\x01")),
    spread(30, (1, b"\x10\x02")),
    Exchange("write", packet(1, 0, 30, 2, 2, b"\x10\x02\x20\x03"), None, {}),
]
ORDERS: Final = [
    *(order("flash_write", who, 0x40) for who in (1, 2, EVERYONE)),
    *(order("reboot", who, 0x20) for who in (1, 2, EVERYONE)),
    *(order("factory_reset", who, 0x10) for who in (1, 3, EVERYONE)),
    Exchange("factory_reset", reset_with_data(1), (), {}),
    # one register with the command that follows it (RS301CR manual, No. 6)
    Exchange("flash_write", write(1, 5, b"\x01", 0x40), (), {"reverse": 1}),
    Exchange("reboot", write(1, 5, b"\x01", 0x20), (), {"reverse": 1}),
]

TALK: Final = Talk(
    due([*of_vectors("rs30x"), *READS, *WRITES, *ORDERS], "*"),
    commands=[name for name in OPS.values() if name not in ("return", "ack")],
    # Of data that hold a packet, the packet comes to light where the frame around it breaks.
    # A packet cut before a sum FA takes that from the next header.
    ambiguous={"answer cut: read": 3, "answer damaged: read": 3, "silence inside: read": 8},
    absent={
        "* one byte less": "LENGTH times COUNT is the size; what commands has none to lose",
        "read one byte more": "a read has no data",
        "a scene: staged, then released": "nothing is staged",
    },
)
