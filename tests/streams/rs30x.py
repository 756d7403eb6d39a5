"""RS30x talk: every command and reply nibble, long packets, resets in all variants, ACK, NACK."""

from __future__ import annotations

import functools

from hypothesis import strategies as st

from sniffer.ground.checksums import XOR8
from sniffer.protocols.rs30x.grammar import PACKET, REPLIES, RESET_WITH_DATA, RETURN
from tests.streams import KEPT

BYTES = [
    0xFA,
    0xAF,
    0xFD,
    0xDF,
    0xFF,
    0,
    1,
    2,
    3,
    4,
    6,
    7,
    8,
    9,
    0x0F,
    0x10,
    0x1E,
    0x20,
    0x2A,
    0x40,
]


@functools.lru_cache(KEPT)
def packet(
    servo_id: int,
    flags: int,
    address: int = 0,
    length: int = 0,
    count: int = 0,
    data: bytes | None = None,
) -> bytes:
    """Build a short or long packet with the grammar; no data: as many zeros as it states."""
    body = {"servo_id": servo_id, "flags": flags, "address": address, "length": length}
    filled = bytes(length * count) if data is None else data
    built: bytes = PACKET.build({"body": {"value": {**body, "count": count, "data": filled}}})
    assert built[-1] == XOR8(built[2:-1])
    return built


def write(servo_id: int, address: int, data: bytes, flags: int = 0) -> bytes:
    """Build a short packet that writes ``data``."""
    return packet(servo_id, flags, address, len(data), 1, data)


