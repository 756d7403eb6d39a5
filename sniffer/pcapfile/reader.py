"""Packets of pcap and pcapng files, one after the other, in bounded memory.

What a file says of itself is not believed: lengths, numbers of interfaces and times are checked
where they enter. What makes no sense ends the reading with DamagedInputError, after the packets
before it.
"""

from __future__ import annotations

import itertools
import json
import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, NamedTuple, Self

from sniffer.ground.limits import is_time
from sniffer.ground.model import NS, DamagedInputError
from sniffer.messages import TOOL
from sniffer.pcapfile.layout import (
    BYTE_ORDERS,
    CHUNK_ENDS,
    END_OF_OPTIONS,
    ENHANCED,
    EPB_FLAGS,
    FACTS,
    IF_DESCRIPTION,
    IF_NAME,
    IF_SPEED,
    IF_TSOFFSET,
    IF_TSRESOL,
    INTERFACE,
    PACKET,
    PCAP_MAGICS,
    PCAPNG_MAGIC,
    SECTION,
    SIMPLE,
    USER_APPLICATION,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from sniffer.ground.files import Stream

READ: Final = 1 << 18
"""Bytes read at a time."""

BLOCK_MOST: Final = 1 << 24
"""A block with a packet or an interface is no larger, in bytes: a packet of USB, which has the
largest, is a few hundred kB."""

FACES_MOST: Final = 256
"""Interfaces of a section at most."""

FACTS_MOST: Final = 4096
"""Facts that are kept at most: a section and each of its buses have a few."""


class _Layouts(NamedTuple):
    """The fixed parts of blocks in one order of bytes."""

    word: struct.Struct
    option: struct.Struct
    enhanced: struct.Struct
    obsolete: struct.Struct

    @classmethod
    def of(cls, order: str) -> Self:
        """Return those of ``<`` or ``>``."""
        return cls(*(struct.Struct(order + told) for told in ("I", "HH", "IIIII", "HxxIIII")))


_LAYOUTS: Final = {order: _Layouts.of(order) for order in "<>"}

_LINK_BITS: Final = 0x03FF_FFFF  # above it stands how long a check sequence is


@dataclass(frozen=True, slots=True)
class CaptureFace:
    """An interface of a capture: ``order`` is that of the bytes of its section."""

    link: int
    order: str = "<"
    number: int = 0
    name: str = ""
    description: str = ""
    speed: int = 0
    unit: int = 1_000_000
    since_s: int = 0
    snap: int = 0
    facts: Mapping[str, str] = field(default_factory=dict)


class CapturedPacket(NamedTuple):
    """A packet; ``lost`` bytes of it were not captured. ``chunk_ends`` are this tool's own."""

    face: CaptureFace
    t_ns: int | None
    data: bytes
    lost: int = 0
    flags: int = 0
    chunk_ends: tuple[bytes, ...] | None = None


class _PcapBytes:
    """A stream as exactly as many bytes as are asked for."""

    def __init__(self, stream: Stream) -> None:
        self._stream = stream
        self._data = b""
        self._next = 0
        self._before = 0

    @property
    def at(self) -> int:
        """Offset of the next byte in the file."""
        return self._before + self._next

    def more(self) -> bool:
        """Tell whether a byte follows."""
        return self._next < len(self._data) or self._read(1)

    def take(self, size: int) -> bytes:
        """Return the next bytes."""
        end = self._next + size
        if end > len(self._data):
            if not self._read(size):
                raise self.wrong("the file is cut off here")
            end = self._next + size
        out = self._data[self._next : end]
        self._next = end
        return out

    def skip(self, size: int) -> None:
        """Pass over bytes."""
        while size:
            step = min(size, READ)
            self.take(step)
            size -= step

    def wrong(self, why: str) -> DamagedInputError:
        """Return the error that says where the file makes no sense."""
        return DamagedInputError(f"byte {self.at}: {why}")

    def _read(self, size: int) -> bool:
        """Have so many bytes there; tell whether there are as many."""
        parts = [self._data[self._next :]]
        self._before += self._next
        self._next = 0
        held = len(parts[0])
        while held < size and (more := self._stream.read(max(READ, size - held))):
            parts.append(more)
            held += len(more)
        self._data = b"".join(parts)
        return held >= size


class PacketReader:
    """Iterate it for the packets; ``facts`` grow with the sections and interfaces that were met."""

    def __init__(self, stream: Stream) -> None:
        self._bytes = _PcapBytes(stream)
        self._order = "<"
        self._layouts = _LAYOUTS["<"]
        self._ours = False
        self.facts: dict[str, str] = {}
        self.faces: list[CaptureFace] = []

    def __iter__(self) -> Iterator[CapturedPacket]:
        magic = self._bytes.take(4)
        if magic in PCAP_MAGICS:
            return self._pcap(*PCAP_MAGICS[magic])
        if magic == PCAPNG_MAGIC:
            return self._pcapng()
        raise self._bytes.wrong("this is neither pcap nor pcapng")

    def _pcap(self, order: str, to_ns: int) -> Iterator[CapturedPacket]:
        take = self._bytes.take
        *_, snap, network = struct.unpack(f"{order}HHiIII", take(20))
        face = CaptureFace(network & _LINK_BITS, order, snap=snap)
        self.faces.append(face)
        head = struct.Struct(f"{order}IIII")
        while self._bytes.more():
            seconds, fraction, size, full = head.unpack(take(16))
            if size > BLOCK_MOST:
                raise self._bytes.wrong(f"a packet cannot have {size} bytes")
            t_ns = seconds * NS + fraction * to_ns
            yield CapturedPacket(face, t_ns, take(size), max(full - size, 0))

    def _pcapng(self) -> Iterator[CapturedPacket]:
        kind = SECTION
        while True:
            body = self._block(kind)
            if kind == SECTION:
                self._section(body)
            elif kind == INTERFACE:
                self._interface(body)
            elif kind in (ENHANCED, PACKET, SIMPLE):
                yield self._packet(kind, body)
            if not self._bytes.more():
                return
            (kind,) = self._layouts.word.unpack(self._bytes.take(4))

    def _block(self, kind: int) -> bytes:
        """Return what is in a block, nothing where it is passed over."""
        length, done = self._bytes.take(4), 8
        if kind == SECTION:
            order = BYTE_ORDERS.get(self._bytes.take(4))
            done = 12
            if order is None:
                raise self._bytes.wrong("a section does not say in which order its bytes are")
            self._order = order
            self._layouts = _LAYOUTS[self._order]
        (size,) = self._layouts.word.unpack(length)
        rest = size - done - 4
        if rest < 0 or size % 4:
            raise self._bytes.wrong(f"a block cannot have {size} bytes")
        body = b""
        if kind not in (SECTION, INTERFACE, ENHANCED, PACKET, SIMPLE):
            self._bytes.skip(rest)
        elif rest > BLOCK_MOST:
            raise self._bytes.wrong(f"a block of {size} bytes is none of a capture")
        else:
            body = self._bytes.take(rest)
        if self._bytes.take(4) != length:
            raise self._bytes.wrong("a block says two lengths: its begin another one than its end")
        return body

    def _section(self, body: bytes) -> None:
        self.faces = []
        if len(body) < 12:
            raise self._bytes.wrong("a section is cut")
        options = dict(self._options(body[12:]))
        self._ours = options.get(USER_APPLICATION, b"").startswith(TOOL.encode())
        self.facts |= self._said(options)

    def _said(self, options: Mapping[int, bytes]) -> Mapping[str, str]:
        """Return the facts that this tool has written."""
        try:
            told = json.loads(options.get(FACTS, b"{}")) if self._ours else {}
        except (ValueError, RecursionError):
            return {}
        if not isinstance(told, dict):
            return {}
        room = FACTS_MOST - len(self.facts)
        said = ((key, value) for key, value in told.items() if isinstance(value, str))
        return dict(itertools.islice(said, room))

    def _interface(self, body: bytes) -> None:
        if len(body) < 8:
            raise self._bytes.wrong("an interface is cut")
        if len(self.faces) == FACES_MOST:
            raise self._bytes.wrong(f"more than {FACES_MOST} interfaces")
        link, _, snap = struct.unpack_from(f"{self._order}HHI", body)
        options = dict(self._options(body[8:]))
        resolution = (options.get(IF_TSRESOL) or b"\x06")[0]
        unit = 1 << (resolution & 0x7F) if resolution & 0x80 else 10**resolution
        since, speed = options.get(IF_TSOFFSET, b""), options.get(IF_SPEED, b"")
        facts = self._said(options)
        self.facts |= facts
        self.faces.append(
            CaptureFace(
                link,
                self._order,
                len(self.faces),
                _text(options.get(IF_NAME, b"")),
                _text(options.get(IF_DESCRIPTION, b"")),
                struct.unpack(f"{self._order}Q", speed)[0] if len(speed) == 8 else 0,
                unit,
                struct.unpack(f"{self._order}q", since)[0] if len(since) == 8 else 0,
                snap,
                facts,
            )
        )

    def _packet(self, kind: int, body: bytes) -> CapturedPacket:
        if kind == SIMPLE:
            return self._simple(body)
        if len(body) < 20:
            raise self._bytes.wrong("a packet is cut")
        layout = self._layouts.enhanced if kind == ENHANCED else self._layouts.obsolete
        number, high, low, size, full = layout.unpack_from(body)
        face = self._face(number)
        if 20 + size > len(body):
            raise self._bytes.wrong(f"a packet of {size} bytes is in a block that is too small")
        t_ns = (high << 32 | low) * NS // face.unit + face.since_s * NS
        if not is_time(t_ns):
            raise self._bytes.wrong("a packet has a time that cannot be")
        flags, ends = 0, []
        rest = body[20 + size + -size % 4 :]
        for code, value in self._options(rest) if rest else ():
            if code == EPB_FLAGS and kind == ENHANCED and len(value) == 4:
                (flags,) = self._layouts.word.unpack(value)
            elif code == CHUNK_ENDS and self._ours:
                ends.append(value)
        data = body[20 : 20 + size]
        told = tuple(ends) if ends else None
        return CapturedPacket(face, t_ns, data, max(full - size, 0), flags, told)

    def _simple(self, body: bytes) -> CapturedPacket:
        """Return a packet of the first interface, which has no time."""
        if len(body) < 4:
            raise self._bytes.wrong("a packet is cut")
        face = self._face(0)
        (full,) = struct.unpack_from(f"{self._order}I", body)
        size = min(full, face.snap or full, len(body) - 4)
        return CapturedPacket(face, None, body[4 : 4 + size], full - size)

    def _face(self, number: int) -> CaptureFace:
        if number >= len(self.faces):
            raise self._bytes.wrong(f"a packet is of interface {number}, which nobody described")
        return self.faces[number]

    def _options(self, told: bytes) -> Iterator[tuple[int, bytes]]:
        head = self._layouts.option
        at = 0
        while at + 4 <= len(told):
            code, size = head.unpack_from(told, at)
            if code == END_OF_OPTIONS:
                return
            if at + 4 + size > len(told):
                raise self._bytes.wrong("an option is longer than its block")
            yield code, told[at + 4 : at + 4 + size]
            at += 4 + size + -size % 4


def _text(value: bytes) -> str:
    return value.rstrip(b"\0").decode("utf-8", "replace")
