"""DYNAMIXEL 2.0 talk, labelled: ROBOTIS e-Manual, Protocol 2.0, control table of XM430-W210."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.ground.crc import Crc16
from sniffer.testing import Exchange, Talk
from tests.talks import of_package, stated
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
    SYNC_READ,
    SYNC_WRITE,
    WRITE,
    ByAddress,
)

if TYPE_CHECKING:
    from sniffer.testing import Label

PACKAGE: Final = "examples/protocols/dynamixel2"
CLEAR, BACKUP, FAST_SYNC, BULK_WRITE, FAST_BULK = 0x10, 0x20, 0x8A, 0x93, 0x9A
INSTRUCTIONS: Final = NAMES | {
    RESET: "factory_reset",
    REBOOT: "reboot",
    CLEAR: "clear",
    BACKUP: "control_table_backup",
    SYNC_READ: "sync_read",
    FAST_SYNC: "fast_sync_read",
    BULK_READ: "bulk_read",
    BULK_WRITE: "bulk_write",
    FAST_BULK: "fast_bulk_read",
}
ERRORS: Final = (
    *("result_fail", "instruction", "crc", "data_range", "data_length", "data_limit"),
    "access",
)
ALERT: Final = 0x80
HEADER: Final = b"\xff\xff\xfd\x00"
CRC: Final = Crc16(0x8005)
TURNS, TABLE = b"\x01DXL\x22", b"CTRL"
"""What must stand in the two commands that would do harm by mistake."""


def packet(who: int, code: int, params: bytes = b"", *, stuffed: bool = True) -> bytes:
    """Put a packet together; behind FF FF FD within it stands one more FD."""
    if stuffed:
        params = params.replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
    body = HEADER + bytes([who]) + (len(params) + 3).to_bytes(2, "little") + bytes([code]) + params
    return body + CRC(body).to_bytes(2, "little")


def status(who: int, error: int, data: bytes = b"") -> bytes:
    """Put a status packet together."""
    return packet(who, 0x55, bytes([error]) + data)


def errors(error: int) -> tuple[str, ...]:
    """Name an error: a number, and bit 7, which says that the hardware error status tells more."""
    number = error & ~ALERT
    return (*((ERRORS[number - 1],) if number else ()), *(("alert",) if error & ALERT else ()))


SAY: Final = ByAddress(
    f"{PACKAGE}/xm430-w210.toml",
    INSTRUCTIONS,
    errors,
    refusals=0x7F,
    packet=packet,
    status=status,
    width=2,
    alike=False,
)
read, write, plain, odd = SAY.read, SAY.write, SAY.plain, SAY.odd


def _span(address: int, length: int) -> bytes:
    return SAY.number(address) + SAY.number(length)


def found(*servos: int) -> Exchange:
    """Look for all servos; each answers with its model and firmware."""
    told = tuple(status(servo, 0, b"\x06\x04\x26") for servo in servos)
    return Exchange("ping", packet(ALL, PING), told, {}, ())


def bulk(*targets: tuple[int, int, int, bytes]) -> Exchange:
    """Read other registers of each servo: its id, address, error and data."""
    params = b"".join(bytes([servo]) + _span(at, len(data)) for servo, at, _, data in targets)
    return SAY.several(BULK_READ, params, *targets)


def bulk_write(*targets: tuple[int, int, bytes]) -> Exchange:
    """Write other registers of each servo; nobody answers."""
    labels: dict[Label, int] = {}
    for servo, address, data in targets:
        labels |= stated(SAY.model, address, data, servo)
    each = (bytes([servo]) + _span(at, len(data)) + data for servo, at, data in targets)
    return Exchange("bulk_write", packet(ALL, BULK_WRITE, b"".join(each)), (), labels)


def fast(code: int, *targets: tuple[int, int, int, bytes]) -> Exchange:
    """Read several servos, which answer with one packet: error, id, data, and a CRC between two."""
    ids = bytes(servo for servo, *_ in targets)
    _, address, _, data = targets[0]
    params = _span(address, len(data)) + ids
    if code == FAST_BULK:
        params = b"".join(bytes([servo]) + _span(at, len(data)) for servo, at, _, data in targets)
    labels: dict[Label, int] = {}
    for servo, at, _, data in targets:
        labels |= stated(SAY.model, at, data, servo)
    parts = [bytes([error, servo]) + data for servo, _, error, data in targets]
    answer = packet(ALL, 0x55, b"\x12\x34".join(parts), stuffed=False)
    return Exchange(
        INSTRUCTIONS[code], packet(ALL, code, params), (answer,), labels, errors(targets[0][2])
    )


POSITION: Final = b"\xa6\x00\x00\x00"
GOAL: Final = b"\x00\x02\x00\x00"
READS: Final = [
    *SAY.table(),
    *(read(who, 132, POSITION) for who in (1, 2, 3)),
    *(read(who, 146, b"\x24") for who in (1, 2)),
    *(read(1, 132, POSITION, error) for error in (*range(1, 8), ALERT, ALERT | 4)),
    *(SAY.read_failed(who, 132, 4, error) for who in (1, 2) for error in (2, 7, ALERT | 3)),
    read(1, 0, bytes(1020)),
    # what looks like the next packet: stuffed, so that it does not
    read(1, 116, HEADER),
    read(1, 116, b"\x01\xff\xff\xfd"),
    read(1, 116, b"\xff\xff\xfd\xfd"),
    read(1, 116, b"\x01" + HEADER + b"\x02"),
    read(1, 116, packet(1, PING)),
    write(1, 116, b"\xff\xff\xfd\x00"),
]
WRITES: Final = [
    *(write(who, 116, GOAL, code=code) for who in (1, 2, 3) for code in (WRITE, REG)),
    *(
        write(1, 116, data, code=code)
        for code in (WRITE, REG)
        for data in (GOAL[:1], GOAL + b"\x01", GOAL + b"\x01\x02\x03\x04")
    ),
    *(write(1, 116, GOAL, error) for error in (*range(1, 8), ALERT, ALERT | 6)),
    SAY.told(ALL, 116, GOAL),
    SAY.told(ALL, 116, GOAL, REG),
    # over the id, over the return level, and just before and behind them
    write(1, 7, b"\x05", by=5),
    write(1, 7, b"\x05"),
    write(1, 6, b"\x2d"),
    write(1, 8, b"\x03"),
    write(1, 68, b"\x02"),
    write(1, 64, b"\x01\x01\x00\x00"),
    write(1, 69, b"\x00"),
    SAY.sync_write(116, (1, GOAL), (2, POSITION)),
    SAY.sync_write(116, (1, GOAL)),
    bulk_write((1, 32, b"\xa0\x00"), (2, 31, b"\x50")),
    bulk_write((1, 116, GOAL)),
]
SEVERAL: Final = [
    SAY.sync_read(132, (1, 0, POSITION), (2, 0, GOAL)),
    SAY.sync_read(132, (1, 0, POSITION)),
    SAY.sync_read(146, (3, 0, b"\x20"), (1, ALERT, b"\x50")),
    bulk((1, 144, 0, b"\x77\x00"), (2, 146, 0, b"\x24")),
    bulk((1, 132, 0, POSITION)),
    *(fast(code, (1, 132, 0, POSITION), (2, 132, 0, GOAL)) for code in (FAST_SYNC, FAST_BULK)),
    *(fast(code, (2, 132, ALERT, POSITION)) for code in (FAST_SYNC, FAST_BULK)),
    # read by place: nothing is stuffed there, and the header may stand in it
    *(fast(FAST_SYNC, (1, 116, 0, data)) for data in (HEADER, b"\xff\xff\xfd\xfd")),
    fast(FAST_SYNC, (1, 112, 0, b"\x01" + HEADER + bytes(3)), (2, 112, 0, bytes(8))),
    fast(FAST_BULK, (1, 100, 0, packet(1, PING) + bytes(6)), (2, 146, 0, b"\x24")),
    fast(FAST_BULK, (1, 144, 0, b"\x77\x00"), (3, 132, 0, POSITION), (2, 146, 0, b"\x24")),
]
OTHERS: Final = [
    *(
        Exchange(
            "ping",
            packet(who, PING),
            (status(who, error, b"\x06\x04\x26"),),
            {},
            errors(error),
            due=True,
        )
        for who, error in ((1, 0), (2, 0), (1, ALERT))
    ),
    found(1, 2),
    found(3),
    *(plain(who, code) for who in (1, 2) for code in (ACTION, REBOOT)),
    *(plain(who, CLEAR, params=TURNS) for who in (1, 2)),
    *(plain(who, BACKUP, params=bytes([1]) + TABLE) for who in (1, 2)),
    plain(1, BACKUP, params=bytes([2]) + TABLE, status=1),
    plain(2, RESET, by=1, params=b"\xff"),
    plain(3, RESET, params=b"\xff"),
    *(plain(who, RESET, params=b"\x01") for who in (2, 3)),
    plain(2, RESET, params=b"\x02"),
    *(SAY.to_all(code) for code in (ACTION, REBOOT)),
    SAY.to_all(RESET, b"\x02"),
    *(
        Exchange("unknown_e5", packet(who, 0xE5, b"\x01"), (status(who, 2),), {}, ("instruction",))
        for who in (1, 2)
    ),
]
ODD: Final = [
    *(odd(code, b"\x01") for code in (PING, ACTION, REBOOT)),
    *(odd(READ, params) for params in (_span(132, 4)[:3], _span(132, 4) + b"\x01")),
    *(odd(code, b"\x74\x00") for code in (WRITE, REG)),
    *(odd(RESET, params) for params in (b"", b"\x01\x01")),
    *(odd(CLEAR, params) for params in (TURNS[:-1], TURNS + b"\x01", b"\x01DXL\x23")),
    *(odd(BACKUP, params) for params in (b"\x01CTR", b"\x01CTRL\x01", b"\x01CTRM")),
    *(odd(code, _span(132, 4), ALL) for code in (SYNC_READ, FAST_SYNC)),
    *(
        odd(SYNC_WRITE, _span(116, 4) + b"\x01" + GOAL + more, ALL)
        for more in (b"\x02", b"\x02\x01")
    ),
    odd(SYNC_WRITE, _span(116, 4) + b"\x01" + GOAL[:-1], ALL),
    *(
        odd(code, params, ALL)
        for code in (BULK_READ, FAST_BULK)
        for params in (b"\x01\x84\x00\x04", b"\x01\x84\x00\x04\x00\x02")
    ),
    *(odd(BULK_WRITE, b"\x01" + _span(116, 4) + data, ALL) for data in (GOAL[:-1], GOAL + b"\x02")),
]


SCENES: Final = [
    [write(1, 7, b"\x07", code=REG), plain(1, ACTION, by=7)],
    [write(4, 116, GOAL), write(4, 68, b"\x01"), SAY.told(4, 116, GOAL)],
    # a servo of which nobody knows whether it answers more than pings and reads
    [
        *(SAY.told(5, 116, GOAL, code) for code in (WRITE, REG)),
        *(SAY.unanswered(5, code) for code in (ACTION, REBOOT)),
        SAY.unanswered(5, RESET, b"\x02"),
        SAY.unanswered(5, CLEAR, TURNS),
        SAY.unanswered(5, BACKUP, b"\x01" + TABLE),
        read(5, 132, POSITION),
    ],
    [write(6, 68, b"\x00"), Exchange("read", SAY.say(6, READ, _span(132, 4)), (), {})],
]

TALK: Final = Talk(
    [*of_package(PACKAGE), *READS, *WRITES, *SEVERAL, *OTHERS, *ODD],
    SCENES,
    # A packet within the data of one that is torn is a packet.
    ambiguous={
        "answer cut: fast_bulk_read": 4,
        "answer damaged: fast_bulk_read": 3,
        "silence inside: fast_bulk_read": 10,
    },
    absent={
        "ping one byte less": "it has no parameters",
        "action one byte less": "it has no parameters",
        "reboot one byte less": "it has no parameters",
        "data that begin with the header": "they are stuffed; an id begins those that are not",
        "a status like *": "the code 55 tells a status packet",
        "an answer that reads as a command": "the code 55 tells a status packet",
    },
    harmless={
        "sync_write: one address on": "targets are read from the packet, not by the column",
        "action: no other id may answer": "a new id that was staged says which",
        "fast_sync_read: no other id may answer": "the one answer has the id that was asked",
        "fast_bulk_read: no other id may answer": "the one answer has the id that was asked",
    },
)
