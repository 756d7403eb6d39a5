"""mightyZAP talk."""

from __future__ import annotations

from hypothesis import strategies as st

from sniffer.checksums import COMPLEMENT_SUM
from sniffer.protocols.mightyzap.grammar import COMMANDS, PACKET

BYTES = [0xFF, 0xFF, 0xFF, 0, 1, 2, 3, 4, 7, 0x16, 0x73, 0x86, 0x8C, 0xF2, 0xF3, 0xFE]


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


TALK = st.one_of(_exchange(), _exchange(), ANY_PACKET)


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