def long(address: int, *servos: tuple[int, bytes], flags: int = 0) -> bytes:
    """Build a long packet; all servos have equally many bytes."""
    blocks = b"".join(bytes([servo]) + data for servo, data in servos)
    return packet(0, flags, address, len(blocks) // len(servos), len(servos), blocks)


def reset_with_data(servo_id: int, length: int = 0xFF, count: int = 0, flags: int = 0x10) -> bytes:
    """Build the factory reset of nine bytes."""
    body = {"servo_id": servo_id, "flags": flags, "address": 0xFF, "length": length, "count": count}
    built: bytes = RESET_WITH_DATA.build({"body": {"value": {**body, "data": None}}})
    return built


@functools.lru_cache(KEPT)
def returned(servo_id: int, address: int, data: bytes, status: int = 0) -> bytes:
    """Build a return packet."""
    body = {"servo_id": servo_id, "flags": status, "address": address, "length": len(data)}
    built: bytes = RETURN.build({"body": {"value": {**body, "count": 1, "data": data}}})
    return built


def raw(*fields: int, data: bytes = b"", header: bytes = b"\xfa\xaf") -> bytes:
    """Build a packet by hand, also one that the grammar refuses; the sum holds."""
    body = bytes(fields) + data
    return header + body + bytes([XOR8(body)])


_byte = st.one_of(st.sampled_from(BYTES), st.integers(0, 255))
_id = st.one_of(st.sampled_from([0, 1, 2, 3, 16, 127, 255]), st.integers(0, 127))
_servo = st.one_of(st.sampled_from([1, 2, 3, 16, 127]), st.integers(1, 127))
_status = st.sampled_from([0, 0, 0, 0x80, 0x20, 0x08, 0x02, 0x41])
_address = st.one_of(st.sampled_from([0, 2, 3, 4, 6, 7, 0x1E, 0x20, 0x2A, 0xFF]), _byte)


def _some(least: int, most: int) -> st.SearchStrategy[bytes]:
    return st.lists(_byte, min_size=least, max_size=most).map(bytes)


@st.composite
def _answer(draw: st.DrawFn, who: int, nibble: int, address: int, length: int) -> bytes:
    """Draw what comes back: mostly what was asked for, now and then something else or nothing."""
    if draw(st.integers(0, 4)) == 0:
        return b""
    who = draw(st.sampled_from([who, who, who, who, 1, 5]))
    who = who if 0 < who < 128 else 1
    if nibble == 1 and draw(st.integers(0, 7)):
        return draw(st.sampled_from([b"\x07", b"\x07", b"\x08", b"\x07\x07", b"\x08\x07", b"\x09"]))
    if nibble in REPLIES and REPLIES[nibble].address >= 0:
        address, length = REPLIES[nibble].address, REPLIES[nibble].length
    length = draw(st.sampled_from([length, length, length, length, 0, 2])) & 255
    return returned(who, address, draw(_some(length, length)), draw(_status))


@st.composite
def _exchange(draw: st.DrawFn) -> bytes:
    who = draw(_id)
    nibble = draw(st.one_of(st.just(0), st.sampled_from([1, 1, 9, 0xF]), st.integers(0, 15)))
    kinds = ["read", "any_read", "write", "id", "long", "command", "reset", "odd"]
    match draw(st.sampled_from(kinds)):
        case "read":
            address, length, count = draw(st.sampled_from([(0, 0, 1), (0, 0, 0), (0xFF, 0, 0)]))
            head = packet(who, nibble, address, length, count)
            return head + draw(_answer(who, nibble, address, length))
        case "any_read":
            address, length = draw(_address), draw(st.sampled_from([0, 1, 2, 6, 18, 60, 255]))
            return packet(who, 0x0F, address, length) + draw(_answer(who, 0xF, address, length))
        case "write":
            address, data = draw(_address), draw(_some(1, 6))
            return write(who, address, data, nibble) + draw(
                _answer(who, nibble, address, len(data))
            )
        case "id":
            new = draw(st.sampled_from([1, 2, 5, 127]))
            address, data = draw(
                st.sampled_from([(4, bytes([new])), (3, bytes([0, new, 0])), (4, bytes([new, 1]))])
            )
            head = write(who, address, data, nibble)
            return head + draw(
                _answer(draw(st.sampled_from([who, new])), nibble, address, len(data))
            )
        case "long":
            each = draw(st.integers(0, 4))
            servos = [
                (draw(_byte), draw(_some(each, each))) for _ in range(draw(st.integers(1, 5)))
            ]
            return long(draw(_address), *servos, flags=draw(st.sampled_from([0, 0, 0, 1, 9])))
        case "command":
            flags = draw(st.sampled_from([0x40, 0x20, 0x60, 0x41, 0x30]))
            if draw(st.booleans()):
                return write(who, draw(_address), draw(_some(1, 4)), flags)
            return packet(
                who, flags, draw(st.sampled_from([0xFF, 0xFF, 0])), 0, draw(st.integers(0, 1))
            )
        case "reset":
            flags = draw(st.sampled_from([0x10, 0x10, 0x50, 0x11]))
            length, count = draw(st.sampled_from([(0xFF, 0), (0, 0), (0, 1)]))
            plain = packet(who, flags, 0xFF, length, count)
            counted = packet(who, flags, 0xFF, 1, 1, b"\xff")
            nine = reset_with_data(who, length, count, flags)
            return draw(st.sampled_from([plain, nine, counted]))
        case _:
            return draw(ANY_PACKET)


@st.composite
def _any_packet(draw: st.DrawFn) -> bytes:
    """Draw a packet whose fields are whatever the frame can hold."""
    if draw(st.booleans()):
        return returned(draw(_servo), draw(_byte), draw(_some(0, 20)), draw(_byte))
    length, count = draw(
        st.sampled_from([(0, 0), (1, 2), (2, 3), (3, 3), (0, 9), (255, 0), (7, 1)])
    )
    data = draw(_some(length * count, length * count))
    return packet(draw(_id), draw(_byte), draw(_byte), length, count, data)


@st.composite
def _stranger(draw: st.DrawFn) -> bytes:
    """Draw a return packet whose sum holds, under an id that no servo has."""
    data = draw(_some(0, 4))
    who = draw(st.sampled_from([0, 128, 254, 255]))
    return raw(who, 0, draw(_address), len(data), 1, data=data, header=b"\xfd\xdf")


ANY_PACKET = _any_packet()
TALK = st.one_of(_exchange(), _exchange(), _exchange(), ANY_PACKET, _stranger())


@st.composite
def _asked(draw: st.DrawFn) -> tuple[bytes, list[bytes]]:
    """Draw a packet and what it returns: nibbles with an address, reads by address, ACK."""
    who = draw(st.sampled_from([1, 1, 2, 3]))
    match draw(st.integers(0, 7)):
        case 0:
            return write(who, 0x1E, b"\1\2", 1) + draw(st.sampled_from([b"", b"\7", b"\x08"])), []
        case 1:
            return write(255, 0x1E, b"\1\2"), []
        case 2 | 3:
            n = draw(st.sampled_from([2, 4]))
            return packet(who, 0x0F, 42, n), [returned(who, 42, draw(_some(n, n)), draw(_status))]
        case 4:
            new = draw(st.sampled_from([1, 2]))
            return write(who, 4, bytes([new]), 9), [returned(new, 42, draw(_some(18, 18)))]
        case _:
            return packet(who, 9), [returned(who, 42, draw(_some(18, 18)), draw(_status))]


ASKED = _asked()


READ_BLOCK = packet(1, 9, 0, 0, 1)
BLOCK = bytes.fromhex("4EFB0000000006002D00E402000000000000")
TORQUE_ON = write(1, 0x24, b"\x01", flags=1)
