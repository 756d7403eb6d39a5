"""Numbers in messages: two bytes where that is enough, however many where it is not.

A varint of two bytes gives the rows of a shape one width. What it does not hold is rare, and is
spelled out message by message, by protobuf itself.
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt
from google.protobuf.descriptor import FieldDescriptor

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from google.protobuf.message import Message

    from sniffer.ground.model import I64, Mask
    from sniffer.mcapfile.rows import Blob

_F: Final = FieldDescriptor
_WRITTEN: Final[Mapping[int, int]] = {
    _F.TYPE_FIXED64: 1,
    _F.TYPE_SFIXED64: 1,
    _F.TYPE_STRING: 2,
    _F.TYPE_BYTES: 2,
    _F.TYPE_MESSAGE: 2,
    _F.TYPE_FIXED32: 5,
}
"""Wire type of a field by its declared type."""

NARROW: Final = 1 << 14
"""Numbers below this one are varints of two bytes."""


def narrow(values: npt.NDArray[Any]) -> npt.NDArray[np.uint16]:
    """Return numbers below ``NARROW`` as varints of two bytes: legal, if not the shortest."""
    v = values.astype(np.uint16)
    return np.asarray((v & 0x7F) | 0x80 | ((v >> 7) << 8), np.uint16)


def wide_rows(
    fields: Mapping[str, FieldDescriptor],
    numbers: Mapping[str, npt.NDArray[Any]],
    optional: Mapping[str, tuple[npt.NDArray[Any], Mask]],
    count: int,
) -> I64:
    """Return which of ``count`` rows have a number that ``narrow`` cannot write."""
    out = np.zeros(count, bool)
    for name, values in (*numbers.items(), *((k, v) for k, (v, _) in optional.items())):
        if fields[name].type in (FieldDescriptor.TYPE_UINT32, FieldDescriptor.TYPE_ENUM):
            there = optional[name][1] if name in optional else np.ones(count, bool)
            out |= ((values < 0) | (values >= NARROW)) & there
    return np.flatnonzero(out)


def varint(number: int) -> bytes:
    """Return the shortest varint."""
    out = bytearray()
    while number > 0x7F:
        out.append(number & 0x7F | 0x80)
        number >>= 7
    out.append(number)
    return bytes(out)


def key(message: type[Message], name: str) -> bytes:
    """Return what stands before a field, as the format has it: its number and how it is written.

    Raises:
        KeyError: its type is none of those whose values are written here.
    """
    field = message.DESCRIPTOR.fields_by_name[name]
    return varint(field.number << 3 | _WRITTEN[field.type])


def sized(data: bytes) -> bytes:
    """Return a text, bytes or a message with the length before it."""
    return _length(len(data)) + data


_length: Final = functools.lru_cache(maxsize=1 << 12)(varint)


def spelled(
    message: type[Message],
    rows: I64,
    numbers: Mapping[str, npt.NDArray[Any]],
    optional: Mapping[str, tuple[npt.NDArray[Any], Mask]],
    text: tuple[Callable[[int], str], str, I64] | None,
    blob: Blob | None,
) -> Iterator[Message]:
    """Yield a message for each of ``rows``; the arguments are those of ``Encoder.encode``."""
    fields = message.DESCRIPTOR.fields_by_name
    whole = {n for n, f in fields.items() if f.type != FieldDescriptor.TYPE_DOUBLE}
    data = blob.each(rows) if blob is not None else []
    for nth, row in enumerate(rows.tolist()):
        told = {name: column[row].item() for name, column in numbers.items()}
        told |= {name: values[row].item() for name, (values, has) in optional.items() if has[row]}
        out = message(**{n: int(v) if n in whole else v for n, v in told.items()})
        if text is not None:
            setattr(out, text[1], text[0](int(text[2][row])))
        if blob is not None:
            setattr(out, blob.name, data[nth])
        yield out
