"""Columns in, MCAP message records out, all records of one shape in one go.

Protobuf messages of one *shape* (the same fields present, the same text, bytes of the same length)
have one layout as long as every number in them has a fixed width. So the records of a shape are
one array: a template repeated, and the columns written over it. Where a shape has but a few rows,
packing them one by one is faster; both ways go by the same layout.
"""

from __future__ import annotations

import functools
import struct
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt
from google.protobuf.descriptor import FieldDescriptor
from mcap.opcode import Opcode

from sniffer.ground.distinct import distinct, groups_of
from sniffer.mcapfile.rows import Blob, Heads, Loose, MessageRows, Void
from sniffer.mcapfile.structs import HEAD, MESSAGE
from sniffer.mcapfile.varints import narrow, sized, spelled, varint, wide_rows

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from google.protobuf.message import Message

    from sniffer.ground.model import I64, Mask

Column = npt.NDArray[Any]

FEW: Final = 6
"""Rows of a shape up to which one by one is faster; measured, flat between 4 and 10."""

_FEW_SHAPES: Final = 6
"""Shapes looked for one by one before the rest is sorted."""

_SHAPES: Final = 4096
"""Shapes remembered; more than that only noise has."""

_F: Final = FieldDescriptor
_WIRE: Final[Mapping[int, tuple[int, str, str]]] = {
    _F.TYPE_DOUBLE: (1, "<f8", "d"),
    _F.TYPE_FIXED64: (1, "<u8", "Q"),
    _F.TYPE_SFIXED64: (1, "<i8", "q"),
    _F.TYPE_FIXED32: (5, "<u4", "I"),
    _F.TYPE_BOOL: (0, "u1", "B"),
    # varints of two bytes, see mcap_numbers
    _F.TYPE_UINT32: (0, "<u2", "H"),
    _F.TYPE_ENUM: (0, "<u2", "H"),
}
"""Wire type, numpy type and struct code of a field with a fixed width, by its declared type."""


class _Shape:
    """One layout: constants and, between them, the variables in the order of the fields.

    ``texts`` has the bytes of a text field, but only the length of a bytes field: -1 leaves it
    open, for ``one`` alone.
    """

    def __init__(
        self,
        fields: Mapping[str, FieldDescriptor],
        names: set[str],
        texts: Mapping[str, bytes | int],
    ) -> None:
        pieces: list[bytes | tuple[str, str, str]] = []
        self._open: int | None = None
        """Where in a record the bytes go whose length is left open."""
        for name, field in fields.items():
            text = texts.get(name)
            if isinstance(text, bytes):
                pieces.append(varint(field.number << 3 | 2) + varint(len(text)) + text)
            elif text is not None:
                pieces.append(varint(field.number << 3 | 2) + (varint(text) if text >= 0 else b""))
                if text < 0:
                    self._open = MESSAGE.size + _width(pieces)
                if text > 0:
                    pieces.append((name, f"V{text}", f"{text}s"))
            elif name in names:
                wire, dtype, code = _WIRE[field.type]
                pieces += [varint(field.number << 3 | wire), (name, dtype, code)]
        size = _width(pieces)
        self._pieces = [
            HEAD.pack(Opcode.MESSAGE, MESSAGE.size - HEAD.size + size),
            ("#channel", "<u2", "H"),
            ("#sequence", "<u4", "I"),
            bytes(8),
            ("#publish", "<i8", "q"),
            *pieces,
        ]
        self.names = [p[0] for p in self._pieces if not isinstance(p, bytes)]
        self._width = MESSAGE.size + size
        codes = "".join(f"{len(p)}s" if isinstance(p, bytes) else p[2] for p in self._pieces)
        self._pack = struct.Struct("<" + codes).pack
        self._arguments: list[Any] = [p if isinstance(p, bytes) else 0 for p in self._pieces]
        self._slots = [i for i, p in enumerate(self._pieces) if not isinstance(p, bytes)]

    @functools.cached_property
    def _template(self) -> npt.NDArray[np.uint8]:
        parts = [
            p if isinstance(p, bytes) else bytes(np.dtype(p[1]).itemsize) for p in self._pieces
        ]
        return np.frombuffer(b"".join(parts), np.uint8).reshape(1, -1)

    @functools.cached_property
    def _dtype(self) -> np.dtype[np.void]:
        parts = enumerate(self._pieces)
        return np.dtype(
            [(f"={i}", f"V{len(p)}") if isinstance(p, bytes) else p[:2] for i, p in parts]
        )

    def many(self, values: Mapping[str, Column], alike: Mapping[str, Any], count: int) -> Void:
        """Return ``count`` records.

        ``values`` has a column for each variable, but for those that are ``alike`` in all rows.
        """
        first = self._template.copy()
        whole = first.view(self._dtype)[:, 0]
        for name in self.names:
            if name not in values:
                whole[name] = alike[name]
        block = np.repeat(first, count, axis=0)
        records = block.view(self._dtype)[:, 0]
        for name, column in values.items():
            records[name] = column
        return block.view(f"V{self._width}")[:, 0]

    def open_ended(
        self, values: Mapping[str, Column], alike: Mapping[str, Any], tails: Sequence[bytes]
    ) -> list[bytes]:
        """Return a record for each tail: what stands around them in one go."""
        block = self.many(values, alike, len(tails)).view(np.uint8)
        filled = [sized(tail) for tail in tails]
        length = np.fromiter(map(len, filled), np.int64, len(filled))
        size = np.ndarray((len(tails),), "<u8", block, 1, (self._width,))  # behind the opcode
        size[:] = self._width - HEAD.size + length
        data, width, at = block.tobytes(), self._width, self._open
        begins = range(0, len(data), width)
        if at is None or at == width:
            return [data[a : a + width] + tail for a, tail in zip(begins, filled, strict=True)]
        return [
            b"".join((data[a : a + at], tail, data[a + at : a + width]))
            for a, tail in zip(begins, filled, strict=True)
        ]

    def one(self, values: Iterable[Any], tail: bytes) -> bytes:
        """Return one record; ``values`` are those of ``names``, ``tail`` fills what is open."""
        arguments = self._arguments.copy()
        for slot, value in zip(self._slots, values, strict=True):
            arguments[slot] = value
        record = self._pack(*arguments)
        if self._open is None:
            return record
        filled = record[HEAD.size : self._open] + sized(tail)
        rest = record[self._open :]
        return b"".join((HEAD.pack(Opcode.MESSAGE, len(filled) + len(rest)), filled, rest))


