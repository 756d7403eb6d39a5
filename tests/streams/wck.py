"""wCK talk."""

from __future__ import annotations

from hypothesis import strategies as st

from sniffer.ground.checksums import XOR7, XOR8
from sniffer.protocols.wck.controller import HEADER
from sniffer.protocols.wck.grammar import COMMANDS, INDEX, OPS, READ_10BIT_TEXT, byte_values

BYTES = [0xFF, 0xFF, 0xFF, 0, 1, 0x0C, 0x10, 0x1F, 0x30, 0x64, 0x7F, 0x96, 0xA0, 0xC0, 0xC8, 0xC9]
BYTES += [0xDF, 0xE0, 0xFE]

SYNC, READ_10BIT = INDEX["sync_position_move"], INDEX["position_read_10bit"]


def command(data1: int, data2: int, rest: bytes = b"", *, text_sum: bool = False) -> bytes:
    """Put a command together with the checksum that holds."""
    summed = bytes([data1, data2]) + rest
    if data1 <= 0x9F and data1 & 31 == 31:
        summed = rest
    if text_sum:
        summed = bytes([data1, data2, rest[-1]])
    return b"\xff" + bytes([data1, data2]) + rest + bytes([XOR7(summed)])


def rbc(kind: int, contents: bytes, platform: int = 0) -> bytes:
    """Build a packet of RoboBuilder's controller."""
    head = HEADER + bytes([kind, platform]) + len(contents).to_bytes(4, "big")
    return head + contents + bytes([XOR8(contents)])


def rebuilt(index: int, raw: bytes) -> bytes:
    """Parse a command with its grammar and build it again."""
    grammar = COMMANDS[index]
    if index == READ_10BIT and XOR7(raw[1:-1]) != raw[-1]:
        grammar = READ_10BIT_TEXT
    built: bytes = grammar.build({"body": {"value": grammar.parse(raw).body.value}})
    return built


_byte = st.one_of(st.sampled_from(BYTES), st.integers(0, 255))
_two = st.lists(_byte, min_size=2, max_size=2).map(bytes)


@st.composite
def any_command(draw: st.DrawFn) -> tuple[int, bytes]:
    """Draw a command: its row of OPS and its bytes."""
    index = draw(st.integers(0, len(OPS) - 1))
    op = OPS[index]
    data1 = draw(st.sampled_from(byte_values(op.data1)))
    data2 = draw(st.sampled_from(byte_values(op.data2)))
    more = data2 & 31 if index == SYNC else 0
    count = draw(st.integers(0, 8))
    rest = draw(st.lists(_byte, min_size=len(op.params) + more, max_size=len(op.params) + more))
    if op.name == "motion_data_write":
        rest = [count, *draw(st.lists(_byte, min_size=2 * count, max_size=2 * count))]
    if "again" in op.params and draw(st.integers(0, 3)):
        rest[1] = rest[0]
    text_sum = index == READ_10BIT and draw(st.booleans())
    raw = command(data1, data2, bytes(rest), text_sum=text_sum)
    assert rebuilt(index, raw) == raw
    return index, raw


@st.composite
def _exchange(draw: st.DrawFn) -> bytes:
    index, raw = draw(any_command())
    op = OPS[index]
    if not op.reply:
        return raw
    match draw(st.sampled_from(["none", "lone", "reply", "reply", "echo", "echo", "extra"])):
        case "none":
            return raw
        case "lone":
            return raw + bytes([draw(_byte)])
        case "echo":
            return raw + (raw[3:5] if op.params else bytes([raw[2], draw(_byte)]))
        case "extra":
            return raw + draw(_two) + draw(_two)
        case _:
            return raw + draw(_two)


@st.composite
def _ten_bit(draw: st.DrawFn) -> bytes:
    """Draw 10-bit talk of one alignment, as a single bus has it."""
    shift = draw(st.sampled_from([0, 1]))
    out = b""
    for position in draw(st.lists(st.integers(0, 1023), min_size=1, max_size=4)):
        words = bytes([position >> 7, (position & 127) << shift])
        who = draw(st.sampled_from([0, 1, 31, 100, 253]))
        if draw(st.booleans()):
            out += command(0xE0, 0xC8, bytes([who, 0]) + words) + words
        else:
            out += command(0xE0, 0xC9, bytes([who, who])) + words
    return out


@st.composite
def _stray_header(draw: st.DrawFn) -> bytes:
    """Draw a stray FF before a command that makes it look like the start of a 10-bit one."""
    data1 = draw(st.sampled_from([0xC8, 0xC9]))
    data2 = draw(st.sampled_from([0x10, 0x30, 0x4F]))
    return b"\xff" * draw(st.integers(1, 3)) + command(data1, data2) + draw(st.binary(max_size=2))


@st.composite
def _full_count(draw: st.DrawFn) -> bytes:
    """Draw a reply that holds an FF where one may stand."""
    match draw(st.integers(0, 3)):
        case 0:
            return command(0xC0, 0x3F) + bytes([0xFF, draw(_byte)])
        case 1:
            return command(0xE0, 0x65, b"\0\0") + bytes([draw(_byte), 0xFF])
        case 2:
            return command(0xE1, 0x64, b"\xff\xff") + b"\xff\xff"
        case _:
            return command(0xE1, 0x64, b"\xff\xff") + command(0xFF, 0xC9, b"\x21\x21")


@st.composite
def _controller(draw: st.DrawFn) -> bytes:
    """Draw packets of RoboBuilder's controller: asked and answered, torn, damaged, too long."""
    out = b""
    for _ in range(draw(st.integers(1, 4))):
        contents = draw(st.lists(_byte, max_size=6).map(bytes))
        kind = draw(st.sampled_from([0x10, 0x10, 0x12, 0x1A, 0x77]))
        packet = rbc(kind, contents, platform=draw(st.sampled_from([0, 1])))
        match draw(st.sampled_from(["", "", "", "", "torn", "sum", "size", "end", "talk"])):
            case "torn":
                packet = packet[: draw(st.integers(1, len(packet) - 1))]
            case "sum":
                packet = packet[:-1] + bytes([packet[-1] ^ 1])
            case "size":
                packet = packet[:10] + bytes([0, draw(st.integers(0, 1)), 0, 0x41]) + packet[14:]
            case "end":
                packet += command(0xE0, 0xFB, b"\x01\x00")
            case "talk":
                packet += command(0xC0, 0x3F) + bytes([draw(_byte)])
        out += packet
    return out


TALK = st.one_of(
    _exchange(), _exchange(), _exchange(), _ten_bit(), _stray_header(), _full_count(), _controller()
)


@st.composite
def _asked(draw: st.DrawFn) -> tuple[bytes, list[bytes]]:
    """Draw a command and its bare reply, which may come behind other commands."""
    index, raw = draw(any_command())
    if not OPS[index].reply:
        return raw, []
    return raw, [
        draw(st.one_of(_two, st.sampled_from([raw[3:5] if len(raw) > 4 else b"\x05\x64"])))
    ]


ASKED = _asked()
