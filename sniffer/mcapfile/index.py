"""What the end of an MCAP file repeats: an index of the chunks, and all channels once more.

A live recording has a chunk for every flush, 72,000 in an hour: their indexes are kept compressed,
and written piece by piece.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    Channel,
    McapRecord,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from sniffer.mcapfile.structs import ended

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from sniffer.ground.model import I64
    from sniffer.mcapfile.rows import U16

PIECE: Final = 512
"""Chunks whose indexes are compressed together: half a minute of a live recording."""

LEVEL: Final = 3
"""Of zstd, its default."""

MESSAGE_INDEX: Final = 15
"""Length of a message index record without its entries, in bytes."""

_COLUMNS: Final = ("start", "length", "first", "last", "packed", "size", "channels", "kind")


def as_bytes(record: McapRecord) -> bytes:
    """Return a record as it stands in the file."""
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data


@dataclass(frozen=True, slots=True)
class ChunkNote:
    """What the index says of a chunk: ``channels`` and ``counts`` are those of its messages.

    ``entries``: how many of them the message index behind it names.
    """

    start: int
    length: int
    first: int
    last: int
    compression: str
    packed: int
    size: int
    channels: U16
    counts: I64
    entries: I64


_U64: Final = (1 << 64) - 1


class ChunkIndexes:
    """The index records of all chunks, kept small: as columns of differences, compressed."""

    def __init__(self) -> None:
        self.count = 0
        self._compressions: list[str] = []
        self._pieces: list[tuple[int, bytes]] = []
        self._rows: list[tuple[int, ...]] = []
        self._channels: list[U16] = []
        self._entries: list[I64] = []

    def add(self, note: ChunkNote) -> None:
        """Append."""
        n = note
        self.count += 1
        if n.compression not in self._compressions:
            self._compressions.append(n.compression)
        kind = self._compressions.index(n.compression)
        numbers = (n.start, n.length, n.first, n.last, n.packed, n.size)
        self._rows.append((*numbers, len(n.channels), kind))
        self._channels.append(n.channels)
        self._entries.append(n.entries)
        if len(self._rows) == PIECE:
            data = b"".join((
                np.diff(self._table(), axis=0, prepend=0).T.astype("<i8").tobytes(),
                np.concatenate(self._channels).astype("<u2").tobytes(),
                np.concatenate(self._entries).astype("<u4").tobytes(),
            ))  # fmt: skip
            # a copy, because what the compressor returns keeps the room for the worst case
            packed = bytes(memoryview(zstandard.ZstdCompressor(level=LEVEL).compress(data)))
            self._pieces.append((len(self._rows), packed))
            self._rows, self._channels, self._entries = [], [], []

    @property
    def held(self) -> int:
        """How much memory the compressed ones take, in bytes."""
        return sum(len(packed) for _, packed in self._pieces)

    def _table(self) -> I64:
        """Return the rows that wait; times of harmed recordings go up to 2^64, and turn over."""
        rows = [[number & _U64 for number in row] for row in self._rows]
        return np.array(rows, np.uint64).view(np.int64)

    def __iter__(self) -> Iterator[bytes]:
        """Return the records in pieces."""
        for n, packed in self._pieces:
            data = zstandard.ZstdDecompressor().decompress(packed)
            width = len(_COLUMNS)
            rows = np.frombuffer(data, "<i8", n * width).reshape(width, n).cumsum(axis=1).T
            total = int(rows[:, 6].sum())
            channels = np.frombuffer(data, "<u2", total, 8 * n * width)
            entries = np.frombuffer(data, "<u4", total, 8 * n * width + 2 * total)
            yield self._records(rows, channels, entries.astype(np.int64))
        if self._rows:
            channels, entries = np.concatenate(self._channels), np.concatenate(self._entries)
            yield self._records(self._table(), channels, entries)

    def _records(self, rows: I64, channels: U16, entries: I64) -> bytes:
        """Return the records of some chunks, in their order."""
        out: list[bytes] = [b""] * len(rows)
        begin = np.cumsum(rows[:, 6]) - rows[:, 6]
        for k, kind in np.unique(rows[:, 6:], axis=0).tolist():
            mine = np.flatnonzero((rows[:, 6] == k) & (rows[:, 7] == kind))
            name = self._compressions[kind].encode()
            record = np.zeros(len(mine), _layout(k, name))
            for column, title in enumerate(_COLUMNS[:6]):
                record[title] = rows[mine, column]
            record["opcode"], record["rest"] = Opcode.CHUNK_INDEX, record.itemsize - 9
            record["map"], record["named"] = 10 * k, len(name)
            if name:
                record["name"] = np.void(name)
            which = begin[mine][:, None] + np.arange(k)
            sizes = MESSAGE_INDEX + 16 * entries[which]
            at = (rows[mine, 0] + rows[mine, 1])[:, None] + np.cumsum(sizes, axis=1) - sizes
            if k:
                record["index"]["channel"], record["index"]["at"] = channels[which], at
            record["indexes"] = sizes.sum(axis=1)
            for i, row in zip(mine.tolist(), record, strict=True):
                out[i] = row.tobytes()
        return b"".join(out)


def _layout(k: int, name: bytes) -> np.dtype[np.void]:
    """Return a chunk index record with ``k`` channels."""
    named = [("name", f"V{len(name)}")] if name else []
    return np.dtype([
        *(("opcode", "u1"), ("rest", "<u8"), ("first", "<u8"), ("last", "<u8")),
        *(("start", "<u8"), ("length", "<u8"), ("map", "<u4")),
        ("index", [("channel", "<u2"), ("at", "<u8")], (k,)),
        *(("indexes", "<u8"), ("named", "<u4"), *named, ("packed", "<u8"), ("size", "<u8")),
    ])  # fmt: skip


@dataclass(slots=True)
class FileSummary:
    """Notes taken while the file is written."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: dict[int, int] = field(default_factory=dict)
    chunks: ChunkIndexes = field(default_factory=ChunkIndexes)
    first: int | None = None
    last: int = 0
    attachments: list[AttachmentIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)

    def add(self, note: ChunkNote) -> None:
        """Take note of a chunk."""
        self.chunks.add(note)
        self.first = note.first if self.first is None else min(self.first, note.first)
        self.last = max(self.last, note.last)
        for channel, count in zip(note.channels.tolist(), note.counts.tolist(), strict=True):
            self.counts[channel] = self.counts.get(channel, 0) + count

    def pieces(self, here: int) -> Iterator[bytes]:
        """Yield all that stands behind the data, which end at ``here``."""
        statistics = Statistics(
            attachment_count=len(self.attachments),
            channel_count=len(self.channels),
            channel_message_counts=self.counts,
            chunk_count=self.chunks.count,
            message_count=sum(self.counts.values()),
            message_end_time=self.last,
            message_start_time=self.first or 0,
            metadata_count=len(self.metadata),
            schema_count=len(self.schemas),
        )
        groups: list[tuple[Opcode, Iterable[bytes]]] = [
            (Opcode.SCHEMA, map(as_bytes, self.schemas.values())),
            (Opcode.CHANNEL, map(as_bytes, self.channels.values())),
            (Opcode.STATISTICS, [as_bytes(statistics)]),
            (Opcode.CHUNK_INDEX, self.chunks),
            (Opcode.ATTACHMENT_INDEX, map(as_bytes, self.attachments)),
            (Opcode.METADATA_INDEX, map(as_bytes, self.metadata)),
        ]
        at, crc, offsets = here, 0, b""
        for opcode, parts in groups:
            start = at
            for part in parts:
                at += len(part)
                crc = zlib.crc32(part, crc)
                yield part
            if at > start:
                offsets += as_bytes(SummaryOffset(opcode, start, at - start))
        yield ended(here, at, offsets, crc)
