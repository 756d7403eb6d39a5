"""DYNAMIXEL 1.0 talk, labelled: ROBOTIS e-Manual, Protocol 1.0, and the control table of MX-28."""

from __future__ import annotations

from typing import Final

from sniffer.ground.checksums import COMPLEMENT_SUM
from sniffer.testing import Exchange, Label, Talk
from tests.talks import blocks, halves, stated

MODEL: Final = "examples/protocols/dynamixel1/mx-28.toml"
PING, READ, WRITE, REG, ACTION, RESET, REBOOT, SYNC, BULK = (*range(1, 7), 8, 0x83, 0x92)
NAMES: Final = {
    PING: "ping",
    READ: "read",
    WRITE: "write",
    REG: "reg_write",
    ACTION: "action",
    RESET: "factory_reset",
    REBOOT: "reboot",
    SYNC: "sync_write",
    BULK: "bulk_read",
}
ERRORS: Final = (
    *("input_voltage", "angle_limit", "overheating", "range", "checksum", "overload"),
    "instruction",
)
REFUSALS: Final = 0x58
HEADER: Final = b"\xff\xff"


def packet(who: int, code: int, params: bytes = b"") -> bytes:
    """Put a packet together."""
    body = bytes([who, len(params) + 2, code]) + params
    return HEADER + body + bytes([COMPLEMENT_SUM(body)])


def _errors(status: int) -> tuple[str, ...]:
    return tuple(name for bit, name in enumerate(ERRORS) if status >> bit & 1)


def _is_instruction(code: int, data: bytes) -> bool:
    """Tell whether a status packet would do as an instruction: then its values are not read."""
    fits = {READ: len(data) == 2, WRITE: len(data) > 1, REG: len(data) > 1}
    return fits.get(code, code in NAMES and not data)


def read(who: int, address: int, data: bytes, status: int = 0) -> Exchange:
    """Read registers."""
    labels = {} if _is_instruction(status, data) else stated(MODEL, address, data)
    request = packet(who, READ, bytes([address, len(data)]))
    return Exchange("read", request, (packet(who, status, data),), labels, _errors(status))


def write(
    who: int, address: int, data: bytes, status: int = 0, by: int | None = None, code: int = WRITE
) -> Exchange:
    """Write registers, at once or with an action; what is refused does not become true."""
    labels = {} if status & REFUSALS else stated(MODEL, address, data)
    answer = packet(who if by is None else by, status)
    request = packet(who, code, bytes([address]) + data)
    return Exchange(NAMES[code], request, (answer,), labels, _errors(status))


def plain(who: int, code: int, by: int | None = None, status: int = 0) -> Exchange:
    """Say an instruction without parameters."""
    answer = packet(who if by is None else by, status)
    return Exchange(NAMES[code], packet(who, code), (answer,), {}, _errors(status))


def sync(address: int, *targets: tuple[int, bytes]) -> Exchange:
    """Write registers of several servos; nobody answers."""
    labels: dict[Label, int] = {}
    for servo, data in targets:
        labels |= stated(MODEL, address, data, servo)
    data = b"".join(bytes([servo]) + data for servo, data in targets)
    params = bytes([address, len(targets[0][1])]) + data
    return Exchange("sync_write", packet(254, SYNC, params), (), labels)


def bulk(*targets: tuple[int, int, bytes]) -> Exchange:
    """Read other registers of each servo; they answer one after the other."""
    labels: dict[Label, int] = {}
    for servo, address, data in targets:
        labels |= stated(MODEL, address, data, servo)
    params = b"\0" + b"".join(bytes([len(data), servo, at]) for servo, at, data in targets)
    answers = tuple(packet(servo, 0, data) for servo, _, data in targets)
    return Exchange("bulk_read", packet(254, BULK, params), answers, labels, ())


def odd(code: int, params: bytes, who: int = 1) -> Exchange:
    """Say an instruction with too few or too many parameters."""
    return Exchange(NAMES[code], packet(who, code, params), None)


