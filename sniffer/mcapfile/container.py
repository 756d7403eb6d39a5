"""An MCAP file written a chunk at a time from ready-made message records.

The mcap library supplies every record but the messages; its own writer takes one call a message,
which costs eight times what is done here. Nothing is buffered: a chunk that was written is in the
file, or, where chunks are packed beside what makes them, after ``settle``. A chunk holds the
schemas and channels that are new in it, before its messages.
"""

from __future__ import annotations

import contextlib
import os
import zlib
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    DataEnd,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
)

from sniffer.ground.files import occupied, writing
from sniffer.ground.model import OutputError
from sniffer.mcapfile.index import FileSummary, as_bytes
from sniffer.mcapfile.kinds import MessageType, type_of
from sniffer.mcapfile.packing import ChunkContents, Packer, ready
from sniffer.messages import MAGIC

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping
    from pathlib import Path

    from google.protobuf.message import Message

    from sniffer.mcapfile.packing import ReadyChunk
    from sniffer.mcapfile.queue import Sorted, Unsorted


class Container:
    """The file.

    Args:
        path: of the file.
        library: what the header names as its maker.
        overwrite: whether a file that is there may be replaced.
        durable: whether ``sync`` waits until the disk has what was written.
        beside: whether a thread of its own packs the chunks.

    Raises:
        OutputError: it cannot be written; what was written before is left readable.
    """

    def __init__(
        self,
        path: Path,
        library: str,
        *,
        overwrite: bool = True,
        durable: bool = False,
        beside: bool = False,
    ) -> None:
        self.path = path
        if not overwrite and occupied(path):
            raise OutputError(f"{path} is there already: choose another name")
        with writing(path):
            # an empty file, or a device, is nobody's recording
            new = not overwrite and not path.exists() and not path.is_symlink()
            self._file = path.open("xb" if new else "wb", buffering=0)
        self.size = 0
        """Bytes written."""
        self._durable = durable
        self._synced = 0
        self._crc = 0
        self._new: list[McapRecord] = []
        self._summary = FileSummary()
        self._packer = Packer(beside=beside)
        self._ahead = 0
        try:
            self._put(MAGIC + as_bytes(Header("", library)))
            if durable:
                with writing(path):
                    _sync_folder(path.parent)
        except BaseException:
            self.abandon()
            raise

    @property
    def last(self) -> int:
        """The latest log time in the file, and in what will be."""
        return max(self._ahead, self._summary.last)

    @property
    def is_deleted(self) -> bool:
        """Tell whether the open file has no name any more: what is written to it is lost."""
        return not self._file.closed and os.fstat(self._file.fileno()).st_nlink == 0

    def _schema(self, kind: MessageType) -> int:
        """Return the id of a message type's schema."""
        for schema in self._summary.schemas.values():
            if schema.name == kind.name:
                return schema.id
        number = max(self._summary.schemas, default=0) + 1
        self._register(Schema(number, kind.definition, kind.schema_encoding, kind.name))
        return number

    def channel(
        self, topic: str, message: type[Message] | MessageType, metadata: Mapping[str, str]
    ) -> int:
        """Return the id of a topic's channel, opened where the file has none."""
        for known in self._summary.channels.values():
            if known.topic == topic:
                return known.id
        kind = message if isinstance(message, MessageType) else type_of(message)
        schema = self._schema(kind)
        number = max(self._summary.channels, default=0) + 1
        self._register(Channel(number, topic, kind.encoding, dict(metadata), schema))
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
        self.settle()
        self.know(record)
        self._put(as_bytes(record))

    def _register(self, record: Schema | Channel) -> None:
        """Make a schema or channel known; the next chunk begins with it."""
        self.know(record)
        self._new.append(record)

    def topics(self) -> dict[int, str]:
        """Return the topic of each channel by its id."""
        return {c.id: c.topic for c in self._summary.channels.values()}

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record."""
        self.settle()
        data = as_bytes(Metadata(name=name, metadata=dict(values)))
        self._put(data)
        self._summary.metadata.append(MetadataIndex(self.size - len(data), len(data), name))

    def attach(self, attachment: Attachment) -> None:
        """Write an attachment."""
        self.settle()
        a = attachment
        data = as_bytes(a)
        self._put(data)
        self._summary.attachments.append(
            AttachmentIndex(
                self.size - len(data),
                len(data),
                a.log_time,
                a.create_time,
                len(a.data),
                a.name,
                a.media_type,
            )
        )

    def write_unsorted(self, rows: Unsorted) -> None:
        """Write messages in the order of their log times, none below what is in the file already.

        Chunks are made of them where chunks are packed, and before them the schemas and channels
        that are new.
        """
        floor, head = self.last, self._news()
        self._ahead = max(floor, rows.last)
        self._place(self._packer.lay(rows, floor, head))

    def write(self, rows: Sorted, *, indexed: bool = True) -> None:
        """Write a chunk of messages, and before them the schemas and channels that are new.

        ``indexed``: behind it stands where in it each listed message is, 16 bytes each; without, it
        says so of the first one of each channel. Viewers that look messages up find only those; who
        reads whole chunks finds all.
        """
        head = self._news()
        self._ahead = max(self._ahead, int(rows.log.max()))
        self._place(self._packer.pack(ChunkContents.of(rows, head, indexed=indexed)))

    def _news(self) -> bytes:
        """Return the schemas and channels that are new, once."""
        head = b"".join(map(as_bytes, self._new))
        self._new.clear()
        return head

    def chunk(self, compression: str, packed: bytes, crc: int, contents: ChunkContents) -> None:
        """Write a chunk that is packed already; ``crc`` is the sum of what it holds."""
        self.settle()
        self._place([ready(compression, packed, crc, contents)])

    def settle(self, *, wait: bool = True) -> None:
        """Write the chunks that are packed by now; ``wait``: all of them."""
        self._place(self._packer.done(wait=wait))

    def _place(self, chunks: Iterable[ReadyChunk]) -> None:
        """Append chunks; where that fails, what stands behind is not written either."""
        try:
            for c in chunks:
                note = replace(c.note, start=self.size)
                self._put(c.data)
                self._summary.add(note)
        except BaseException:
            self._packer.drop()
            raise

    def sync(self) -> None:
        """Wait, where that was asked for, until the disk has what was written."""
        if self._durable and self._synced != self.size:
            with writing(self.path):
                _sync(self._file.fileno())
            self._synced = self.size

    def finish(self) -> None:
        """Write the summary and close the file.

        Where there is no room for it the file ends behind the last whole record.
        """
        for _ in self.finishing():
            pass

    def finishing(self) -> Iterator[None]:
        """Do that in steps of some ms: other things may be done between them."""
        if self._file.closed:
            return
        try:
            self.settle()
            self._put(as_bytes(DataEnd(self._crc)))
            here = self.size
            try:
                for piece in self._summary.pieces(here):
                    self._put(piece, checked=False)
                    yield
            except BaseException:
                self._cut(here)
                raise
            self.sync()
        finally:
            self.abandon()

    def abandon(self) -> None:
        """Close the file as it is."""
        self._packer.drop()
        with contextlib.suppress(OSError):
            self._file.close()

    def _put(self, data: bytes, *, checked: bool = True) -> None:
        """Write all of ``data`` or, where the system refuses or Ctrl-C comes, nothing of it."""
        try:
            with writing(self.path):
                rest = memoryview(data)
                while rest:
                    rest = rest[self._file.write(rest) :]
        except BaseException:
            self._cut(self.size)
            raise
        if checked:
            self._crc = zlib.crc32(data, self._crc)
        self.size += len(data)

    def _cut(self, size: int) -> None:
        """Take back what was written behind ``size``."""
        with contextlib.suppress(OSError):
            self._file.truncate(size)
            self._file.seek(size)
        self.size = size


_sync: Final = getattr(os, "fdatasync", os.fsync)  # not every system has the former


def _sync_folder(folder: Path) -> None:
    """Wait until the disk knows the names in a folder; on Windows a folder cannot be opened."""
    if os.name == "posix":
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
