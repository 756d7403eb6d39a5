"""Chunks and runs of chunks, as readers yield them, in groups of some size."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

from sniffer.ground.limits import BUSES_MOST, GROUP, GROUP_CHUNKS
from sniffer.ground.model import Chunk, DamagedInputError
from sniffer.ground.runs import ChunkRun, joined
from sniffer.sources.text import FIRST_LINES, PAUSE, DamagedLine

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence


class ManyBusesError(DamagedInputError):
    """An input names more buses than there can be."""


class _Group:
    """What has come of a group: runs as long as nothing else comes, else chunks."""

    def __init__(self, most: int, most_chunks: int, lag_s: float) -> None:
        self._most, self._most_chunks = most, most_chunks
        self._is_slow = lag_s < math.inf
        self._due = time.monotonic() + lag_s
        self._chunks: list[Chunk] = []
        self._runs: list[ChunkRun] = []
        self._size = self._count = 0

    def __bool__(self) -> bool:
        return self._count > 0

    def is_full(self) -> bool:
        """Tell whether it is to be handed on."""
        is_large = self._size >= self._most or self._count >= self._most_chunks
        return is_large or (self._is_slow and time.monotonic() > self._due)

    def add(self, chunk: Chunk) -> bool:
        """Take a chunk; tell whether the group is full."""
        if self._runs:
            self._chunks, self._runs = [one for run in self._runs for one in run], []
        self._chunks.append(chunk)
        self._size += len(chunk.data)
        self._count += 1
        return self.is_full()

    def fill(self, run: ChunkRun) -> ChunkRun:
        """Take as much of a run as there is room for; return the rest."""
        count = min(run.until(self._most - self._size), self._most_chunks - self._count)
        part = run.part(0, count)
        if self._chunks:
            self._chunks += part
        else:
            self._runs.append(part)
        self._size += len(part.data)
        self._count += count
        return run.part(count, len(run))

    def whole(self) -> Sequence[Chunk]:
        """Return all of it."""
        return joined(self._runs) if self._runs else self._chunks


def grouped(
    chunks: Iterable[Chunk | ChunkRun],
    lag_s: float,
    first: tuple[int, int] = (GROUP, GROUP_CHUNKS),
) -> Iterator[Sequence[Chunk]]:
    """Group chunks; those read before damage are yielded first, unless a first line is nonsense.

    ``first``: bytes and chunks of the first group.
    """
    group = _Group(*first, lag_s)
    most = first
    buses: set[str] = set()
    try:
        for chunk in chunks:
            if chunk is PAUSE:
                if group:
                    yield group.whole()
                group = _Group(*most, lag_s)
                continue
            if chunk.bus not in buses:
                buses.add(chunk.bus)
                if len(buses) > BUSES_MOST:
                    raise ManyBusesError(f"more than {BUSES_MOST} buses: are they names of one?")
            rest: Sequence[Chunk] = ()
            if isinstance(chunk, ChunkRun):
                rest = group.fill(chunk)
            elif not group.add(chunk):
                continue
            while group.is_full():
                yield group.whole()
                most = GROUP, GROUP_CHUNKS
                group = _Group(*most, lag_s)
                if isinstance(rest, ChunkRun) and rest:
                    rest = group.fill(rest)
    except KeyboardInterrupt:
        if group:
            yield group.whole()  # what has been read is decoded before the end
        raise
    except DamagedInputError as error:
        wrong = isinstance(error, DamagedLine) and error.nonsense and error.line <= FIRST_LINES
        if group and not wrong:
            yield group.whole()
        raise
    if group:
        yield group.whole()
