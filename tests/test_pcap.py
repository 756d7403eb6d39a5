"""Captures of Wireshark's kind as inputs: every form of file, whatever it says of itself."""

from __future__ import annotations

import gzip
import random
import struct
import tracemalloc
from typing import TYPE_CHECKING, Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer.ground.model import (
    Chunk,
    Clock,
    DamagedInputError,
    Direction,
    InputError,
    Mark,
    MarkKind,
)
from sniffer.pcapfile.source import PcapSource
from sniffer.sources import open_source
from tests.commands import sniffer, within
from tests.inputs import SAMPLES, chunks, refusal, until_damage
from tests.pcaps import (
    ANSWER,
    ASK,
    T0,
    WIRESHARK,
    block,
    interface,
    packet,
    pcap,
    rtac,
    section,
    told,
    urb,
    written,
)

if TYPE_CHECKING:
    from pathlib import Path

Capsys = pytest.CaptureFixture[str]

RTAC, USER0, ETHERNET = 250, 147, 1
NAME, SPEED, RESOLUTION, OFFSET, FLAGS = 2, 8, 9, 14, 2

LATER: Final = T0 + 5_000_000
PAIR: Final = [(T0, rtac(T0 - 1_600_000, 1, ASK)), (LATER, rtac(LATER - 1_600_000, 2, ANSWER))]
HEARD: Final = [
    Chunk(ASK, T0, Clock.FILE, "bus0", Direction.TX),
    Chunk(ANSWER, LATER, Clock.FILE, "bus0", Direction.RX),
]


@pytest.mark.parametrize("nanos", [False, True], ids=["us", "ns"])
@pytest.mark.parametrize("order", ["<", ">"], ids=["little", "big"])
def test_a_pcap_is_read_in_both_orders_of_bytes_and_both_resolutions(
    order: str, nanos: bool
) -> None:
    assert chunks(pcap(PAIR, RTAC, order=order, nanos=nanos)) == HEARD
    assert open_source(pcap(PAIR, RTAC, order=order, nanos=nanos)).format == "pcap"


@pytest.mark.parametrize(
    ("resolution", "unit"),
    [(b"\x09", 10**9), (b"\x06", 10**6), (b"\x03", 1000), (b"\x9e", 1 << 30), (b"\x00", 1)],
)
@pytest.mark.parametrize("order", ["<", ">"], ids=["little", "big"])
def test_stamps_of_a_pcapng_are_in_the_unit_that_its_interface_says(
    resolution: bytes, unit: int, order: str
) -> None:
    seconds = T0 // 10**9
    since = struct.pack(f"{order}q", 1000)
    data = section(order) + interface(
        USER0, (NAME, b"arm"), (RESOLUTION, resolution), (OFFSET, since), order=order
    )
    data += packet((seconds - 1000) * unit, ASK, order=order)
    tick = 10**9 // unit
    if unit > 10**5:
        assert chunks(data) == [Chunk(ASK, T0, Clock.FILE, "arm")]
    else:  # at some time until the clock shows the next one
        mark = Mark(MarkKind.COARSE, 0, len(ASK), tick)
        assert chunks(data) == [Chunk(ASK, T0 + tick - 1, Clock.FILE, "arm", marks=(mark,))]


def test_a_user_link_type_is_bytes_whose_flags_tell_the_wire() -> None:
    out, back = struct.pack("<I", 2), struct.pack("<I", 1)
    data = section() + interface(162) + interface(USER0, (NAME, b"leg"))
    data += packet(1, ASK, (FLAGS, out)) + packet(2, ANSWER, (FLAGS, back), face=1)
    data += packet(3, ASK, face=1)
    assert [(k.bus, k.direction, k.data) for k in chunks(data)] == [
        ("bus0", Direction.TX, ASK),
        ("leg", Direction.RX, ANSWER),
        ("leg", Direction.UNKNOWN, ASK),
    ]


def test_sections_begin_anew_and_unknown_blocks_are_passed_over() -> None:
    strange = block(0x0BAD, bytes(400)) + block(0x0000000A, b"secret")
    first = section() + strange + interface(USER0, (NAME, b"a")) + packet(1, ASK) + strange
    second = section(">") + interface(USER0, (NAME, b"b"), order=">") + packet(2, ANSWER, order=">")
    assert [(k.bus, k.data) for k in chunks(first + second)] == [
        ("a", ASK), ("b", ANSWER),
    ]  # fmt: skip


def test_a_simple_packet_and_an_obsolete_one_are_read_too() -> None:
    simple = block(3, struct.pack("<I", len(ASK)) + ASK)
    old = block(2, struct.pack("<HHIIII", 0, 0, 0, 5, len(ANSWER), len(ANSWER)) + ANSWER)
    assert chunks(section() + interface(USER0) + simple + old) == [
        Chunk(ASK),
        Chunk(ANSWER, 5000, Clock.FILE),
    ]


