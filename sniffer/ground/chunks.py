"""What chunks say beside their bytes, in columns: a stamp, a clock and a direction each, and marks.

``runs`` has chunks that are columns from the start; here those that are objects become some.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.model import I64, U8, Chunk, Clock, Direction, MarkKind, Mask
from sniffer.ground.runs import ChunkRun

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from sniffer.ground.model import Mark

_NONE, _FILE, _READ, _ = (np.uint8(c) for c in Clock)
_UNKNOWN: Final = np.uint8(Direction.UNKNOWN)


class ChunkColumns:
    """What chunks say beside their bytes, in columns: chunks are many, and objects."""

    sizes: I64
    clocks: U8
    directions: U8
    times: Sequence[int | None] | I64
    """As ``clocks``, of each chunk: those of runs are an array."""

    def __init__(self, chunks: Sequence[Chunk]) -> None:
        if isinstance(chunks, ChunkRun):
            self._take(chunks)
            return
        self._counts = _counted((i, k.marks) for i, k in enumerate(chunks) if k.marks)
        times = [k.t_ns for k in chunks]
        self.sizes = np.array([len(k.data) for k in chunks], np.int64)
        # enumerations are slow to put into an array; bytes take them as they are
        clocks = np.frombuffer(bytes([k.clock for k in chunks]), np.uint8)
        self.directions = np.frombuffer(bytes([k.direction for k in chunks]), np.uint8)
        untold = np.array([t is None for t in times]) if None in times else np.False_
        # a time that nobody vouches for is a time stamp like any other
        self.clocks = np.where(untold, _NONE, np.where(clocks == _NONE, _FILE, clocks))
        self.times = times

    def __len__(self) -> int:
        return len(self.times)

    def counts(self, kind: MarkKind, default: int = 0) -> I64:
        """Return the greatest count of each chunk's marks of a kind; ``default``: it has none."""
        out = np.full(len(self), default, np.int64)
        if kind in self._counts:
            rows, counts = self._counts[kind]
            np.maximum.at(out, rows, counts)
        return out

    def _take(self, run: ChunkRun) -> None:
        self._counts = _counted(run.marks.items())
        self.sizes, self.directions, self.times = run.sizes, run.directions, run.t_ns
        self.clocks = np.full(len(run), run.clock or _FILE, np.uint8)

    def merged(self, latency: I64) -> Mask:
        """Tell which chunks are of two taps; their latency is raised to what their marks say."""
        out: Mask = (self.clocks == _READ) & (self.directions != _UNKNOWN)
        if MarkKind.MERGED in self._counts:
            rows, counts = self._counts[MarkKind.MERGED]
            out[rows] = True
            np.maximum.at(latency, rows, counts)
        return out


def _counted(
    marked: Iterable[tuple[int, tuple[Mark, ...]]],
) -> Mapping[MarkKind, tuple[list[int], list[int]]]:
    """Return by kind of mark whose chunks' marks these are, and what they count."""
    out: dict[MarkKind, tuple[list[int], list[int]]] = {}
    for i, marks in marked:
        for mark in marks:
            kind = mark.kind
            told = out.get(kind)
            if told is None:
                told = out[kind] = ([], [])
            told[0].append(i)
            told[1].append(mark.count)
    return out


def clock_of(chunk: Chunk) -> Clock:
    """Return a chunk's clock; a time that nobody vouches for is a time stamp like any other."""
    if chunk.t_ns is None:
        return Clock.NONE
    return chunk.clock or Clock.FILE
