"""An MCAP file written a chunk at a time from ready-made message records.

The mcap library supplies every record but the messages; its own writer takes one call a message,
which costs ten times what is done here. Nothing is buffered: a chunk that was written is in the
file. A chunk holds the schemas and channels that are new in it, before its messages.
"""

from __future__ import annotations

import contextlib
import struct
import zlib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, cast

import numpy as np
import zstandard
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from sniffer.model import OutputError
from sniffer.sinks.files import writing
from sniffer.sinks.mcap_rows import LOG_AT, U16, Loose, Rows

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from google.protobuf.descriptor import FileDescriptor
    from google.protobuf.message import Message

    from sniffer.model import I64

MAGIC: Final = b"\x89MCAP0\r\n"
CHUNK: Final = 1 << 20
"""A chunk's messages, in bytes: larger ones compress no better, smaller ones worse."""

LEVEL: Final = 1
"""Of zstd: 3, its default, takes half as long again for the same size."""

_INDEX: Final = np.dtype([("log", "<i8"), ("at", "<u8")])


@dataclass(frozen=True, slots=True)
class Sorted:
    """Message records side by side in ``data``, in the order of their log times."""

    data: memoryview
    log: I64
    channel: U16
    start: I64
    end: I64

    def pieces(self, size: int = CHUNK) -> Iterator[Sorted]:
        """Yield it in pieces of about ``size`` bytes."""
        a, n = 0, len(self.log)
        while a < n:
            begin = int(self.start[a])
            b = max(a + 1, int(np.searchsorted(self.end, begin + size, "right")))
            rows = slice(a, b)
            yield Sorted(
                self.data[begin : int(self.end[b - 1])],
                self.log[rows],
                self.channel[rows],
                self.start[rows] - begin,
                self.end[rows] - begin,
            )
            a = b


class Queue:
    """Message records that wait to be put in order."""

    def __init__(self) -> None:
        self._parts: list[Rows | Loose] = []
        self._ranks = 0
        self.size = 0

    def ranks(self, n: int) -> I64:
        """Return the ranks of the next ``n`` records: of one time, the first to come is first."""
        self._ranks += n
        return np.arange(self._ranks - n, self._ranks)

    def add(self, *parts: Rows | Loose) -> None:
        """Take records."""
        for part in parts:
            self._parts.append(part)
            self.size += int(part.widths.sum())

    def take(self, until: int | None, floor: int) -> Sorted | None:
        """Return what is not later than ``until`` (None: all), no log time below ``floor``."""
        parts = self._parts
        self._parts, self.size = [], 0
        if until is not None:
            masks = [part.heads.log <= until for part in parts]
            self.add(*(p.take(~m) for p, m in zip(parts, masks, strict=True) if not m.all()))
            parts = [p.take(m) for p, m in zip(parts, masks, strict=True) if m.any()]
        if not parts:
            return None
        log = np.concatenate([p.heads.log for p in parts])
        channel = np.concatenate([p.heads.channel for p in parts])
        widths = np.concatenate([p.widths for p in parts])
        order = np.lexsort((np.concatenate([p.heads.rank for p in parts]), log))
        log, channel, widths = np.maximum(log[order], floor), channel[order], widths[order]
        end = np.cumsum(widths)
        start = end - widths
        at = np.empty(len(order), np.int64)
        at[order] = start
        out = bytearray(int(end[-1]))
        begin = 0
        for part in parts:
            n = len(part.data)
            part.place(out, at[begin : begin + n])
            begin += n
        np.ndarray((len(out) - LOG_AT - 7,), "<i8", out, LOG_AT, (1,))[start] = log
        return Sorted(memoryview(out), log, channel, start, end)