def test_bytes_that_were_not_captured_are_marked_lost() -> None:
    short = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 4, USER0)
    short += struct.pack("<IIII", 1, 0, 4, len(ASK)) + ASK[:4]
    assert chunks(short) == [
        Chunk(ASK[:4], 10**9, Clock.FILE, marks=(Mark(MarkKind.OVERRUN, 4, 0, 5),))
    ]


@pytest.mark.parametrize(
    ("event", "kind"),
    [
        (5, MarkKind.OVERRUN),
        (7, MarkKind.FRAMING),
        (8, MarkKind.PARITY),
        (9, MarkKind.BREAK),
        (10, MarkKind.OVERRUN),
    ],
)
def test_an_error_event_is_a_mark_on_the_byte_before_it(event: int, kind: MarkKind) -> None:
    told_ = chunks(pcap([PAIR[0], (LATER, rtac(LATER, event))], RTAC))
    assert told_[1].marks == (Mark(kind, -1, 1),)
    assert not told_[1].data


def test_a_stamp_of_the_first_byte_is_moved_to_the_last_where_the_rate_is_stated() -> None:
    """A head of the packet's own time says that the packet was stamped when it began."""
    began = rtac(T0, 1, ASK)
    speed = (SPEED, struct.pack("<Q", 57600))
    stated = section() + interface(RTAC, (RESOLUTION, b"\x09"), speed) + packet(T0, began)
    assert chunks(stated)[0].t_ns == T0 + 9 * (10 * 10**9 // 57600)
    assert open_source(stated).facts() == {"baud.bus0": "57600"}
    unstated = open_source(pcap([(T0, began)], RTAC))
    assert [k.t_ns for group in unstated for k in group] == [T0]
    assert "stamped with their first byte and no rate is stated" in unstated.notes[0]


def test_the_stored_capture_of_another_program_is_read() -> None:
    heard = chunks(SAMPLES / "rtac.pcap")
    assert [k.direction for k in heard if k.data][:2] == [Direction.TX, Direction.RX]
    assert any(mark.kind == MarkKind.FRAMING for k in heard for mark in k.marks)


@pytest.mark.parametrize(
    ("link", "says"),
    [(ETHERNET, "Ethernet"), (266, "USB of macOS"), (999, "link type 999")],
)
def test_other_links_are_refused_with_what_is_read(link: int, says: str) -> None:
    message = refusal(pcap([(T0, ASK)], link))
    assert f"a capture of {says} is not read" in message
    assert "tshark -r FILE -T fields -e data" in message
    assert ("-e usb.capdata" in message) == ("USB" in says)


def test_packets_of_other_interfaces_are_left_out_and_said() -> None:
    data = section() + interface(USER0) + interface(ETHERNET, (NAME, b"eth0"))
    data += packet(1, ASK) + packet(2, bytes(60), face=1) + packet(3, bytes(60), face=1)
    source = open_source(data)
    assert [k.data for group in source for k in group] == [ASK]
    assert source.notes == ["2 packets of Ethernet on eth0 are left out"]


def test_the_modified_kind_is_refused_by_name() -> None:
    assert "modified pcap capture (a1b2cd34)" in refusal(b"\xa1\xb2\xcd\x34" + bytes(40))


def test_packed_captures_and_pipes_are_read(tmp_path: Path) -> None:
    data = pcap(PAIR, RTAC)
    packed = tmp_path / "x.pcap.gz"
    packed.write_bytes(gzip.compress(data))
    assert chunks(packed) == HEARD
    ran = sniffer("decode", "-", "--format", "jsonl", data=written(HEARD))
    assert ran.status == 0
    assert ran.out.count('"type":"frame"') == 2


@pytest.mark.parametrize("capture", [pcap(PAIR, RTAC), written(HEARD * 3)], ids=["pcap", "pcapng"])
def test_a_capture_that_is_cut_anywhere_gives_what_came_before(capture: bytes) -> None:
    whole = b"".join(k.data for k in chunks(capture))
    for end in range(len(capture)):
        got, _ = _as_far_as_it_goes(capture[:end])
        assert whole.startswith(b"".join(k.data for k in got))
    cut = capture[:-3]
    assert until_damage(cut)[1].endswith("the file is cut off here")


def _as_far_as_it_goes(data: bytes) -> tuple[list[Chunk], str]:
    """Return what is read of a capture, and why it ends, empty where that is its end."""
    got: list[Chunk] = []
    try:
        got += PcapSource(_Slowly(data), "bus0")
    except (DamagedInputError, InputError) as error:
        return got, str(error)
    return got, ""


class _Slowly:
    """A stream that gives a few bytes at a time, as a pipe may."""

    def __init__(self, data: bytes) -> None:
        self._data = data

    def read(self, size: int, /) -> bytes:
        out, self._data = self._data[: min(size, 7)], self._data[min(size, 7) :]
        return out


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (section() + struct.pack("<II", 6, 0xFFFFFFF0), "a block of 4294967280 bytes"),
        (section() + struct.pack("<II", 6, 13), "a block cannot have 13 bytes"),
        (section() + packet(1, ASK), "interface 0, which nobody described"),
        (section() + interface(USER0) + block(6, bytes(8)), "a packet is cut"),
        (section() + interface(USER0)[:-4] + bytes(4), "says two lengths"),
        (
            section() + interface(USER0) + block(6, struct.pack("<IIIII", 0, 0, 0, 999, 999)),
            "a packet of 999 bytes is in a block that is too small",
        ),
        (
            section() + interface(USER0, (RESOLUTION, b"\x00")) + packet((1 << 64) - 1, ASK),
            "a packet has a time that cannot be",
        ),
        (pcap([], USER0) + struct.pack("<IIII", 0, 0, 1 << 31, 1 << 31), "cannot have 2147483648"),
        (section()[:8] + b"abcd" + section()[12:], ""),
    ],
)
def test_numbers_that_lie_end_the_reading_in_one_line(
    data: bytes, says: str, capsys: Capsys, tmp_path: Path
) -> None:
    path = tmp_path / "x.pcapng"
    path.write_bytes(data)
    ran = within(capsys, "decode", path, "--input-format", "pcap", "--protocol", "mightyzap")
    assert ran.status == 3
    assert says in ran.complaint


