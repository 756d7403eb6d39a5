"""Where a file's part of the stream ends, told behind its bytes and needed before them.

A file that another one goes on with may hold bytes that were undecided when that one was begun:
they stand in both. The end mark says from where on they belong to the other file. The index at the
end of the file leads to it; in a file without one the records are gone through, head by head.
"""

from __future__ import annotations

import contextlib
import io
import struct
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Metadata, MetadataIndex

from sniffer.ground.cutting import cut
from sniffer.ground.limits import OFFSET_END, TIME_END_NS, number_in
from sniffer.mcapfile.records import TOLD
from sniffer.mcapfile.structs import FOOT, GROUP, HEAD, foot, whole, whole_until
from sniffer.messages import END, MAGIC, OFFSET, TIME

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.ground.files import Stream
    from sniffer.ground.model import Chunk

GROUPS: Final = 64
"""Kinds of records in an index at most: the format has fifteen."""


class End(NamedTuple):
    """The end of a bus: its offset in the stream, and when the byte before it was on the wire.

    ``t_ns`` is told where the end lies within a chunk.
    """

    offset: int
    t_ns: int | None = None

    def of(self, chunk: Chunk, at: int) -> Chunk | None:
        """Return what lies before the end of a chunk that begins at ``at``, None for nothing."""
        keep = self.offset - at
        if keep >= len(chunk.data):
            return chunk
        if keep <= 0:
            return None
        told = None if chunk.t_ns is None else self.t_ns
        return cut(chunk, keep, chunk.t_ns if told is None else told)[0]


class _NonsenseError(Exception):
    """What stands there makes no sense, or there is nothing."""


def ends(stream: Stream) -> dict[str, End]:
    """Return where a file ends by bus; a bus of which nothing is told ends with its last byte."""
    facts = end_facts(stream)
    out: dict[str, End] = {}
    for key, value in facts.items():
        what, _, bus = key.partition(".")
        if what == OFFSET and (offset := number_in(value, 0, OFFSET_END)) is not None:
            out[bus] = End(offset, number_in(facts.get(f"{TIME}.{bus}", ""), 0, TIME_END_NS - 1))
    return out


def end_facts(stream: Stream) -> dict[str, str]:
    """Return what the end mark says, nothing where there is none, or where nobody can seek."""
    return facts_named(stream, END)


def facts_named(stream: Stream, name: str) -> dict[str, str]:
    """Return what the last metadata record of a name says, nothing as for the end mark.

    The stream is read on from where it was.
    """
    if not isinstance(stream, io.IOBase) or not stream.seekable():
        return {}
    here = stream.tell()
    file = _File(stream, name)
    try:
        for look in (file.indexed, file.walked):
            with contextlib.suppress(_NonsenseError):
                at = look()
                return {} if at is None else file.facts(at)
        return {}
    finally:
        stream.seek(here)


class _File:
    """Looks up records by their places."""

    def __init__(self, stream: io.IOBase, name: str) -> None:
        self._stream, self._name = stream, name
        # how the body of a metadata record with this name begins
        self._begins = struct.pack("<I", len(name)) + name.encode()
        self._size = stream.seek(0, io.SEEK_END)

    def indexed(self) -> int | None:
        """Return where by the file's index the last such record stands.

        Raises:
            _NonsenseError: there is no index.
        """
        end = self._size - FOOT
        told = foot(self._read(end, FOOT))
        if told is None:
            raise _NonsenseError
        if not told.offsets:  # another tool's
            return None
        found: int | None = None
        length = end - told.offsets
        if length % GROUP.size or length > GROUPS * GROUP.size:
            raise _NonsenseError
        for opcode, size, of, at, n in GROUP.iter_unpack(self._read(told.offsets, length)):
            if (opcode, size) != (Opcode.SUMMARY_OFFSET, GROUP.size - HEAD.size):
                raise _NonsenseError
            if of == Opcode.METADATA_INDEX:
                for index in _all(MetadataIndex, of, self._read(at, n)):
                    if index.name == self._name:
                        found = index.offset
        return found

    def walked(self) -> int | None:
        """Return where the last such record stands, from head to head."""
        if self._size < len(MAGIC) or self._read(0, len(MAGIC)) != MAGIC:
            return None
        at, found = len(MAGIC), None
        while at + HEAD.size <= self._size:
            opcode, size = HEAD.unpack(self._read(at, HEAD.size))
            if opcode in (0, Opcode.DATA_END) or size > self._size - at - HEAD.size:
                break
            is_told = opcode == Opcode.METADATA and size >= len(self._begins)
            if is_told and self._read(at + HEAD.size, len(self._begins)) == self._begins:
                found = at
            at += HEAD.size + size
        return found

    def facts(self, at: int) -> dict[str, str]:
        """Return what the record there says.

        Raises:
            _NonsenseError: there is none.
        """
        opcode, size = HEAD.unpack(self._read(at, HEAD.size))
        if opcode != Opcode.METADATA:
            raise _NonsenseError
        record: Metadata = _parsed(Metadata, self._read(at + HEAD.size, size))
        if record.name != self._name:
            raise _NonsenseError
        return record.metadata

    def _read(self, at: int, size: int) -> bytes:
        """Return bytes that must be there."""
        if not (0 <= at <= self._size - size and 0 <= size <= TOLD):
            raise _NonsenseError
        self._stream.seek(at)
        data: bytes = self._stream.read(size)
        if len(data) != size:
            raise _NonsenseError
        return data


def _all(kind: Any, opcode: int, data: bytes) -> Iterator[Any]:
    """Yield records of one kind that stand side by side."""
    if whole_until(data) != len(data):
        raise _NonsenseError
    for found, body, end in whole(data):
        if found != opcode:
            raise _NonsenseError
        yield _parsed(kind, data[body:end])


def _parsed(kind: Any, body: bytes) -> Any:
    """Return a record."""
    try:
        return kind.read(ReadDataStream(io.BytesIO(body)))
    except (McapError, struct.error, UnicodeDecodeError):
        raise _NonsenseError from None