@dataclass(slots=True)
class _Summary:
    """What the end of the file repeats; chunk indexes are kept as bytes, there may be many."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: dict[int, int] = field(default_factory=dict)
    chunks: bytearray = field(default_factory=bytearray)
    chunk_count: int = 0
    first: int | None = None
    last: int = 0
    attachments: list[AttachmentIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)


class Container:
    """The file.

    Args:
        path: of the file.
        library: what the header names as its maker.
        overwrite: whether a file that is there may be replaced.

    Raises:
        OutputError: it cannot be written; what was written before is left readable.
    """

    def __init__(self, path: Path, library: str, *, overwrite: bool = True) -> None:
        self.path = path
        if not overwrite and path.exists():
            raise OutputError(f"{path} is there already: choose another name")
        with writing(path):
            self._file = path.open("wb" if overwrite else "xb", buffering=0)
        self._size = 0
        self._crc = 0
        self._new: list[McapRecord] = []
        self._summary = _Summary()
        self._compress = zstandard.ZstdCompressor(level=LEVEL).compress
        self._put(MAGIC + _bytes(Header("", library)))

    @property
    def last(self) -> int:
        """The latest log time in the file."""
        return self._summary.last

    def schema(self, message: type[Message]) -> int:
        """Return the id of a message type's schema."""
        name = message.DESCRIPTOR.full_name
        for schema in self._summary.schemas.values():
            if schema.name == name:
                return schema.id
        number = max(self._summary.schemas, default=0) + 1
        self._register(
            Schema(
                number,
                _descriptors(cast("FileDescriptor", message.DESCRIPTOR.file)),
                "protobuf",
                name,
            )
        )
        return number

    def channel(self, topic: str, message: type[Message], metadata: Mapping[str, str]) -> int:
        """Open a channel for messages of one type; return its id."""
        schema = self.schema(message)
        number = max(self._summary.channels, default=0) + 1
        self._register(Channel(number, topic, "protobuf", dict(metadata), schema))
        return number

    def know(self, *records: Schema | Channel) -> None:
        """Take note of schemas and channels that are in the file already, for its end."""
        for record in records:
            if isinstance(record, Schema):
                self._summary.schemas[record.id] = record
            else:
                self._summary.channels[record.id] = record

    def append(self, record: Schema | Channel) -> None:
        """Write a schema or channel outside of any chunk."""
        self.know(record)
        self._put(_bytes(record))

    def _register(self, record: Schema | Channel) -> None:
        """Make a schema or channel known; the next chunk begins with it."""
        self.know(record)
        self._new.append(record)

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record."""
        data = _bytes(Metadata(name=name, metadata=dict(values)))
        self._summary.metadata.append(MetadataIndex(self._size, len(data), name))
        self._put(data)

    def attach(self, attachment: Attachment) -> None:
        """Write an attachment."""
        a = attachment
        data = _bytes(a)
        self._put(data)
        self._summary.attachments.append(
            AttachmentIndex(
                self._size - len(data),
                len(data),
                a.log_time,
                a.create_time,
                len(a.data),
                a.name,
                a.media_type,
            )
        )

    def write(self, rows: Sorted) -> None:
        """Write a chunk of messages, and before them the schemas and channels that are new."""
        head = b"".join(map(_bytes, self._new))
        data = b"".join((head, rows.data))
        packed = self._compress(data)
        at = rows.start + len(head)
        self.chunk("zstd", packed, len(data), zlib.crc32(data), rows.log, rows.channel, at)
        self._new.clear()

    def chunk(
        self,
        compression: str,
        packed: bytes,
        size: int,
        crc: int,
        log: I64,
        channel: U16,
        at: I64,
    ) -> None:
        """Write a chunk that is packed already; ``at`` is where in it each message stands."""
        first, last = int(log.min()), int(log.max())
        name = compression.encode()
        body = struct.pack("<QQQII", first, last, size, crc, len(name)) + name
        body += struct.pack("<Q", len(packed))
        head = struct.pack("<BQ", Opcode.CHUNK, len(body) + len(packed)) + body
        length = len(head) + len(packed)
        order = np.argsort(channel, kind="stable")
        ids, counts = np.unique(channel, return_counts=True)
        index = np.empty(len(order), _INDEX)
        index["log"], index["at"] = log[order], at[order]
        entries = index.tobytes()
        parts, places, here, done = [head, packed], {}, self._size + length, 0
        for number, count in zip(ids.tolist(), counts.tolist(), strict=True):
            n = 16 * count
            part = struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + n, number, n)
            part += entries[done : done + n]
            places[number] = here
            parts.append(part)
            here, done = here + len(part), done + n
        chunk_index = ChunkIndex(
            chunk_length=length,
            chunk_start_offset=self._size,
            compression=compression,
            compressed_size=len(packed),
            message_end_time=last,
            message_index_length=here - self._size - length,
            message_index_offsets=places,
            message_start_time=first,
            uncompressed_size=size,
        )
        self._put(b"".join(parts))
        s = self._summary
        s.chunks += _bytes(chunk_index)
        s.chunk_count += 1
        s.first = first if s.first is None else min(s.first, first)
        s.last = max(s.last, last)
        for number, count in zip(ids.tolist(), counts.tolist(), strict=True):
            s.counts[number] = s.counts.get(number, 0) + count

    def finish(self) -> None:
        """Write the summary and close the file.

        Where there is no room for it the file ends behind the last whole record.
        """
        try:
            self._put(_bytes(DataEnd(self._crc)))
            self._put(self._end(self._size), checked=False)
        finally:
            self.abandon()

    def abandon(self) -> None:
        """Close the file as it is."""
        with contextlib.suppress(OSError):
            self._file.close()

    def _end(self, here: int) -> bytes:
        s = self._summary
        statistics = Statistics(
            attachment_count=len(s.attachments),
            channel_count=len(s.channels),
            channel_message_counts=s.counts,
            chunk_count=s.chunk_count,
            message_count=sum(s.counts.values()),
            message_end_time=s.last,
            message_start_time=s.first or 0,
            metadata_count=len(s.metadata),
            schema_count=len(s.schemas),
        )
        groups: list[tuple[Opcode, bytes]] = [
            (Opcode.SCHEMA, b"".join(map(_bytes, s.schemas.values()))),
            (Opcode.CHANNEL, b"".join(map(_bytes, s.channels.values()))),
            (Opcode.STATISTICS, _bytes(statistics)),
            (Opcode.CHUNK_INDEX, bytes(s.chunks)),
            (Opcode.ATTACHMENT_INDEX, b"".join(map(_bytes, s.attachments))),
            (Opcode.METADATA_INDEX, b"".join(map(_bytes, s.metadata))),
        ]
        out, offsets, at = [], [], here
        for opcode, data in groups:
            if data:
                out.append(data)
                offsets.append(_bytes(SummaryOffset(opcode, at, len(data))))
                at += len(data)
        summary = b"".join((*out, *offsets))
        head = struct.pack("<BQQQ", Opcode.FOOTER, 20, here, at)
        footer = _bytes(Footer(here, at, zlib.crc32(head, zlib.crc32(summary))))
        return summary + footer + MAGIC

    def _put(self, data: bytes, *, checked: bool = True) -> None:
        """Write all of ``data`` or, where the system refuses, nothing of it."""
        try:
            with writing(self.path):
                rest = memoryview(data)
                while rest:
                    rest = rest[self._file.write(rest) :]
        except OutputError:
            with contextlib.suppress(OSError):
                self._file.truncate(self._size)
                self._file.seek(self._size)
            raise
        if checked:
            self._crc = zlib.crc32(data, self._crc)
        self._size += len(data)


def _bytes(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data


def _descriptors(file: FileDescriptor) -> bytes:
    """Return the file's descriptor set, the files it imports before it."""
    out = FileDescriptorSet()
    seen: set[str] = set()

    def add(one: FileDescriptor) -> None:
        if one.name not in seen:
            seen.add(one.name)
            for imported in one.dependencies:
                add(imported)
            one.CopyToProto(out.file.add())

    add(file)
    return out.SerializeToString()
