"""A recording from one chunk of its file to another, found by the index at its end."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from mcap.opcode import Opcode

from sniffer.ground.limits import GROUP, GROUP_CHUNKS
from sniffer.ground.model import DamagedInputError
from sniffer.mcapfile.ends import ends
from sniffer.mcapfile.packed import BrokenError
from sniffer.mcapfile.records import Piece, Records, parse
from sniffer.mcapfile.source import BusChannels, raw_chunks
from sniffer.mcapfile.structs import DATA_END, FOOT, foot, whole, whole_until
from sniffer.messages.recording_pb2 import RawChunk

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path
    from typing import BinaryIO

    from mcap.records import Channel, Schema

    from sniffer.ground.model import Chunk

_INDEX: Final = struct.Struct("<QQQQ")
"""What a chunk index begins with: first and last time, where its chunk begins, how long it is."""


@dataclass(slots=True)
class RecordedStretch:
    """The chunks of a recording whose records begin in ``begin..end``, read as by ``groups``.

    ``starts`` tells for each bus at which offset the file begins, and is shared by all stretches of
    one; ``bases`` where the stretch does, counted from there, and ``due`` where it must, if known.
    ``channels`` are all of the file.
    """

    path: Path
    name: str
    first: int
    begin: int
    end: int
    channels: Mapping[int, Channel]
    schemas: Mapping[int, Schema]
    starts: dict[str, int]
    bases: dict[str, int] = field(default_factory=dict)
    due: dict[str, int] = field(default_factory=dict)

    def __iter__(self) -> Iterator[Sequence[Chunk]]:
        try:
            with self.path.open("rb") as file:
                until = ends(file)
                records = Records(_Spliced(file, self.first, self.begin, self.end))
                records.channels.update(self.channels)
                records.schemas.update(self.schemas)
                offsets = {bus: at + self.starts.get(bus, 0) for bus, at in self.due.items()}
                raw = BusChannels(records, RawChunk)
                group: list[Chunk] = []
                held, damage = 0, ""
                try:
                    for piece in records:
                        if not isinstance(piece, Piece):
                            continue
                        for chunk in raw_chunks(raw, piece, offsets, until):
                            self._note(chunk, offsets)
                            group.append(chunk)
                            held += len(chunk.data)
                            if held >= GROUP or len(group) >= GROUP_CHUNKS:
                                yield group
                                group, held = [], 0
                except BrokenError as broken:
                    at = records.position - self.first
                    if at < self.end - self.begin:  # else it is only the end of the stretch
                        told = f"{self.begin + at} of {self.path.stat().st_size} bytes read"
                        damage = f"{self.name}: cut recording, {told} ({broken})"
                if group:
                    yield group
                if damage:
                    raise DamagedInputError(damage)
        except OSError as error:
            why = f"{self.name}: cannot be read on ({error.strerror})"
            raise DamagedInputError(why) from None

    def _note(self, chunk: Chunk, offsets: Mapping[str, int]) -> None:
        """Note where a bus begins: as far before the end of its first chunk as that has bytes."""
        if chunk.bus not in self.bases:
            at = offsets[chunk.bus] - len(chunk.data)
            self.bases[chunk.bus] = at - self.starts.setdefault(chunk.bus, at)


class _Spliced:
    """The beginning of a file, up to its first chunk, and then a stretch of it."""

    def __init__(self, file: BinaryIO, first: int, begin: int, end: int) -> None:
        self._file = file
        self._left = [(0, first), (begin, end)]

    def read(self, size: int, /) -> bytes:
        """Return up to ``size`` bytes, none at the end."""
        while self._left:
            at, end = self._left[0]
            if at < end:
                self._file.seek(at)
                data = self._file.read(min(size, end - at))
                self._left[0] = at + len(data), end if data else at
                return data
            self._left.pop(0)
        return b""


@dataclass(frozen=True, slots=True)
class RecordedChunks:
    """What the index of a recording tells: where chunks begin and how much they hold unpacked."""

    begins: Sequence[int]
    sizes: Sequence[int]
    end: int
    channels: Mapping[int, Channel]
    schemas: Mapping[int, Schema]


def indexed(path: Path) -> RecordedChunks | None:
    """Return what the index of a recording tells; None where it has none that is sound.

    All of its data are read once, for their checksum.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        at = size - FOOT
        file.seek(max(at, 0))
        told = foot(file.read())
        if told is None or not DATA_END.size < told.summary <= told.offsets <= at:
            return None
        end = told.summary - DATA_END.size
        file.seek(end)
        index = file.read(told.offsets - end)
        opcode, length, crc = DATA_END.unpack_from(index)
        if (opcode, length) != (Opcode.DATA_END, 4):
            return None
        found = _summary(index[DATA_END.size :], end)
        if found is None or (crc and _crc(file, end) != crc):
            return None
        return found


def _crc(file: BinaryIO, end: int) -> int:
    file.seek(0)
    crc = 0
    while end > 0 and (data := file.read(min(end, 1 << 20))):
        crc, end = zlib.crc32(data, crc), end - len(data)
    return crc


def _summary(data: bytes, end: int) -> RecordedChunks | None:
    """Read the records of an index; None where they make no sense."""
    begins: list[int] = []
    sizes: list[int] = []
    channels: dict[int, Channel] = {}
    schemas: dict[int, Schema] = {}
    if whole_until(data) != len(data):
        return None
    for opcode, begin, behind in whole(data):
        body = data[begin:behind]
        if opcode == Opcode.CHUNK_INDEX and len(body) >= _INDEX.size + 8:
            begins.append(_INDEX.unpack_from(body)[2])
            sizes.append(int.from_bytes(body[-8:], "little"))
        elif opcode in (Opcode.CHANNEL, Opcode.SCHEMA):
            try:
                record = parse(opcode, body, own=False)
            except BrokenError:
                return None
            (channels if opcode == Opcode.CHANNEL else schemas)[record.id] = record
    ordered = begins == sorted(begins) and bool(begins) and begins[-1] < end
    return RecordedChunks(begins, sizes, end, channels, schemas) if ordered else None


@dataclass(frozen=True, slots=True)
class RecordedFile:
    """A recording that can be read in stretches; edges are places between its chunks."""

    path: Path
    name: str
    chunks: RecordedChunks
    starts: dict[str, int] = field(default_factory=dict)

    def stretch(self, begin: int, end: int) -> RecordedStretch:
        """Return the chunks from one of the file to another, by their numbers."""
        c = self.chunks
        edges = [*c.begins, c.end]
        return RecordedStretch(
            self.path,
            self.name,
            c.begins[0],
            edges[begin],
            edges[end],
            c.channels,
            c.schemas,
            self.starts,
        )
