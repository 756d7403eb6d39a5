"""Captures of pcap and pcapng as chunks: serial lines, and adapters on USB."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Final

from sniffer.decoding.detect import ENOUGH, UndecidedError, detect
from sniffer.ground.limits import BUSES_MOST
from sniffer.ground.model import DamagedInputError, InputError
from sniffer.ground.wording import counted
from sniffer.pcapfile.layout import (
    RTAC_SERIAL,
    USB_LINKS,
    USER_FIRST,
    USER_LAST,
)
from sniffer.pcapfile.reader import PacketReader
from sniffer.pcapfile.serial import SerialLine, stated_baud
from sniffer.pcapfile.usb import UsbDevices

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.ground.files import Stream
    from sniffer.ground.model import Chunk
    from sniffer.pcapfile.reader import CapturedPacket, CaptureFace

FIRST_LOOK: Final = 256
"""Bytes of a USB device after which it is looked for the first time whether servos speak there."""

CHUNKS_MOST: Final = 1 << 11
"""Chunks of it by which that is told at last."""

HELD_CHUNKS: Final = 1 << 17
HELD_BYTES: Final = 1 << 24
"""What a device that is alone, and no servo, may say before it is taken as it is: a second one may
yet turn up, which speaks to servos."""

HEAD_MOST: Final = 1 << 16
"""Bytes at the begin of a capture that are searched for what it says of itself ..."""

FACTS_MOST: Final = 1 << 22
"""... and of one of USB, where a device may be heard of later."""

_STORAGE: Final = b"USBC"  # a command of a disk (USB mass storage, bulk-only transport, 5.1)

_LINKS: Final = {
    1: "Ethernet",
    105: "Wi-Fi",
    113: "any interface of Linux",
    127: "Wi-Fi",
    190: "CAN",
    227: "CAN (SocketCAN)",
    266: "USB of macOS",
    276: "any interface of Linux",
}


class _Candidate:
    """A line on USB whose chunks wait until they are known for those of servos."""

    def __init__(self) -> None:
        self.chunks: list[Chunk] = []
        self.size = 0
        self.is_servo: bool | None = None
        self.is_taken = False
        """Whether its chunks are handed on, whatever it is."""
        self.is_left_out = False
        """Whether some of its chunks are gone."""
        self._look_at = FIRST_LOOK

    def add(self, chunk: Chunk) -> None:
        """Take a chunk, and look whenever there is twice as much as before."""
        self.chunks.append(chunk)
        self.size += len(chunk.data)
        if self.is_servo is None and self.size >= self._look_at:
            self._look_at = 2 * self.size
            self.look()

    def look(self) -> None:
        """Tell whether servos speak here; beyond ``ENOUGH`` bytes there is no doubt left."""
        with contextlib.suppress(UndecidedError):
            detect(self.chunks)
            self.is_servo = True
        if self.is_servo is None and (self.size >= ENOUGH or len(self.chunks) >= CHUNKS_MOST):
            self.is_servo = False
        self.is_taken = bool(self.is_servo)

    @property
    def is_full(self) -> bool:
        """Whether no more chunks may wait."""
        return self.size >= HELD_BYTES or len(self.chunks) >= HELD_CHUNKS

    def leave_out(self) -> None:
        """Let go of what waits, and of all that comes."""
        self.is_left_out = True
        self.chunks.clear()

    def given(self) -> list[Chunk]:
        """Return what waits, once."""
        out, self.chunks = self.chunks, []
        return out


class PcapSource:
    """A capture: iterate it for its chunks.

    ``notes`` hold afterwards what a person should know; ``facts`` what it says of its buses: rates,
    latencies, and all that was known of what it was made from, where this tool wrote it.
    """

    def __init__(self, stream: Stream, bus: str, notes: list[str] | None = None) -> None:
        self._reader = PacketReader(stream)
        self._bus = bus
        self._notes = [] if notes is None else notes
        self._lines: dict[str, SerialLine] = {}
        self._usb = UsbDevices()
        self._candidates: dict[str, _Candidate] = {}
        self._left_out: dict[str, int] = {}
        self._bauds: dict[str, int] = {}
        self._packets = 0

    def __iter__(self) -> Iterator[Chunk]:
        """Yield the chunks.

        Raises:
            InputError: none of it is a serial line.
            DamagedInputError: it is cut off or makes no sense; what comes before was yielded.
        """
        is_empty = True
        for chunk in self._chunks():
            is_empty = False
            yield chunk
        if self._packets and is_empty:
            self._notes.append(_without_bytes(self._packets, is_usb=self.has_usb))

    @property
    def has_usb(self) -> bool:
        """Whether a device on USB was met."""
        return bool(self._usb.known)

    @property
    def facts(self) -> dict[str, str]:
        """What is known of its buses as far as it was read."""
        facts = {f"baud.{bus}": str(baud) for bus, baud in self._bauds.items()}
        for device in self._usb.known.values():
            for bus in device.buses:
                facts[f"latency_ns.{bus}"] = str(device.latency_ns)
                if device.baud:
                    facts[f"baud.{bus}"] = str(device.baud)
        return facts | self._reader.facts

    def _chunks(self) -> Iterator[Chunk]:
        try:
            for packet in self._reader:
                self._packets += 1
                yield from self._take(packet)
        except DamagedInputError:
            yield from self._end()
            raise
        yield from self._end()

    def _take(self, packet: CapturedPacket) -> Iterator[Chunk]:
        link = packet.face.link
        if link in USB_LINKS:
            for chunk in self._usb.take(packet):
                yield from self._judged(chunk)
        elif _is_serial(link):
            yield from self._line(packet.face).take(packet)
        else:
            if not any(map(_is_read, self._reader.faces)):
                raise InputError(_refused(link))
            what = f"{_link_in_words(link)}{f' on {packet.face.name}' if packet.face.name else ''}"
            if what in self._left_out or len(self._left_out) < BUSES_MOST:
                self._left_out[what] = self._left_out.get(what, 0) + 1

    def _line(self, face: CaptureFace) -> SerialLine:
        """Return the line of an interface; nameless ones are told apart by their number."""
        name = face.name or (f"if{face.number}" if face.number else self._bus)
        line = self._lines.get(name)
        if line is None:
            if len(self._lines) > BUSES_MOST:
                raise DamagedInputError(f"more than {BUSES_MOST} serial lines")
            line = self._lines[name] = SerialLine(name)
            baud = stated_baud(face)
            if baud is not None and not face.facts:
                self._bauds[name] = baud
        return line

    def _judged(self, chunk: Chunk) -> Iterator[Chunk]:
        """Yield what servos may have said: disks and cameras are on USB, too."""
        candidate = self._candidates.get(chunk.bus)
        if candidate is None:
            candidate = self._candidates[chunk.bus] = _Candidate()
            if chunk.data.startswith(_STORAGE):
                candidate.is_servo = False
                candidate.leave_out()
        if candidate.is_taken:
            yield chunk
            return
        if candidate.is_left_out:
            candidate.size += len(chunk.data)
            return
        candidate.add(chunk)
        if candidate.is_servo is False and len(self._candidates) > 1:
            candidate.leave_out()
        elif candidate.is_servo is False and candidate.is_full:
            candidate.is_taken = True
        if candidate.is_taken:
            yield from candidate.given()

    def _end(self) -> Iterator[Chunk]:
        for line in self._lines.values():
            yield from line.end()
        for chunk in self._usb.end():
            yield from self._judged(chunk)
        for candidate in self._candidates.values():
            if candidate.is_servo is None:
                candidate.look()
        if not any(c.is_servo for c in self._candidates.values()):
            for candidate in self._candidates.values():
                candidate.is_taken = not candidate.is_left_out
        for bus, candidate in self._candidates.items():
            if candidate.is_taken:
                yield from candidate.given()
            else:
                self._notes.append(
                    f"{bus} is left out: {counted(candidate.size, 'byte')} of a USB device that "
                    "speaks no protocol of servos"
                )
        for device in self._usb.known.values():
            if any(self._candidates[bus].is_taken for bus in device.buses):
                self._notes.append(f"{device.name} is {device.told}")
        for what, count in self._left_out.items():
            self._notes.append(f"{counted(count, 'packet')} of {what} are left out")
        early = sum(line.early for line in self._lines.values())
        if early:
            self._notes.append(
                "packets are stamped with their first byte and no rate is stated: times are early "
                "by the length of each"
            )


def facts_of(stream: Stream, bus: str) -> dict[str, str]:
    """Return what the beginning of a capture says of itself."""
    begin = _Begin(stream)
    source = begin.source = PcapSource(begin, bus)
    with contextlib.suppress(InputError, DamagedInputError):
        for _ in source:
            pass
    return source.facts


class _Begin:
    """The beginning of a stream: more of it where there is USB."""

    def __init__(self, stream: Stream) -> None:
        self._stream = stream
        self._given = 0
        self.source: PcapSource | None = None

    def read(self, size: int, /) -> bytes:
        is_usb = self.source is not None and self.source.has_usb
        size = min(size, (FACTS_MOST if is_usb else HEAD_MOST) - self._given)
        out = self._stream.read(size) if size > 0 else b""
        self._given += len(out)
        return out


def _is_serial(link: int) -> bool:
    return link == RTAC_SERIAL or USER_FIRST <= link <= USER_LAST


def _is_read(face: CaptureFace) -> bool:
    return _is_serial(face.link) or face.link in USB_LINKS


def _link_in_words(link: int) -> str:
    return _LINKS.get(link, f"link type {link}")


def _without_bytes(packets: int, *, is_usb: bool) -> str:
    told = f"there are none in its {counted(packets, 'packet')}"
    if is_usb:
        return f"{told}, which set devices on USB up: capture whole packets, while servos are asked"
    return told


def _refused(link: int) -> str:
    usb = " (`-e usb.capdata` of USB)" if "USB" in _link_in_words(link) else ""
    return (
        f"a capture of {_link_in_words(link)} is not read, but of serial lines (link type "
        f"{RTAC_SERIAL}), of {USER_FIRST} to {USER_LAST}, and of USB on Linux and Windows: export "
        f"the payload as hex, e.g. `tshark -r FILE -T fields -e data`{usb}, and decode that"
    )
