"""USB as Windows records it (USBPcap): the vendors' programs run there, and no tap is needed.

Packets are laid out byte by byte after the capture format of USBPcap; tshark takes them for what
they are meant to be.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Final

import pytest

from sniffer.ground.model import Chunk, Clock, Direction, Mark, MarkKind
from sniffer.sources import open_source
from tests.commands import within
from tests.inputs import chunks
from tests.pcaps import (
    ANSWER,
    ASK,
    T0,
    WIRESHARK,
    fields,
    interface,
    packet,
    pcap,
    section,
    windows_urb,
)

if TYPE_CHECKING:
    from pathlib import Path

Capsys = pytest.CaptureFixture[str]
Packets = list[tuple[int, bytes]]

USB, LINUX = 249, 220
MS: Final = 1_000_000
STATUS: Final = b"\x01\x60"
FTDI, CP210X = (0x0403, 0x6001), (0x10C4, 0xEA60)
SETUP, DATA, STATUS_STAGE, COMPLETE = 0, 1, 2, 3


def talk(*, status: bytes = b"", count: int = 40, device: int = 7) -> Packets:
    """Return exchanges of a controller with a servo: 20 ms each, answers after 5 ms."""
    out: Packets = []
    for nth in range(count):
        t = T0 + nth * 20 * MS
        out += [
            windows_urb("S", 0x02, ASK, t, number=nth, device=device),
            windows_urb("C", 0x02, b"", t + 100_000, number=nth, device=device),
            windows_urb("C", 0x81, status + ANSWER, t + 5 * MS, number=1000, device=device),
            windows_urb("S", 0x81, b"", t + 5 * MS + 100_000, number=1000, device=device),
        ]
        if status:  # the timer is over, and nothing came
            out.append(windows_urb("C", 0x81, status, t + 18 * MS, number=1000, device=device))
    return out


def control(endpoint: int, kind: str, stage: int, data: bytes, t_ns: int) -> tuple[int, bytes]:
    return windows_urb(kind, endpoint, data, t_ns, number=99, transfer=2, stage=stage)


def described(ids: tuple[int, int], *, release: int = 0x0600, in_data: bool = False) -> Packets:
    """Return what USBPcap puts before a capture of what is plugged in: the descriptor.

    ``in_data``: in a data stage, as older versions have it, else with the completion.
    """
    asked = struct.pack("<BBHHH", 0x80, 6, 0x0100, 0, 18)
    body = struct.pack("<BBHBBBBHHHBBBB", 18, 1, 0x0200, 0, 0, 0, 8, *ids, release, 1, 2, 3, 1)
    return [
        control(0x80, "S", SETUP, asked, T0 - 9 * MS),
        control(0x80, "C", DATA if in_data else COMPLETE, body, T0 - 8 * MS),
    ]


def asked(
    to: int, request: int, value: int, data: bytes = b"", *, in_data: bool = False
) -> Packets:
    """Return a request to a device; ``in_data``: what is sent with it has a packet of its own."""
    setup = struct.pack("<BBHHH", to, request, value, 0, len(data))
    if in_data:
        return [
            control(0, "S", SETUP, setup, T0 - 2 * MS),
            control(0, "S", DATA, data, T0 - 2 * MS),
            control(0, "C", STATUS_STAGE, b"", T0 - MS),
        ]
    return [
        control(0, "S", SETUP, setup + data, T0 - 2 * MS),
        control(0, "C", COMPLETE, b"", T0 - MS),
    ]


def heard(data: bytes) -> tuple[list[Chunk], list[str], dict[str, str]]:
    source = open_source(data)
    facts = dict(source.facts())
    return [k for group in source for k in group], source.notes, facts


@pytest.mark.parametrize("order", ["<", ">"])
def test_requests_are_what_is_handed_over_and_answers_what_has_come(order: str) -> None:
    got = chunks(pcap(talk(status=STATUS), USB, order=order))
    assert got[:3] == [
        Chunk(ASK, T0, Clock.FILE, "1.7", Direction.TX),
        Chunk(ANSWER, T0 + 5 * MS, Clock.FILE, "1.7", Direction.RX),
        Chunk(ASK, T0 + 20 * MS, Clock.FILE, "1.7", Direction.TX),
    ]
    assert len(got) == 80


@pytest.mark.parametrize(
    "in_data", [False, True], ids=["with the completion", "a stage of its own"]
)
@pytest.mark.parametrize(
    ("ids", "status", "says"),
    [
        (FTDI, STATUS, "2 status bytes a packet (FTDI FT232R, by its descriptor)"),
        (CP210X, b"", "without status bytes (CP2102, by its descriptor)"),
    ],
)
def test_the_descriptor_tells_whether_there_are_status_bytes(
    ids: tuple[int, int], status: bytes, says: str, in_data: bool
) -> None:
    got, notes, _ = heard(pcap(described(ids, in_data=in_data) + talk(status=status), USB))
    assert b"".join(k.data for k in got) == (ASK + ANSWER) * 40
    assert len(notes) == 1
    assert says in notes[0]


@pytest.mark.parametrize("in_data", [False, True], ids=["with the setup", "a stage of its own"])
@pytest.mark.parametrize(
    ("ids", "to", "request_", "value", "data"),
    [
        (FTDI, 0x40, 3, 0xC034, b""),  # 52 1/8 of 3 MHz
        (CP210X, 0x41, 0x1E, 0, struct.pack("<I", 57600)),
        ((0x0483, 0x5740), 0x21, 0x20, 0, struct.pack("<IBBB", 57600, 0, 0, 8)),
    ],
    ids=["FT232R", "CP2102", "CDC ACM"],
)
def test_a_rate_that_the_controller_sets_is_taken(
    ids: tuple[int, int], to: int, request_: int, value: int, data: bytes, in_data: bool
) -> None:
    status = STATUS if ids == FTDI else b""
    setting = asked(to, request_, value, data, in_data=in_data)
    got, _, facts = heard(pcap(described(ids) + setting + talk(status=status), USB))
    assert facts["baud.1.7"] == "57600"
    assert got[0].t_ns == T0 + 9 * (10 * 10**9 // 57600)


def test_what_a_capture_has_cut_off_is_lost_bytes() -> None:
    told = [*talk(), windows_urb("C", 0x81, ANSWER[:4], T0 + 10**9, length=9)]
    assert chunks(pcap(told, USB))[-1].marks == (Mark(MarkKind.OVERRUN, 4, 0, 5),)


@pytest.mark.parametrize("size", [0, 10, 26, 27])
def test_a_head_that_is_cut_or_longer_than_its_packet_says_nothing(size: int) -> None:
    whole = windows_urb("C", 0x81, b"", T0)[1]
    broken = whole[:size] if size < 27 else struct.pack("<H", 99) + whole[2:]
    assert len(chunks(pcap([*talk(), (T0, broken)], USB))) == 80


def test_a_control_transfer_without_a_stage_says_nothing() -> None:
    told = [windows_urb("S", 0, b"", T0 - MS, transfer=2), *talk()]
    assert len(chunks(pcap(told, USB))) == 80


def test_a_pcapng_of_windows_is_decoded(capsys: Capsys, tmp_path: Path) -> None:
    told = described(FTDI) + asked(0x40, 3, 0xC034) + talk(status=STATUS)
    path = tmp_path / "x.pcapng"
    nanos = (9, b"\x09")  # if_tsresol
    path.write_bytes(
        section() + interface(USB, nanos) + b"".join(packet(t, data) for t, data in told)
    )
    ran = within(capsys, "decode", path, "--summary")
    assert ran.status == 0
    assert "720 bytes = 720 in 80 frames" in ran.out
    assert "exchanges: 40 ok" in ran.out
    assert "assumed to run" not in ran.out, "the rate that was set is known"


@WIRESHARK
def test_tshark_takes_the_packets_for_what_they_are_meant_to_be(tmp_path: Path) -> None:
    path = tmp_path / "x.pcap"
    told = described(FTDI) + asked(0x40, 3, 0xC034) + talk(status=STATUS, count=2)
    path.write_bytes(pcap(told, USB))
    seen = fields(
        path, "usb.irp_info.direction", "usb.endpoint_address", "usb.transfer_type",
        "usb.idVendor", where="usb",
    )  # fmt: skip
    assert len(seen) == len(told)
    assert seen[1][3] == "0x0403"
    assert [line[:3] for line in seen[4:7]] == [
        ["0x00", "0x02", "0x03"], ["0x01", "0x02", "0x03"], ["0x01", "0x81", "0x03"],
    ]  # fmt: skip