READS: Final = [
    *(read(1, address, bytes(k * 7 % 251 for k in range(n))) for address, n in blocks(MODEL)),
    *(read(1, address, bytes(k * 5 % 251 for k in range(n))) for address, n in halves(MODEL)),
    *(read(who, 0x24, b"\x10\x02") for who in (1, 2, 3)),
    *(read(who, 0x2B, b"\x20") for who in (1, 2)),
    *(read(1, 0x24, b"\x10\x02\x05", 1 << bit) for bit in range(7)),
    *(read(1, 0x24, b"\x10\x02", status) for status in (READ, WRITE, REG)),
    *(read(2, 0x24, b"\x10\x02\x00\x01", status) for status in (PING, ACTION, RESET, REBOOT)),
    read(1, 0x00, bytes(253)),
    # what looks like the next packet
    read(1, 0x1E, HEADER + b"\x01\x02"),
    read(1, 0x1E, b"\x01" + HEADER + b"\x01\x02"),
    read(1, 0x1E, b"\x01\x02\x03" + HEADER),
    read(1, 0x1E, packet(1, PING)),
    read(1, 0x1E, b"\xfa\x00\x00"),
    Exchange("read", packet(1, READ, b"\x24\x02"), (packet(1, 8),), {}, ("range",)),
    Exchange("read", packet(2, READ, b"\x24\x02"), (packet(2, 0x20),), {}, ("overload",)),
]
WRITES: Final = [
    *(write(who, 0x1E, b"\x10\x02", code=code) for who in (1, 2, 3) for code in (WRITE, REG)),
    write(1, 0x1E, b"\x10"),
    write(1, 0x1E, b"\x10\x02\x05"),
    *(write(1, 0x1E, b"\x10\x02", status) for status in (0x20, 0x08, 0x40, 1, 5, 6)),
    Exchange("write", packet(254, WRITE, b"\x1e\x10\x02"), (), {"goal_position": 0x210}),
    # over the id, over the return level, and just before and behind them
    write(1, 0x03, b"\x05", by=5),
    write(1, 0x03, b"\x05"),
    write(1, 0x02, b"\x09"),
    write(1, 0x04, b"\x22"),
    write(1, 0x10, b"\x02"),
    write(1, 0x0E, b"\x00\x02"),
    write(1, 0x11, b"\x24"),
    sync(0x1E, (1, b"\x10\x02"), (2, b"\x20\x03")),
    sync(0x1E, (1, b"\x10\x02")),
    bulk((1, 0x1E, b"\x10\x02"), (2, 0x24, b"\x20\x03\x01")),
    bulk((1, 0x1E, b"\x10\x02")),
]
OTHERS: Final = [
    *(plain(who, code) for who in (1, 2) for code in (PING, ACTION, REBOOT)),
    plain(2, RESET, by=1),
    plain(3, RESET),
    Exchange("factory_reset", packet(254, RESET), (), {}),
    Exchange("action", packet(254, ACTION), (), {}),
    odd(REG, b"\x1e\x10"),
    odd(SYNC, b"\x1e\x02\x01\x10", 254),
    odd(SYNC, b"\x1e\x02\x01\x10\x02\x02", 254),
    odd(BULK, b"\x00\x02\x01", 254),
    odd(BULK, b"\x00\x02\x01\x1e\x02", 254),
    Exchange("unknown_e5", packet(1, 0xE5, b"\x01"), (packet(1, 0),), {}, ()),
]


def _write(who: int, *, answered: bool = True) -> Exchange:
    done = write(who, 0x1E, b"\x10\x02")
    return done if answered else Exchange(done.name, done.request, (), done.values)


SCENES: Final = [
    [write(1, 0x03, b"\x07", code=REG), plain(1, ACTION, by=7)],
    [_write(4), write(4, 0x10, b"\x01"), _write(4, answered=False)],
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
