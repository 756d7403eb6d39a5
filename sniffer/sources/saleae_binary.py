"""Raw digital data of Saleae's Logic 2 (File > Export raw data > binary): one channel a file.

The layout is that of support.saleae.com, "Binary Export Format - Version 0" and "Binary and CSV
Export Formats - 2025 Update" (version 1): times are doubles, in seconds from the trigger.
"""

from __future__ import annotations

import itertools
import math
import struct
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from sniffer.ground.model import NS, DamagedInputError, InputError
from sniffer.signals.stretch import LogicInput, Stretch

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.ground.files import Stream
    from sniffer.ground.model import I64
    from sniffer.sources.text import Opened

MAGIC: Final = b"<SALEAE>"

AT_ONCE: Final = 1 << 17
"""Transitions that are read at once."""

SECONDS_MOST: Final = 1e7
"""A time beyond this many seconds, four months, is none: doubles carry ns up to there."""

_HEAD: Final = struct.Struct("<8xii")  # behind the magic: version, type
_VERSION_0: Final = struct.Struct("<IddQ")  # level, begin, end, transitions
_CHUNKS: Final = struct.Struct("<Q")
_VERSION_1: Final = struct.Struct("<IdddQ")  # level, samples a second, begin, end, transitions


class _SaleaePart(NamedTuple):
    level: int
    rate: float
    begin: float
    end: float
    size: int


class _ExactStream:
    """A stream that gives all the bytes that are asked for, or says that it is cut off."""

    def __init__(self, stream: Stream, name: str) -> None:
        self._stream, self._name = stream, name

    def read(self, size: int) -> bytes:
        """Return so many bytes, fewer only at the end."""
        out = bytearray()
        while len(out) < size and (data := self._stream.read(size - len(out))):
            out += data
        return bytes(out)

    def unpack(self, form: struct.Struct) -> tuple[Any, ...]:
        """Return a header.

        Raises:
            DamagedInputError: it is cut off.
        """
        data = self.read(form.size)
        if len(data) < form.size:
            raise self.damaged("it is cut off")
        return form.unpack(data)

    def damaged(self, why: str) -> DamagedInputError:
        """Return what is raised where the file makes no sense."""
        return DamagedInputError(f"{self._name}: {why}")


def read_saleae_binary(opened: Opened) -> LogicInput:
    """Open an export.

    Raises:
        InputError: it is an analog one, or of a version that nobody knows.
        DamagedInputError: it is cut off at its beginning.
    """
    stream = _ExactStream(opened.stream, opened.name)
    version, kind = stream.unpack(_HEAD)
    if kind != 0:
        raise InputError(f"{opened.name}: an analog export: export the digital channel")
    if version not in (0, 1):
        raise InputError(f"{opened.name}: a Saleae export of version {version}: 0 and 1 are known")
    parts = _parts(stream, version)
    first = next(parts, None)
    if first is None:
        raise InputError(f"{opened.name}: the export has no data")
    name = Path(opened.name).stem if opened.path is not None else opened.bus
    sample = NS / first.rate if first.rate else 0
    return LogicInput([name], 1, sample, _stretches(stream, first, parts))


def _parts(stream: _ExactStream, version: int) -> Iterator[_SaleaePart]:
    """Yield what lies between gaps; behind each its transitions are to be read."""
    if version == 0:
        level, begin, end, count = stream.unpack(_VERSION_0)
        yield _checked(stream, _SaleaePart(level, 0, begin, end, count))
        return
    for _ in range(stream.unpack(_CHUNKS)[0]):
        level, rate, begin, end, count = stream.unpack(_VERSION_1)
        yield _checked(stream, _SaleaePart(level, rate, begin, end, count))


def _checked(stream: _ExactStream, part: _SaleaePart) -> _SaleaePart:
    is_rate = part.rate == 0 or (math.isfinite(part.rate) and 1 <= part.rate <= 1e12)
    in_order = -SECONDS_MOST < part.begin <= part.end < SECONDS_MOST
    if part.level not in (0, 1) or not is_rate or not in_order:
        raise stream.damaged("its times or levels cannot be")
    return part


def _stretches(
    stream: _ExactStream, first: _SaleaePart, rest: Iterator[_SaleaePart]
) -> Iterator[Stretch]:
    last_ns, level = round(first.begin * NS), first.level
    for part in itertools.chain((first,), rest):
        begin_ns = round(part.begin * NS)
        if begin_ns < last_ns:
            raise stream.damaged("its times go back")
        if part.level != level:  # it changed while nobody looked
            yield Stretch([level], [np.array([begin_ns], np.int64)], begin_ns)
            last_ns, level = begin_ns, part.level
        left = part.size
        while left:
            edges = _transitions(stream, min(left, AT_ONCE))
            steps = np.diff(edges, prepend=last_ns)
            if (steps < 0).any():
                raise stream.damaged("its times go back")
            yield Stretch([level], [edges], int(edges[-1]))
            last_ns, level, left = int(edges[-1]), level ^ (len(edges) & 1), left - len(edges)
        end_ns = max(round(part.end * NS), last_ns)
        yield Stretch([level], [np.empty(0, np.int64)], end_ns)
        last_ns = end_ns


def _transitions(stream: _ExactStream, count: int) -> I64:
    """Return the times of transitions, in ns."""
    data = stream.read(8 * count)
    seconds = np.frombuffer(data[: len(data) // 8 * 8], "<f8")
    if not len(seconds):
        raise stream.damaged("it is cut off")
    if not (np.abs(seconds) < SECONDS_MOST).all():
        raise stream.damaged("it has times that cannot be")
    return np.asarray(np.rint(seconds * NS).astype(np.int64))
