"""mightyZAP talk, labelled: user manual v1.02, (2) packets, (3) data map, (4) examples."""

from __future__ import annotations

from typing import Final

from sniffer.protocols.mightyzap.grammar import COMMANDS
from sniffer.testing import Exchange, Label, Talk
from tests.streams.mightyzap import packet
from tests.talks import blocks, due, halves, of_vectors, stated, unanswered

MODEL: Final = "mightyzap-l12"
ECHO, LOAD, STORE, SEND, EXECUTE, RESET, RESTART, SDK_RESET, SYNC = (
    *(0xF1, 0xF2, 0xF3, 0xF4, 0xF5, 0xF6, 0xF8, 0xF9, 0x73),
)
ERRORS: Final = (
    *("input_voltage", "stroke_limit", "overheating", "range", "checksum", "overload"),
    "instruction",
)


def _errors(status: int) -> tuple[str, ...]:
    return tuple(name for bit, name in enumerate(ERRORS) if status >> bit & 1)


def load(who: int, address: int, data: bytes, status: int = 0, by: int | None = None) -> Exchange:
    """Read registers."""
    who_answers = who if by is None else by
    labels = stated(MODEL, address, data, None if by is None else by)
    request = packet(who, LOAD, bytes([address, len(data)]))
    answer = packet(who_answers, status, data)
    return Exchange("load_data", request, (answer,), labels, _errors(status))


def write(
    who: int,
    address: int,
    data: bytes,
    status: int = 0,
    by: int | None = None,
    code: int = STORE,
) -> Exchange:
    """Write registers, at once or with an execution; what is refused does not become true."""
    labels = {} if status & 0x58 else stated(MODEL, address, data)
    answer = packet(who if by is None else by, status)
    name = COMMANDS[code].name
    return Exchange(
        name, packet(who, code, bytes([address]) + data), (answer,), labels, _errors(status)
    )


def plain(who: int, code: int, factors: bytes = b"", by: int | None = None) -> Exchange:
    """Say a command that carries no registers, and is answered without data."""
    answer = packet(who if by is None else by, 0)
    return Exchange(COMMANDS[code].name, packet(who, code, factors), (answer,), {}, ())


def sync(address: int, *targets: tuple[int, bytes]) -> Exchange:
    """Write registers of several servos; nobody answers."""
    labels: dict[Label, int] = {}
    for servo, data in targets:
        labels |= stated(MODEL, address, data, servo)
    data = b"".join(bytes([servo]) + data for servo, data in targets)
    factors = bytes([address, len(targets[0][1])]) + data
    return Exchange("symmetric_store", packet(254, SYNC, factors), (), labels)


def odd(code: int, factors: bytes, who: int = 1) -> Exchange:
    """Say a command with too few or too many factors: no manual says what a servo does."""
    return Exchange(COMMANDS[code].name, packet(who, code, factors), None)