def _width(pieces: Iterable[bytes | tuple[str, str, str]]) -> int:
    return sum(len(p) if isinstance(p, bytes) else np.dtype(p[1]).itemsize for p in pieces)


class Encoder:
    """Encodes one message type of one bus.

    Args:
        message: its numbers must be double, bool, enum, uint32, fixed32, fixed64 or sfixed64; rows
            whose uint32 or enum is not below 16384 are built one by one.
        text: the text of a code, for the message's one text field that is encoded.
        order: names of fields in the order in which they are written, before all others by their
            numbers. Protobuf allows for any; it decides how well records of one kind pack.
    """

    def __init__(
        self,
        message: type[Message],
        text: Callable[[int], str] = str,
        order: Sequence[str] = (),
    ) -> None:
        declared: list[Any] = list(message.DESCRIPTOR.fields)
        places = {name: place for place, name in enumerate(order, -len(order))}
        declared.sort(key=lambda f: places.get(f.name, f.number))
        self._fields: dict[str, FieldDescriptor] = {f.name: f for f in declared}
        self._bits = {name: i for i, name in enumerate(self._fields)}
        self._message = message
        self._text = text
        self._shapes: dict[tuple[int, int, int], _Shape] = {}

    def encode(
        self,
        heads: Heads,
        numbers: Mapping[str, Column],
        optional: Mapping[str, tuple[Column, Mask]],
        text: tuple[str, I64] | None = None,
        blob: Blob | None = None,
        *,
        lengths_differ: bool = False,
    ) -> list[MessageRows | Loose]:
        """Return a record for each row.

        Args:
            heads: the heads.
            numbers: fields that every row has.
            optional: fields that some rows have: the values, and where there are any.
            text: the text field and each row's code, if the message has one.
            blob: the bytes field, if the message has one.
            lengths_differ: hardly two rows have as many bytes in it.
        """
        wide = wide_rows(self._fields, numbers, optional, len(heads.log))
        if not len(wide):
            return self._encode(heads, numbers, optional, text, blob, lengths_differ)
        told = (self._text, *text) if text is not None else None
        bodies = spelled(self._message, wide, numbers, optional, told, blob)
        rest = np.delete(np.arange(len(heads.log)), wide)
        return [
            Loose.of(bodies, heads.take(wide)),
            *self._encode(
                heads.take(rest),
                {name: column[rest] for name, column in numbers.items()},
                {name: (column[rest], where[rest]) for name, (column, where) in optional.items()},
                text and (text[0], text[1][rest]),
                blob and Blob(blob.name, blob.data, blob.start[rest], blob.length[rest]),
                lengths_differ,
            ),
        ]

    def _encode(
        self,
        heads: Heads,
        numbers: Mapping[str, Column],
        optional: Mapping[str, tuple[Column, Mask]],
        text: tuple[str, I64] | None,
        blob: Blob | None,
        lengths_differ: bool,
    ) -> list[MessageRows | Loose]:
        n = len(heads.log)
        if not n:
            return []
        fields = {**numbers, **{name: values for name, (values, _) in optional.items()}}
        columns = self._columns(heads, fields)
        have = np.full(n, sum(1 << self._bits[name] for name in numbers))
        for name, (_, where) in optional.items():
            have |= where.astype(np.int64) << self._bits[name]
        code = np.zeros(n, np.int64) if text is None else text[1]
        is_open = lengths_differ and blob is not None
        length = np.zeros(n, np.int64) if blob is None or is_open else blob.length

        # of small numbers it is quickly told, and worth it: they need not be fetched shape by shape
        small = {name: c for name, c in columns.items() if c.itemsize <= 4}
        alike = {name: c[0] for name, c in small.items() if (c == c[0]).all()}
        varied = columns.keys() - alike.keys()
        out: list[MessageRows | Loose] = []
        few: list[I64] = []
        groups: Iterable[I64] = (np.arange(n),)
        if n > FEW:
            groups = groups_of(_together(have, code, length), _FEW_SHAPES)
        for rows in groups:
            if len(rows) <= FEW:
                few.append(rows)
                continue
            i = int(rows[0])
            size = -1 if is_open else int(length[i])
            shape = self._shape((int(have[i]), int(code[i]), size), text, blob)
            values = {name: columns[name][rows] for name in shape.names if name in varied}
            if blob is not None and is_open:
                records = shape.open_ended(values, alike, blob.each(rows))
                out.append(Loose(records, heads.take(rows)))
                continue
            if blob is not None and size:
                values[blob.name] = blob.take(rows, size)
            data = shape.many(values, alike, len(rows))
            out.append(MessageRows(data, heads.take(rows)))
        if few:
            rows = np.sort(np.concatenate(few))
            lists = {name: column[rows].tolist() for name, column in columns.items()}
            tails = [b""] * len(rows) if blob is None else blob.each(rows)
            keys = zip(have[rows].tolist(), code[rows].tolist(), tails, strict=True)
            records = []
            for i, (bits, number, tail) in enumerate(keys):
                shape = self._shape((bits, number, -1), text, blob)
                records.append(shape.one([lists[name][i] for name in shape.names], tail))
            out.append(Loose(records, heads.take(rows)))
        return out

    def _columns(self, heads: Heads, fields: Mapping[str, Column]) -> dict[str, Column]:
        columns: dict[str, Column] = {
            "#channel": heads.channel,
            "#sequence": heads.sequence,
            "#publish": heads.publish,
        }
        for name, values in fields.items():
            kind = self._fields[name].type
            if kind in (_F.TYPE_UINT32, _F.TYPE_ENUM):
                columns[name] = narrow(values)
            elif kind == _F.TYPE_BOOL:
                columns[name] = (values != 0).astype(np.uint8)
            else:
                columns[name] = values.astype(_WIRE[kind][1], copy=False)
        return columns

    def _shape(
        self, key: tuple[int, int, int], text: tuple[str, I64] | None, blob: Blob | None
    ) -> _Shape:
        shape = self._shapes.get(key)
        if shape is None:
            if len(self._shapes) >= _SHAPES:
                self._shapes.clear()
            names = {name for name, bit in self._bits.items() if key[0] >> bit & 1}
            texts: dict[str, bytes | int] = {}
            if text is not None:
                texts[text[0]] = self._text(key[1]).encode()
            if blob is not None:
                texts[blob.name] = key[2]
            shape = self._shapes[key] = _Shape(self._fields, names, texts)
        return shape


def _together(*columns: I64) -> I64:
    """Return one number a row, the same where all columns have the same values."""
    key, span = np.zeros(len(columns[0]), np.int64), 1
    for column in columns:
        low = int(column.min())
        size = int(column.max()) - low + 1
        if size > 1 << 31:
            column = distinct(column)[1]
            low, size = 0, int(column.max()) + 1
        if span * size > 1 << 62:
            key = distinct(key)[1]
            span = int(key.max()) + 1
        key = key * size + (column - low)
        span *= size
    return key
