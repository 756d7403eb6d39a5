"""mightyZAP talk."""

from __future__ import annotations

import functools

from hypothesis import strategies as st

from sniffer.ground.checksums import COMPLEMENT_SUM
from sniffer.protocols.mightyzap.grammar import COMMANDS, PACKET
from tests.streams import KEPT

BYTES = [0xFF, 0xFF, 0xFF, 0, 1, 2, 3, 4, 7, 0x16, 0x73, 0x86, 0x8C, 0xF2, 0xF3, 0xFE]


@functools.lru_cache(KEPT)
def packet(servo_id: int, code: int, factors: bytes = b"") -> bytes:
    """Build a packet with the grammar."""
    body = {"servo_id": servo_id, "size": len(factors) + 2, "code": code, "factors": factors}
    built: bytes = PACKET.build({"body": {"value": body}})
    assert built[-1] == COMPLEMENT_SUM(built[3:-1])
    return built


_byte = st.one_of(st.sampled_from(BYTES), st.integers(0, 255))
_some = st.lists(_byte, max_size=14).map(bytes)
_id = st.one_of(st.sampled_from([0, 1, 2, 3, 254]), st.integers(0, 254))
ANY_PACKET = st.builds(packet, _id, st.one_of(st.sampled_from(sorted(COMMANDS)), _byte), _some)


@st.composite
def _exchange(draw: st.DrawFn) -> bytes:
    who = draw(_id)
    answer = draw(st.booleans())
    match draw(st.sampled_from(["read", "echo", "write", "sync", "mode", "id", "reset", "staged"])):
        case "read":
            address, n = draw(
                st.sampled_from(
                    [(0x8C, 8), (0x8C, 2), (0x86, 1), (0x73, 3), (0x16, 1), (0x10, 1), (0, 24)]
                )
            )
            status = draw(st.sampled_from([0, 0, 0, 0x73, 0x20, 0x08]))
            data = draw(st.lists(_byte, min_size=n, max_size=n).map(bytes))
            reply = packet(who, status, data if draw(st.integers(0, 9)) else b"")
            return packet(who, 0xF2, bytes([address, n])) + (reply if answer else b"")
        case "sync":
            return packet(
                254, 0x73, b"\x86\x02" + draw(st.lists(_byte, min_size=6, max_size=7).map(bytes))
            )
        case "mode":
            register = draw(st.sampled_from([0x16, 0x16, 0x10, 0x04]))
            head = packet(who, 0xF3, bytes([register, draw(st.integers(0, 5))]))
        case "id":
            head = packet(who, 0xF3, bytes([3, draw(st.integers(0, 5))]))
        case "reset":
            head = packet(who, 0xF6, bytes([draw(st.integers(0, 3))]))
        case "staged":
            head = (
                packet(who, 0xF4, bytes([0x16, draw(st.integers(1, 4))]))
                + packet(who, 0)
                + packet(who, 0xF5)
            )
        case "write":
            head = packet(
                who, 0xF3, b"\x86" + draw(st.lists(_byte, min_size=1, max_size=5).map(bytes))
            )
        case _:
            head = packet(who, 0xF1)
    return head + (packet(who, draw(st.sampled_from([0, 0, 0, 8, 0x20]))) if answer else b"")


_WRITES = [
    b"\x15\x00\x02",  # speed limit: a 12Lf only
    b"\x15\xff\x07",
    b"\x16\x02",
    b"\x16\x04",
    b"\x21\x20",  # acceleration: a 12Lf only
    b"\x22\x20",
    b"\x82\x04",  # compliance margin: an L12 only
    b"\x83\x04",
    b"\x2a\x34\x08",  # pulse width: an L12 only
    b"\x8a\xb0\x04",  # 1200: a current, no force
    b"\x86\xff\x0f",
    b"\x86\xff\x03",
    b"\x88\x00\x02\x00",
    b"\x10\x01",
    b"\x10\x02",
    b"\x10\x00",
    b"\x03\x01",
    b"\x03\x02",
    b"\x02\x00\x02\x10",
    b"\x02\x00\x02",
]
_READS = [
    (0x8C, b"\xff\x0f"),
    (0x8C, b"\x00\x02"),
    (0x8E, b"\x08\x07"),  # 1800: a speed, no current
    (0x93, b"\x20"),
    (0x15, b"\x00\x02"),
    (0x16, b"\x02"),
    (0x16, b"\x03"),
    (0x10, b"\x01"),
    (0x11, b"\x21\x21"),
    (0x11, b"\x24\x24"),
    (0x14, b"\x02\x02\x02"),
    (0x10, b"\x02\x24\x24\x00\x00\x00\x02\x00"),
]


