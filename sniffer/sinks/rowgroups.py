"""Parquet files joined as they are: row groups are copied, and one footer tells of all of them.

What is packed stays packed. Only the footer must be understood, and of it only where it names
places in its file: it is read as the Thrift compact protocol's fields, whatever they mean.
https://parquet.apache.org/docs/file-format/metadata/
"""

from __future__ import annotations

import io
import struct
from typing import TYPE_CHECKING, Any, BinaryIO, Final

from sniffer.ground.model import OutputError

if TYPE_CHECKING:
    from collections.abc import Callable

MAGIC: Final = b"PAR1"
TAIL: Final = 8
"""Bytes behind the footer: its length, and the magic."""

AT_ONCE: Final = 1 << 20

_TRUE, _FALSE, _BYTE, _INTS, _DOUBLE, _BINARY, _LISTS, _STRUCT = (
    1,
    2,
    3,
    (4, 5, 6),
    7,
    8,
    (9, 10),
    12,
)

# numbers of fields, as parquet.thrift has them
_ROWS, _GROUPS = 3, 4  # of the file
_COLUMNS, _GROUP_AT, _ORDINAL = 1, 5, 7  # of a row group
_CHUNK_AT, _META, _INDEXES = 2, 3, (4, 6)  # of a column in it
_PLACES: Final = (9, 10, 11, 14)  # of that: pages of data, of an index, of names, Bloom filter

Fields = dict[int, tuple[int, Any]]
"""A structure: type and value by number; a list is the type of its elements, and these."""


class RowGroups:
    """A Parquet file that grows by whole files with the same columns.

    ``file`` is open, and may hold something already; its first bytes are the magic.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._told: Fields | None = None

    def append(self, source: BinaryIO) -> None:
        """Add the row groups of a whole file.

        Raises:
            OutputError: it is no Parquet file that this can join.
        """
        size = source.seek(0, io.SEEK_END)
        told = footer_of(source)
        end = size - TAIL - len(told)
        source.seek(len(MAGIC))
        by = self._file.tell() - len(MAGIC)
        left = end - len(MAGIC)
        while left and (data := source.read(min(AT_ONCE, left))):
            self._file.write(data)
            left -= len(data)
        self.tell(told, by)

    def tell(self, footer: bytes, by: int = 0) -> None:
        """Take in what a footer tells of row groups that stand here, all of them moved ``by``."""
        fields = _read(footer)
        groups = fields[_GROUPS][1][1]
        for group in groups:
            _move(group, by)
        if self._told is None:
            self._told = fields
        else:
            kind, rows = self._told[_ROWS]
            self._told[_ROWS] = kind, rows + fields[_ROWS][1]
            self._told[_GROUPS][1][1].extend(groups)
        for nth, group in enumerate(self._told[_GROUPS][1][1]):
            if _ORDINAL in group:
                if nth < 1 << 15:
                    group[_ORDINAL] = group[_ORDINAL][0], nth
                else:  # it has 16 bits, and need not be there
                    del group[_ORDINAL]

    def close(self) -> None:
        """Write the footer; the file stays open."""
        assert self._told is not None, "a file without columns"
        footer = _written(self._told)
        self._file.write(footer + struct.pack("<I", len(footer)) + MAGIC)


def footer_of(file: BinaryIO) -> bytes:
    """Return the footer of a whole file.

    Raises:
        OutputError: it is none.
    """
    size = file.seek(0, io.SEEK_END)
    file.seek(max(0, size - TAIL))
    told = file.read(TAIL)
    length = int.from_bytes(told[:4], "little")
    if told[4:] != MAGIC or length > size - TAIL - len(MAGIC):
        raise OutputError("a part of a table is no whole file")
    file.seek(size - TAIL - length)
    return file.read(length)


def _move(group: Fields, by: int) -> None:
    """Let a row group stand elsewhere."""
    _shift(group, _GROUP_AT, by)
    for column in group[_COLUMNS][1][1]:
        if any(index in column for index in _INDEXES):
            raise OutputError("a part of a table has an index of pages, which cannot be joined")
        if column.get(_CHUNK_AT, (0, 0))[1]:  # 0: it tells no place
            _shift(column, _CHUNK_AT, by)
        for place in _PLACES:
            _shift(column[_META][1], place, by)


def _shift(fields: Fields, number: int, by: int) -> None:
    if number in fields:
        kind, at = fields[number]
        fields[number] = kind, at + by


def _read(footer: bytes) -> Fields:
    return _Reader(footer).struct()


class _Reader:
    """Thrift compact protocol, as structures of fields."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def struct(self) -> Fields:
        out: Fields = {}
        number = 0
        while head := self._byte():
            step, kind = head >> 4, head & 15
            number = number + step if step else _unzigzag(self._varint())
            out[number] = kind, self._value(kind)
        return out

    def _value(self, kind: int) -> Any:
        if kind in (_TRUE, _FALSE):
            return None  # the type says it
        if kind in _INTS:
            return _unzigzag(self._varint())
        if kind == _BINARY:
            return self._take(self._varint())
        if kind == _STRUCT:
            return self.struct()
        if kind in _LISTS:
            return self._list()
        if kind in (_BYTE, _DOUBLE):
            return self._take(1 if kind == _BYTE else 8)
        raise OutputError(f"a part of a table has a footer with fields of type {kind}")

    def _list(self) -> tuple[int, list[Any]]:
        head = self._byte()
        size, kind = head >> 4, head & 15
        size = self._varint() if size == 15 else size
        if kind in (_TRUE, _FALSE):  # a byte each
            return kind, [self._take(1) for _ in range(size)]
        return kind, [self._value(kind) for _ in range(size)]

    def _byte(self) -> int:
        self._at += 1
        return self._data[self._at - 1]

    def _take(self, size: int) -> bytes:
        self._at += size
        return self._data[self._at - size : self._at]

    def _varint(self) -> int:
        out = shift = 0
        while (byte := self._byte()) & 0x80:
            out |= (byte & 0x7F) << shift
            shift += 7
        return out | byte << shift


def _written(fields: Fields) -> bytes:
    out = bytearray()
    _write_struct(fields, out)
    return bytes(out)


def _write_struct(fields: Fields, out: bytearray) -> None:
    before = 0
    for number, (kind, value) in sorted(fields.items()):
        step, before = number - before, number
        if 1 <= step <= 15:
            out.append(step << 4 | kind)
        else:
            out.append(kind)
            _write_varint(_zigzag(number), out)
        _write_value(kind, value, out)
    out.append(0)


def _write_value(kind: int, value: Any, out: bytearray) -> None:
    if kind in _INTS:
        _write_varint(_zigzag(value), out)
    elif kind == _BINARY:
        _write_varint(len(value), out)
        out += value
    elif kind == _STRUCT:
        _write_struct(value, out)
    elif kind in _LISTS:
        each, values = value
        size = len(values)
        out.append(min(size, 15) << 4 | each)
        if size >= 15:
            _write_varint(size, out)
        write: Callable[[Any], None] = (
            out.extend if each in (_TRUE, _FALSE) else lambda v: _write_value(each, v, out)
        )
        for one in values:
            write(one)
    elif value is not None:
        out += value


def _write_varint(value: int, out: bytearray) -> None:
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)


def _zigzag(value: int) -> int:
    return value << 1 if value >= 0 else ~(value << 1)


def _unzigzag(value: int) -> int:
    return value >> 1 ^ -(value & 1)
