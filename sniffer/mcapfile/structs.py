"""How records of an MCAP file stand in its bytes, for whoever writes or reads them in bulk.

Source: the MCAP format specification, "Records": each has an opcode, the length of its body, and
its fields in order; a file ends in DataEnd, the summary, the summary's offsets, Footer and magic.
"""

from __future__ import annotations

import struct
import zlib
from typing import TYPE_CHECKING, Final, NamedTuple

from mcap.opcode import Opcode

from sniffer.messages import MAGIC

if TYPE_CHECKING:
    from collections.abc import Iterator

HEAD: Final = struct.Struct("<BQ")
"""Head of any record: opcode, length."""

MESSAGE: Final = struct.Struct("<BQHIQQ")
"""Head of a message record: opcode, length, channel, sequence, log time, publish time."""

DATA_END: Final = struct.Struct("<BQI")
"""A whole record of that kind: opcode, length, checksum of the data."""

GROUP: Final = struct.Struct("<BQBQQ")
"""A whole summary offset: opcode, length, opcode of the group, where it begins, its length."""

_FOOTER: Final = struct.Struct("<BQQQI")

CRC: Final = 4
"""Bytes of a footer's checksum, which covers all of the summary and the footer before it."""

FOOT: Final = _FOOTER.size + len(MAGIC)
"""The last bytes of a file."""


class Foot(NamedTuple):
    """What the last bytes of a file say: where its summary begins, and the offsets behind that.

    Either is 0 where there is none.
    """

    summary: int
    offsets: int


def foot(data: bytes) -> Foot | None:
    """Return what the last ``FOOT`` bytes of a file say; None: they are no end of a file."""
    if len(data) != FOOT or not data.endswith(MAGIC):
        return None
    opcode, size, summary, offsets, _ = _FOOTER.unpack_from(data)
    sound = (opcode, size) == (Opcode.FOOTER, _FOOTER.size - HEAD.size)
    return Foot(summary, offsets) if sound else None


def ended(summary: int, at: int, offsets: bytes, crc: int) -> bytes:
    """Return all behind a summary from ``summary`` to ``at``, whose checksum is ``crc``."""
    told = (Opcode.FOOTER, _FOOTER.size - HEAD.size, summary, at)
    crc = zlib.crc32(offsets + _FOOTER.pack(*told, 0)[:-CRC], crc)
    return offsets + _FOOTER.pack(*told, crc) + MAGIC


def whole(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield the opcode of each record that stands there whole, where its body begins, and its end.

    It ends at one that is cut, or at zeros.
    """
    at = 0
    while len(data) - at >= HEAD.size:
        opcode, size = HEAD.unpack_from(data, at)
        body = at + HEAD.size
        at = body + size
        if not opcode or at > len(data):
            return
        yield opcode, body, at


def whole_until(data: bytes) -> int:
    """Return where the last record ends that stands there whole."""
    return max((end for _, _, end in whole(data)), default=0)
