"""Captures of Wireshark's kind, byte by byte, and the programs that write and read them."""

from __future__ import annotations

import io
import shutil
import struct
import subprocess
from typing import TYPE_CHECKING, Final

import pytest

from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.pcapfile.sink import PcapngSink

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from sniffer.ground.model import Batch, Chunk
    from sniffer.protocols.base import BusProtocol

T0: Final = 1_795_215_306_000_000_000

ASK: Final = bytes.fromhex("FFFFFF0104F28C027A")
ANSWER: Final = bytes.fromhex("FFFFFF010400FF07F4")

WIRESHARK: Final = pytest.mark.skipif(
    shutil.which("tshark") is None or shutil.which("editcap") is None,
    reason="needs tshark and editcap: Debian's packages tshark and wireshark-common",
)


def told(*command: str | Path) -> str:
    """Run a program of Wireshark's and return what it says."""
    done = subprocess.run(
        [str(part) for part in command],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    return done.stdout


def fields(path: Path, *names: str, where: str = "") -> list[list[str]]:
    """Return fields of the packets of a capture, as tshark reads it."""
    asked = [part for name in names for part in ("-e", name)]
    chosen = ["-Y", where] if where else []
    out = told("tshark", "-r", path, "-T", "fields", "-E", "aggregator=|", *asked, *chosen)
    return [line.split("\t") for line in out.splitlines()]


def pcap(
    packets: Iterable[tuple[int, bytes]], link: int, *, order: str = "<", nanos: bool = False
) -> bytes:
    """Return a pcap of packets with times in ns (draft-ietf-opsawg-pcap)."""
    magic, unit = (0xA1B23C4D, 1) if nanos else (0xA1B2C3D4, 1000)
    out = struct.pack(f"{order}IHHiIII", magic, 2, 4, 0, 0, 65535, link)
    for t_ns, data in packets:
        seconds, fraction = divmod(t_ns, 10**9)
        out += struct.pack(f"{order}IIII", seconds, fraction // unit, len(data), len(data)) + data
    return out


def block(kind: int, body: bytes, order: str = "<") -> bytes:
    """Return a block of a pcapng (draft-ietf-opsawg-pcapng)."""
    body += bytes(-len(body) % 4)
    size = struct.pack(f"{order}I", len(body) + 12)
    return struct.pack(f"{order}I", kind) + size + body + size


def section(order: str = "<") -> bytes:
    return block(0x0A0D0D0A, struct.pack(f"{order}IHHq", 0x1A2B3C4D, 1, 0, -1), order)


def options(*given: tuple[int, bytes], order: str = "<") -> bytes:
    parts = (struct.pack(f"{order}HH", c, len(v)) + v + bytes(-len(v) % 4) for c, v in given)
    return b"".join(parts) + bytes(4)


def interface(link: int, *given: tuple[int, bytes], order: str = "<", snap: int = 0) -> bytes:
    told = struct.pack(f"{order}HHI", link, 0, snap) + options(*given, order=order)
    return block(1, told, order)


def packet(
    stamp: int, data: bytes, *given: tuple[int, bytes], face: int = 0, order: str = "<"
) -> bytes:
    head = struct.pack(f"{order}IIIII", face, stamp >> 32, stamp & 0xFFFFFFFF, len(data), len(data))
    padded = data + bytes(-len(data) % 4)
    return block(6, head + padded + options(*given, order=order), order)


def rtac(t_ns: int, event: int, data: bytes = b"") -> bytes:
    """Return a packet of LINKTYPE_RTAC_SERIAL, as packet-rtacser.c of Wireshark has it."""
    return struct.pack(">IIBBH", t_ns // 10**9, t_ns % 10**9 // 1000, event, 0, 0) + data


def urb(
    kind: str,
    endpoint: int,
    data: bytes,
    t_ns: int,
    *,
    number: int = 1,
    transfer: int = 3,
    device: int = 7,
    bus: int = 1,
    length: int | None = None,
    setup: bytes = b"",
    head: int = 64,
    order: str = "<",
) -> tuple[int, bytes]:
    """Return a packet of Linux' USB with its time.

    Laid out as ``struct usbmon_packet`` in Documentation/usb/usbmon.rst of Linux, of which the
    first 48 bytes are LINKTYPE_USB_LINUX and all 64 LINKTYPE_USB_LINUX_MMAPPED.
    """
    told = struct.pack(
        f"{order}QBBBBHBBqiiII8sIIII",
        number,
        ord(kind),
        transfer,
        endpoint,
        device,
        bus,
        0 if setup else ord("-"),
        0 if data else ord("<"),
        t_ns // 10**9,
        t_ns % 10**9 // 1000,
        0,
        len(data) if length is None else length,
        len(data),
        setup or bytes(8),
        0,
        0,
        0,
        0,
    )
    return t_ns, told[:head] + data


def windows_urb(
    kind: str,
    endpoint: int,
    data: bytes,
    t_ns: int,
    *,
    number: int = 1,
    transfer: int = 3,
    device: int = 7,
    bus: int = 1,
    stage: int | None = None,
    length: int | None = None,
) -> tuple[int, bytes]:
    """Return a packet of Windows' USB with its time: S submitted, C complete.

    Laid out as ``USBPCAP_BUFFER_PACKET_HEADER`` of desowin.org/usbpcap/captureformat.html and, with
    a stage, ``USBPCAP_BUFFER_CONTROL_HEADER``; always with the low byte first.
    """
    size = 27 if stage is None else 28
    told = struct.pack(
        "<HQIHBHHBBI",
        size,
        number,
        0,
        9 if transfer == 3 else 8,
        int(kind == "C"),
        bus,
        device,
        endpoint,
        transfer,
        len(data) if length is None else length,
    )
    return t_ns, told + (b"" if stage is None else bytes([stage])) + data


class _Heard:
    """A sink that keeps the chunks that sinks are handed."""

    def __init__(self, chunks: list[Chunk]) -> None:
        self._chunks = chunks

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        self._chunks += chunks

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        pass

    def close(self) -> None:
        pass


def written(chunks: Iterable[Chunk], *, also: list[Chunk] | None = None) -> bytes:
    """Return the pcapng that is made of chunks; ``also`` gets those that its sink was handed."""
    file = io.BytesIO()
    heard = _Heard([] if also is None else also)
    pipeline = Pipeline(Options(protocol="mightyzap"), [PcapngSink(file, {}), heard])
    pipeline.feed(chunks)
    pipeline.close()
    pipeline.finish()
    return file.getvalue()