HEADER: Final = b"\xff\xff\xff"
READS: Final = [
    *(load(1, address, bytes(k * 7 % 251 for k in range(n))) for address, n in blocks(MODEL)),
    *(load(1, address, bytes(k * 5 % 251 for k in range(n))) for address, n in halves(MODEL)),
    *(load(who, 0x8C, b"\x10\x02") for who in (1, 2, 3)),
    *(load(who, 0x92, b"\x4a") for who in (1, 2)),
    load(1, 0x8E, b"\x08\x01"),
    load(1, 0x8C, b"\x10\x02\x00\x01\x02\x03\x4a\x1e"),
    load(1, 0x00, bytes(253)),
    load(0, 0x8C, b"\x10\x02", by=2),
    # the error byte that is a command, too, and data that would be its factors
    load(1, 0x8C, b"\x10\x02", 0x73),
    load(1, 0x86, b"\x86\x02\x01\x10\x02", 0x73),
    load(2, 0x92, b"\x4a", 0x73),
    *(load(1, 0x8C, b"\x10\x02", 1 << bit) for bit in range(7)),
    # what looks like the next frame
    load(1, 0x86, HEADER + b"\x01\x02\x03"),
    load(1, 0x86, b"\x01" + HEADER + b"\x02\xf1"),
    load(1, 0x86, b"\x01\x02\x03" + HEADER),
    load(1, 0x86, packet(1, ECHO)),
    load(1, 0x86, b"\x01\x02" + packet(2, LOAD, b"\x8c\x02")),
    load(1, 0x86, b"\xf9\x00"),
    load(2, 0x86, HEADER),
    # a read that the servo cannot do: an error needs no data
    *(
        Exchange("load_data", packet(who, LOAD, b"\x8c\x02"), (packet(who, 8),), {}, ("range",))
        for who in (1, 2)
    ),
]
WRITES: Final = [
    *(write(who, 0x86, b"\x10\x02") for who in (1, 2, 3)),
    write(1, 0x86, b"\x10\x02\x00\x01"),
    write(1, 0x86, HEADER),
    write(1, 0x86, b"\x10\x02", 0x20),
    write(1, 0x86, b"\x10\x02", 0x08),
    write(2, 0x86, b"\x10\x02", 0x40),
    write(1, 0x86, b"\x10"),
    write(0, 0x86, b"\x10\x02", by=1),
    Exchange("store_data", packet(254, STORE, b"\x86\x10\x02"), (), {"goal_position": 0x210}),
    # over the id, and just before and behind it
    write(1, 0x03, b"\x05", by=5),
    write(1, 0x03, b"\x05"),
    write(1, 0x02, b"\x09\x05\x20", by=5),
    write(1, 0x02, b"\x09"),
    write(1, 0x04, b"\x20"),
    # over the return mode, and just before and behind it: nobody knows by which mode it is answered
    write(1, 0x10, b"\x02"),
    Exchange("store_data", packet(1, STORE, b"\x10\x01"), None, {"feedback_return_mode": 1}),
    write(1, 0x0E, b"\x00\x02"),
    write(1, 0x11, b"\x24"),
    *(write(who, 0x86, b"\x10\x02", code=SEND) for who in (1, 2)),
    Exchange("send_data", packet(254, SEND, b"\x86\x10\x02"), (), {"goal_position": 0x210}),
    sync(0x86, (1, b"\x10\x02"), (2, b"\x20\x03")),
    sync(0x86, (1, b"\x10\x02")),
    sync(0x86, (1, HEADER), (2, HEADER), (3, b"\x01\x02\x03")),
]
OTHERS: Final = [
    *(plain(who, code) for who in (1, 2) for code in (ECHO, EXECUTE, RESTART)),
    *(plain(who, code, b"\x02") for who in (1, 2) for code in (RESET, SDK_RESET)),
    *(plain(3, code, b"\x03", by=by) for by in (0, 3) for code in (RESET, SDK_RESET)),
    *(plain(0, code, by=3) for code in (ECHO, EXECUTE, RESTART)),
    Exchange("echo", packet(254, ECHO), (), {}),
    Exchange("execution", packet(254, EXECUTE), (), {}),
    odd(ECHO, b"\x01"),
    odd(LOAD, b"\x8c"),
    odd(LOAD, b"\x8c\x02\x01"),
    Exchange("load_data", packet(1, LOAD, b"\x8c"), (packet(1, 0x40),), {}, ("instruction",)),
    odd(STORE, b"\x86"),
    odd(SEND, b"\x86"),
    odd(SEND, b"\x86\x10"),
    odd(EXECUTE, b"\x01"),
    odd(RESTART, b"\x01"),
    *(odd(code, factors) for code in (RESET, SDK_RESET) for factors in (b"", b"\x01\x02")),
    odd(SYNC, b"\x86\x02\x01\x10", 254),
    odd(SYNC, b"\x86\x02\x01\x10\x02\x02", 254),
    Exchange("unknown_e5", packet(1, 0xE5, b"\x01"), (packet(1, 0x40),), {}, ("instruction",)),
    *(
        Exchange("unknown_e5", packet(who, 0xE5, b"\x01"), (packet(who, 0),), {}, ())
        for who in (1, 2)
    ),
    Exchange("unknown_80", packet(254, 0x80), (), {}),
]


def _store(who: int, *, answered: bool = True) -> Exchange:
    done = write(who, 0x86, b"\x10\x02")
    return done if answered else Exchange(done.name, done.request, (), done.values)


SCENES: Final = [
    # an id that is staged: the write is answered under the old one, what executes it under the new
    [write(1, 0x03, b"\x07", code=SEND), plain(1, EXECUTE, by=7)],
    [write(2, 0x86, b"\x10\x02", code=SEND), plain(2, EXECUTE)],
    # who has answered a write is expected to answer the next, until its return mode says no more
    [_store(4), write(4, 0x10, b"\x01"), _store(4, answered=False)],
    [_store(4), plain(4, RESET, b"\x02"), _store(4, answered=False)],
    [_store(4), plain(4, SDK_RESET, b"\x02"), _store(4, answered=False)],
]

TALK: Final = Talk(
    due([*of_vectors("mightyzap"), *READS, *WRITES, *OTHERS], "load_data", "echo"),
    [*SCENES, *unanswered([*WRITES, *OTHERS], "[!el]*", "execution")],
    commands=[c.name for c in COMMANDS.values()],
    # An error byte 73 with data that make a symmetric store is told by the request right before it;
    # and of data that hold a packet, the packet comes to light where the frame around it breaks.
    # A packet cut before a checksum FF takes that from the next header.
    ambiguous={
        "answered twice: load_data": 1,
        "answer to another command: load_data": 2,
        "two in flight: load_data": 4,
        "answer late: load_data": 1,
        "answer cut: load_data": 6,
        "answer damaged: load_data": 6,
        "request damaged: load_data": 4,
        "silence inside: load_data": 24,
    },
    absent={
        "echo one byte less": "it has no factors",
        "execution one byte less": "it has no factors",
        "restart one byte less": "it has no factors",
    },
    harmless={
        "symmetric_store: one address on": "targets are read from the packet, not by the column"
    },
)