@st.composite
def _told(draw: st.DrawFn) -> bytes:
    """Draw talk that tells models apart, sets modes, and moves both to other ids."""
    who = draw(st.sampled_from([1, 1, 1, 2, 2, 0, 254]))
    by = who if who not in (0, 254) else draw(st.sampled_from([0, 1, 2]))
    status = draw(st.sampled_from([0, 0, 0, 0, 0x08, 0x20]))
    match draw(st.sampled_from(["write", "write", "read", "read", "staged", "sync", "reset"])):
        case "write":
            head = packet(who, 0xF3, draw(st.sampled_from(_WRITES)))
        case "read":
            address, data = draw(st.sampled_from(_READS))
            head = packet(who, 0xF2, bytes([address, len(data)]))
            return head + (packet(by, status, data) if draw(st.integers(0, 5)) else b"")
        case "staged":
            head = packet(who, 0xF4, draw(st.sampled_from(_WRITES)))
            if draw(st.booleans()):
                head += packet(by, status)
            head += draw(st.one_of(st.just(b""), ANY_PACKET))
            head += packet(draw(st.sampled_from([who, who, 1, 254])), 0xF5)
            by = draw(st.sampled_from([by, 1, 2]))
        case "sync":
            address, one, two = draw(
                st.sampled_from(
                    [
                        (0x86, b"\xff\x0f", b"\x10\x00"),
                        (0x15, b"\x00\x02", b"\x00\x02"),
                        (0x88, b"\x00\x02", b"\x00\x00"),
                        (0x16, b"\x02", b"\x03"),
                        (0x03, b"\x02", b"\x01"),
                        (0x10, b"\x02", b"\x00"),
                        (0x21, b"\x02", b"\x10"),
                    ]
                )
            )
            first, second = draw(st.sampled_from([(1, 2), (2, 1), (1, 1), (0, 2), (254, 1)]))
            targets = bytes([first]) + one + bytes([second]) + two
            return packet(254, 0x73, bytes([address, len(one)]) + targets)
        case _:
            head = packet(who, 0xF6, bytes([draw(st.integers(0, 3))]))
    return head + (packet(by, status) if draw(st.booleans()) else b"")


MODELS = st.lists(_told(), max_size=40).map(b"".join)
"""Long talk with servos whose model shows itself on the way."""

TALK = st.one_of(_exchange(), _exchange(), ANY_PACKET, _told())


@st.composite
def _asked(draw: st.DrawFn) -> tuple[bytes, list[bytes]]:
    """Draw a command and its feedback: reads of one length and of others, writes, errors."""
    who = draw(st.sampled_from([1, 1, 2, 3]))
    address, n = draw(st.sampled_from([(0x8C, 2), (0x90, 2), (0x92, 1), (0x8C, 8)]))
    data = draw(st.lists(_byte, min_size=n, max_size=n).map(bytes))
    read = packet(who, 0xF2, bytes([address, n]))
    match draw(st.integers(0, 11)):
        case 0:
            return packet(who, 0xF3, b"\x86\x01\x02"), draw(
                st.sampled_from([[], [packet(who, 0)], [packet(who, 0x20)]])
            )
        case 1:
            return packet(0, 0xF2, bytes([address, n])), [packet(who, 0, data)]
        case 2:
            return packet(254, 0xF3, b"\x86\x01\x02"), []
        case 3:
            return read, [packet(who, 4)]
        case 4:
            return packet(who, 0xF1), [packet(who, 0)]
        case 5:
            return packet(
                who, 0xF3, b"\x10" + draw(st.sampled_from([b"\x00", b"\x01", b"\x02"]))
            ), []
        case 6:
            return packet(who, 0xF3, b"\x03\x02"), [packet(draw(st.sampled_from([who, 2])), 0)]
        case _:
            return read, [packet(who, draw(st.sampled_from([0, 0, 0x08])), data)]


ASKED = _asked()