def test_what_came_before_the_damage_is_decoded(capsys: Capsys, tmp_path: Path) -> None:
    path = tmp_path / "x.pcapng"
    path.write_bytes(section() + interface(USER0) + packet(1, ASK) + struct.pack("<II", 6, 13))
    ran = within(capsys, "decode", path, "--protocol", "mightyzap", "--format", "jsonl")
    assert ran.status == 3
    assert "a block cannot have 13 bytes" in ran.complaint
    assert ran.out.count('"type":"frame"') == 1


class _Endless:
    """A block of 4 GB that nobody knows, of which 64 MB are there."""

    def __init__(self) -> None:
        self._head = section() + struct.pack("<II", 0x0BAD, 0xFFFFFFF0)
        self._left = 1 << 26

    def read(self, size: int, /) -> bytes:
        if self._head:
            head, self._head = self._head, b""
            return head
        size = min(size, self._left)
        self._left -= size
        return bytes(size)


def test_a_block_that_claims_gigabytes_takes_no_memory() -> None:
    tracemalloc.start()
    try:
        with pytest.raises(DamagedInputError, match="cut off here"):
            list(PcapSource(_Endless(), "bus0"))
        assert tracemalloc.get_traced_memory()[1] < 4 << 20
    finally:
        tracemalloc.stop()


def test_more_devices_than_usb_has_are_damage() -> None:
    told = [urb("S", 2, ASK, T0, device=n % 256, bus=n // 256) for n in range(300)]
    assert "more than 256 devices on USB" in until_damage(pcap(told, 220))[1]


def test_more_interfaces_than_buses_are_damage() -> None:
    data = section() + interface(USER0, (NAME, b"a")) + packet(1, ASK) + interface(USER0) * 300
    assert until_damage(data)[0] == ASK
    assert "more than 256 interfaces" in until_damage(data)[1]


@given(st.integers(0, 2**32))
def test_a_harmed_capture_raises_nothing_but_our_own_errors(seed: int) -> None:
    rng = random.Random(seed)
    data = bytearray(HARMED[seed % len(HARMED)])
    for _ in range(rng.choice((1, 2, 6))):
        at = rng.randrange(len(data))
        data[at : at + rng.choice((1, 1, 4))] = rng.choice(
            (rng.randbytes(1), b"\xff\xff\xff\xff", b"\0\0\0\0", b"")
        )
    got, why = _as_far_as_it_goes(bytes(data))
    assert sum(len(k.data) for k in got) <= len(data)
    assert why.isprintable()


HARMED: Final = (written(HEARD * 2), pcap(PAIR, RTAC), section(">") + interface(USER0, order=">"))


@WIRESHARK
def test_what_text2pcap_writes_is_read_with_wire_and_time(tmp_path: Path) -> None:
    out = tmp_path / "x.pcapng"
    stamps = "%Y-%m-%d %H:%M:%S.%f"
    told("text2pcap", "-q", "-D", "-t", stamps, "-l", "147", SAMPLES / "t2p.txt", out)
    heard = chunks(out)
    assert [k.direction for k in heard] == [Direction.TX, Direction.RX]
    assert heard[0].data == bytes.fromhex("faaf010f2a020026")
    assert [k.t_ns is not None and k.t_ns % 10**9 for k in heard] == [100_000, 1_900_000]


@WIRESHARK
@pytest.mark.parametrize("form", ["pcap", "nsecpcap"])
def test_what_editcap_moves_in_time_is_moved_here(form: str, tmp_path: Path) -> None:
    (tmp_path / "x.pcapng").write_bytes(written(HEARD))
    told("editcap", "-F", form, "-t", "3600", tmp_path / "x.pcapng", tmp_path / "y")
    assert [k.t_ns for k in chunks(tmp_path / "y")] == [t + 3600 * 10**9 for t in (T0, LATER)]
    told("editcap", "-F", "modpcap", tmp_path / "x.pcapng", tmp_path / "z")
    assert "modified pcap" in refusal(tmp_path / "z")
