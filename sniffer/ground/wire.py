"""What construct has not: checks at any place, sizes by a table, all bytes but the last.

A ``Packet`` is a Struct whose checks are fields like others: a ``Seal`` names the fields it covers,
and these may stand behind it as well as before. It is judged when all of the packet was read.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any, Literal

import construct as c
import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from sniffer.ground.checksums import Sum


Order = Literal["little", "big"]


class Seal(c.Subconstruct):  # type: ignore[misc]  # construct has no types
    """A field that holds the checksum of other fields of its packet, which it names in order.

    Args:
        field: what holds it: Byte, or Int16ul, or Int16ub where the high byte is the first.
        checksum: one of ``sniffer.ground.checksums``, or an object like them.
        over: names of the fields that it covers.
        some: it is the last of its packet, covers the field before it, and is only there where that
            has bytes.
    """

    def __init__(self, field: Any, checksum: Sum, *over: str, some: bool = False) -> None:
        super().__init__(field)
        self.checksum, self.over, self.some = checksum, over, some

    def stands(self, fields: Any) -> bool:
        """Tell whether it is there, by the fields before it."""
        return not self.some or any(fields.get(name) for name in self.over)

    def _parse(self, stream: Any, context: Any, path: str) -> Any:
        return super()._parse(stream, context, path) if self.stands(context) else None

    def _build(self, obj: Any, stream: Any, context: Any, path: str) -> Any:
        return super()._build(obj, stream, context, path) if self.stands(context) else None


def order_of(name: str, field: Any, checksum: Any) -> Order:
    """Return which byte of a checksum's field is the first.

    Raises:
        TypeError: it is no field of one or two bytes, or the checksum has not as many.
    """
    if not isinstance(field, c.FormatField) or field.fmtstr not in (">B", "<H", ">H"):
        raise TypeError(f"{name} is held by Byte, Int16ul or Int16ub, not by {field!r}")
    width = getattr(checksum, "width", field.length)
    if width != field.length:
        raise TypeError(
            f"{name} is held by {field.length} byte{'s'[: field.length - 1]}, and its checksum has "
            f"{width}: Byte holds one, Int16ul and Int16ub hold two"
        )
    return "big" if field.fmtstr == ">H" else "little"


class ByCode:
    """How many bytes a packet's variable field has, where nothing but its ``code`` tells.

    As ``Bytes(BY_CODE)`` in a declaration the family fills in its commands; a code that it does not
    have makes no packet.
    """

    def __init__(self, sizes: Mapping[int, int] | None = None) -> None:
        self._sizes = np.full(256, -1, np.int64)
        for code, size in (sizes or {}).items():
            self._sizes[code] = size

    def __call__(self, context: Any) -> Any:
        """Return it for one code or for a column of them, -1 where there is no such packet."""
        found = self._sizes[context["code"]]
        return found if isinstance(found, np.ndarray) else int(found)

    def knows(self, context: Any) -> Any:
        """Tell which codes make a packet."""
        return self(context) >= 0


BY_CODE = ByCode()


class AllBut(c.Construct):  # type: ignore[misc]
    """All bytes but the last ``behind``, which other fields take."""

    def __init__(self, behind: int) -> None:
        super().__init__()
        self.behind = behind

    def _parse(self, stream: Any, context: Any, path: str) -> bytes:
        rest = c.stream_read_entire(stream, path)
        if len(rest) < self.behind:
            raise c.StreamError(f"{len(rest)} bytes are left, {self.behind} stand last", path=path)
        stream.seek(-self.behind, io.SEEK_CUR)
        return bytes(rest[: len(rest) - self.behind])

    def _build(self, obj: bytes, stream: Any, context: Any, path: str) -> bytes:
        c.stream_write(stream, obj, len(obj), path)
        return obj


class Packet(c.Struct):  # type: ignore[misc]
    """A Struct that holds if its seals do; building one fills them in."""

    def _parse(self, stream: Any, context: Any, path: str) -> Any:
        begin = c.stream_tell(stream, path)
        fields = super()._parse(stream, context, path)
        end = c.stream_tell(stream, path)
        c.stream_seek(stream, begin, io.SEEK_SET, path)
        raw = c.stream_read(stream, end - begin, path)
        spans = self._spans(fields, len(raw))
        for name, seal in self.seals():
            covered = b"".join(raw[slice(*spans[other])] for other in seal.over)
            if seal.stands(fields) and seal.checksum(covered) != fields[name]:
                raise c.ChecksumError(f"{name} does not hold", path=path)
        return fields

    def _spans(self, fields: Any, size: int) -> dict[str, tuple[int, int]]:
        """Return where each field stands, by what was read of the one whose size varies."""
        out, at = {}, 0
        absent = {name for name, seal in self.seals() if not seal.stands(fields)}
        sizes = [
            0 if sub.name in absent else _size(sub, fields.get(sub.name)) for sub in self.subcons
        ]
        for sub, length in zip(self.subcons, sizes, strict=True):
            out[sub.name] = (at, at + length)
            at += length
        if at != size:
            raise c.SizeofError(f"a packet of {size} bytes has fields of {at}")
        return out

    def _build(self, obj: Any, stream: Any, context: Any, path: str) -> Any:
        own = c.Container(_=context, _params=context._params, _root=None, _parsing=False)
        own._building, own._sizing, own._io = True, False, stream
        own._root = context.get("_root", context)
        own.update({} if obj is None else obj)
        seals = dict(self.seals())
        raw: dict[str, bytes] = {}
        for number, sub in enumerate(self.subcons):
            part = io.BytesIO()
            value = 0 if sub.name in seals else own.get(sub.name)
            own[sub.name] = sub._build(value, part, own, path)
            raw[sub.name or str(number)] = part.getvalue()
        for name, seal in seals.items():
            if not seal.stands(own):
                continue
            own[name] = seal.checksum(b"".join(raw[other] for other in seal.over))
            raw[name] = seal.subcon.build(own[name])
        for part_of in raw.values():
            c.stream_write(stream, part_of, len(part_of), path)
        return own

    def seals(self) -> Iterator[tuple[str, Seal]]:
        """Yield the checks, by name."""
        for sub in self.subcons:
            inner = sub
            while isinstance(inner, c.Renamed):
                inner = inner.subcon
            if isinstance(inner, Seal):
                yield sub.name, inner


def _size(con: Any, value: Any) -> int:
    """Return how many bytes a field took."""
    return len(value) if isinstance(value, bytes) else int(con.sizeof())
