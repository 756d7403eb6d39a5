"""USB as Linux records it: what the controller's own adapter said, without a tap.

Packets are laid out byte by byte after ``Documentation/usb/usbmon.rst`` of Linux; tshark takes them
for what they are meant to be. Status bytes are those of FTDI's AN232B-04.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Final

import pytest

from sniffer.ground.model import Chunk, Clock, Direction, Mark, MarkKind
from sniffer.pcapfile import source
from sniffer.sources import open_source
from tests.commands import within
from tests.inputs import chunks
from tests.pcaps import ANSWER, ASK, T0, WIRESHARK, fields, pcap, urb

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

Capsys = pytest.CaptureFixture[str]

USB, USB_SHORT = 220, 189
MS: Final = 1_000_000
STATUS: Final = b"\x01\x60"
FTDI, CH340, CP210X = (0x0403, 0x6001), (0x1A86, 0x7523), (0x10C4, 0xEA60)

Packets = list[tuple[int, bytes]]


def talk(
    *, status: bytes = b"", count: int = 40, device: int = 7, begin: int = T0, head: int = 64
) -> Packets:
    """Return exchanges of a controller with a servo: 20 ms each, answers after 5 ms."""
    out: Packets = []
    for nth in range(count):
        t = begin + nth * 20 * MS
        out += [
            urb("S", 0x02, ASK, t, number=nth, device=device, head=head),
            urb("C", 0x02, b"", t + 100_000, number=nth, device=device, length=9, head=head),
            urb("C", 0x81, status + ANSWER, t + 5 * MS, device=device, head=head),
            urb("S", 0x81, b"", t + 5 * MS + 100_000, device=device, length=512, head=head),
        ]
        if status:  # the timer is over, and nothing came
            out.append(urb("C", 0x81, status, t + 18 * MS, device=device, head=head))
    return out


def described(ids: tuple[int, int], release: int = 0x0600, device: int = 7) -> Packets:
    """Return what libpcap asks of each device when a capture begins: its descriptor."""
    asked = struct.pack("<BBHHH", 0x80, 6, 0x0100, 0, 18)
    body = struct.pack("<BBHBBBBHHHBBBB", 18, 1, 0x0200, 0, 0, 0, 8, *ids, release, 1, 2, 3, 1)
    return [
        urb("S", 0x80, b"", T0 - 9 * MS, number=99, transfer=2, device=device, setup=asked),
        urb("C", 0x80, body, T0 - 8 * MS, number=99, transfer=2, device=device),
    ]


def asked(
    to: int, request: int, value: int, index: int = 0, data: bytes = b"", device: int = 7
) -> Packets:
    setup = struct.pack("<BBHHH", to, request, value, index, len(data))
    return [urb("S", 0, data, T0 - MS, transfer=2, setup=setup, device=device)]


def heard(data: bytes) -> tuple[list[Chunk], list[str], dict[str, str]]:
    opened = open_source(data)
    facts = dict(opened.facts())
    return [k for group in opened for k in group], opened.notes, facts


@pytest.mark.parametrize(("link", "head"), [(USB, 64), (USB_SHORT, 48)])
def test_requests_are_what_is_handed_over_and_answers_what_has_come(link: int, head: int) -> None:
    got = chunks(pcap(talk(status=STATUS, head=head), link))
    assert got[:3] == [
        Chunk(ASK, T0, Clock.FILE, "1.7", Direction.TX),
        Chunk(ANSWER, T0 + 5 * MS, Clock.FILE, "1.7", Direction.RX),
        Chunk(ASK, T0 + 20 * MS, Clock.FILE, "1.7", Direction.TX),
    ]
    assert len(got) == 80


def test_heads_in_the_other_order_of_bytes_are_read() -> None:
    told = [urb("S", 2, ASK, T0, order=">"), urb("C", 0x81, ANSWER, T0 + MS, order=">")] * 20
    assert [k.data for k in chunks(pcap(told, USB, order=">"))] == [ASK, ANSWER] * 20


@pytest.mark.parametrize(
    ("ids", "status", "says"),
    [
        (FTDI, STATUS, "2 status bytes a packet (FTDI FT232R, by its descriptor)"),
        (CH340, b"", "without status bytes (CH340, by its descriptor)"),
        (CP210X, b"", "without status bytes (CP2102, by its descriptor)"),
        (None, STATUS, "2 status bytes a packet (FTDI, by its content)"),
        (None, b"", "without status bytes (not FTDI, by its content)"),
    ],
)
def test_status_bytes_are_left_out_where_descriptor_or_content_say_so(
    ids: tuple[int, int] | None, status: bytes, says: str
) -> None:
    told = (described(ids) if ids else []) + talk(status=status)
    got, notes, _ = heard(pcap(told, USB))
    assert b"".join(k.data for k in got) == (ASK + ANSWER) * 40
    assert len(notes) == 1
    assert says in notes[0]


def test_bytes_like_a_status_are_kept_where_the_descriptor_says_there_is_none() -> None:
    told = described(CH340) + [urb("C", 0x81, STATUS + ANSWER, T0)] * 20
    assert {k.data for k in chunks(pcap(told, USB))} == {STATUS + ANSWER}


@pytest.mark.parametrize(
    ("release", "size"), [(0x0600, 64), (0x0900, 512), (0, 64)], ids=["full", "high", "unsaid"]
)
def test_each_usb_packet_of_a_transfer_has_its_status_bytes(release: int, size: int) -> None:
    payload = ANSWER * 20
    parts = [payload[at : at + size - 2] for at in range(0, len(payload), size - 2)]
    told = described(FTDI, release) if release else []
    told += [*talk(status=STATUS), urb("C", 0x81, b"".join(STATUS + p for p in parts), T0 + 10**9)]
    assert chunks(pcap(told, USB))[-1].data == payload


def test_line_errors_of_the_status_byte_are_marks() -> None:
    told = described(FTDI) + talk(status=STATUS)
    told.append(urb("C", 0x81, b"\x01\x68" + ANSWER, T0 + 10**9))
    last = chunks(pcap(told, USB))[-1]
    assert last.data == ANSWER
    assert last.marks == (Mark(MarkKind.FRAMING, 0, 9),)


@pytest.mark.parametrize(
    ("ids", "release", "setting"),
    [
        (FTDI, 0x0600, asked(0x40, 3, 0xC034)),  # 52 1/8 of 3 MHz
        (FTDI, 0x0900, asked(0x40, 3, 0xC034, 0x0001)),
        (FTDI, 0x0900, asked(0x40, 3, 0x00D0, 0x0201)),  # 208 of 12 MHz, port 1
        (CP210X, 0x0100, asked(0x41, 0x1E, 0, 0, struct.pack("<I", 57600))),
        ((0x0483, 0x5740), 0x0200, asked(0x21, 0x20, 0, 0, struct.pack("<IBBB", 57600, 0, 0, 8))),
    ],
    ids=["FT232R", "FT232H slow", "FT232H fast", "CP2102", "CDC ACM"],
)
def test_a_rate_that_the_controller_sets_is_taken_and_requests_end_when_they_are_sent(
    ids: tuple[int, int], release: int, setting: Packets
) -> None:
    status = STATUS if ids == FTDI else b""
    got, _, facts = heard(pcap(described(ids, release) + setting + talk(status=status), USB))
    assert facts["baud.1.7"] == "57600"
    assert got[0].t_ns == T0 + 9 * (10 * 10**9 // 57600)
    assert got[1].t_ns == T0 + 5 * MS


@pytest.mark.parametrize(
    ("told", "held_ms"),
    [
        (described(FTDI) + talk(status=STATUS), 17),
        (described(FTDI) + asked(0x40, 9, 1) + talk(status=STATUS), 2),
        (described(CH340) + talk(), 2),
        (talk(), 17),
    ],
    ids=["FTDI", "FTDI quick", "CH340", "unknown"],
)
def test_answers_may_have_come_earlier_by_what_the_adapter_holds_them(
    told: Packets, held_ms: int, capsys: Capsys, tmp_path: Path
) -> None:
    path = tmp_path / "x.pcap"
    path.write_bytes(pcap(told, USB))
    assert heard(path.read_bytes())[2]["latency_ns.1.7"] == str(held_ms * MS)
    ran = within(capsys, "decode", path, "--baud", "57600", "--summary", "--format", "jsonl")
    assert f'"latency_ns":{held_ms * MS}' in ran.out.replace(" ", "")


def test_of_several_devices_those_that_speak_like_servos_are_buses(
    capsys: Capsys, tmp_path: Path
) -> None:
    disk = [urb("S", 2, b"USBC" + bytes(27), T0 + n * MS, device=3) for n in range(20)]
    camera = [urb("C", 0x81, bytes([n]) * 400, T0 + n * MS, device=4) for n in range(120)]
    second = talk(device=9, begin=T0 + 10**9)
    told = sorted(disk + camera + talk(status=STATUS) + second, key=lambda p: p[0])
    path = tmp_path / "x.pcap"
    path.write_bytes(pcap(told, USB))
    ran = within(capsys, "decode", path, "--format", "jsonl", "-q", "-o", tmp_path / "x.jsonl")
    assert ran.status == 0
    out = (tmp_path / "x.jsonl").read_text(encoding="utf-8")
    assert '"bus":"1.7"' in out
    assert '"bus":"1.9"' in out
    assert '"bus":"1.3"' not in out
    got, notes, _ = heard(path.read_bytes())
    assert {k.bus for k in got} == {"1.7", "1.9"}
    assert sorted(n for n in notes if "speaks no protocol" in n) == [
        "1.3 is left out: 620 bytes of a USB device that speaks no protocol of servos",
        "1.4 is left out: 48000 bytes of a USB device that speaks no protocol of servos",
    ]


def test_a_device_that_is_alone_is_shown_whatever_it_says() -> None:
    told = [urb("C", 0x81, bytes([n, 0x55]), T0 + n * MS) for n in range(2, 9)]
    assert len(chunks(pcap(told, USB))) == 7


@pytest.mark.parametrize("held", [source.HELD_BYTES, 40_000])
def test_all_of_a_device_that_is_alone_is_shown_however_much_it_says(
    held: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(source, "HELD_BYTES", held)
    told = [urb("C", 0x81, bytes([n % 251, 0x55]) * 20, T0 + n * MS) for n in range(2200)]
    got, notes, _ = heard(pcap(told, USB))
    assert sum(len(k.data) for k in got) == 2200 * 40
    assert not [n for n in notes if "left out" in n]


def test_of_two_devices_that_speak_no_protocol_each_that_is_left_out_is_told() -> None:
    both = [
        urb("C", 0x81, bytes([n % 251, 0x55]) * 20, T0 + n * MS, device=3 + n % 2)
        for n in range(4400)
    ]
    got, notes, _ = heard(pcap(both, USB))
    assert not got
    assert sorted(n.partition(" of")[0] for n in notes if "left out" in n) == [
        "1.3 is left out: 88000 bytes",
        "1.4 is left out: 88000 bytes",
    ]


def test_two_ports_of_one_chip_are_two_buses() -> None:
    def moved() -> Iterator[tuple[int, bytes]]:
        for t_ns, data in talk(status=STATUS):
            out = bytearray(data)
            out[10] += 2  # the endpoints of the second port
            yield t_ns, bytes(out)

    told = sorted(described(FTDI, 0x0700) + talk(status=STATUS) + list(moved()))
    assert {k.bus for k in chunks(pcap(told, USB))} == {"1.7", "1.7.2"}


def test_a_head_that_is_cut_says_nothing() -> None:
    told = [*talk(), (T0, bytes(20))]
    assert len(chunks(pcap(told, USB))) == 80


def test_a_capture_that_only_sets_devices_up_is_said_to_have_no_bytes(
    capsys: Capsys, tmp_path: Path
) -> None:
    path = tmp_path / "x.pcap"
    path.write_bytes(pcap(asked(0x40, 3, 0x34), USB))
    ran = within(capsys, "decode", path)
    assert ran.status == 2
    assert "no bytes to decode: there are none in its 1 packet, which set devices" in ran.complaint


@WIRESHARK
def test_tshark_takes_the_packets_for_what_they_are_meant_to_be(tmp_path: Path) -> None:
    path = tmp_path / "x.pcap"
    told = described(FTDI) + asked(0x40, 3, 0xC034) + talk(status=STATUS, count=2)
    path.write_bytes(pcap(told, USB))
    seen = fields(
        path, "usb.urb_type", "usb.endpoint_address", "usb.transfer_type", "usb.idVendor",
        where="usb",
    )  # fmt: skip
    assert len(seen) == len(told)
    assert seen[1][3] == "0x0403"
    assert [line[:3] for line in seen[3:6]] == [
        ["'S'", "0x02", "0x03"], ["'C'", "0x02", "0x03"], ["'C'", "0x81", "0x03"],
    ]  # fmt: skip
