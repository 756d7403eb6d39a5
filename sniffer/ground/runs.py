"""Many small chunks of one bus as columns: a table with a row a byte would be an object a byte.

A run is a sequence of chunks like any other; they are made when somebody looks at them. Who decodes
takes the columns as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Final, overload

import numpy as np

from sniffer.ground.model import I64, U8, Chunk, Clock, Direction, Mark

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

_DIRECTIONS: Final = tuple(Direction)


@dataclass(frozen=True, slots=True, eq=False)
class ChunkRun(Sequence[Chunk]):
    """Chunks with a time each, none of them empty.

    ``ends`` are the places in ``data`` behind each of them, ``t_ns`` their times (in the bounds of
    ``limits``), ``directions`` their wires; ``marks`` are those of the few that have any, by row.
    """

    data: bytes
    ends: I64
    t_ns: I64
    directions: U8
    clock: Clock
    bus: str
    marks: Mapping[int, tuple[Mark, ...]] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.ends)

    @overload
    def __getitem__(self, row: int) -> Chunk: ...

    @overload
    def __getitem__(self, row: slice) -> Sequence[Chunk]: ...

    def __getitem__(self, row: int | slice) -> Chunk | Sequence[Chunk]:
        if isinstance(row, slice):
            begin, end, step = row.indices(len(self))
            if step == 1:
                return self.part(begin, end)
            return [self[n] for n in range(begin, end, step)]
        row = range(len(self))[row]
        return next(iter(self.part(row, row + 1)))

    def __iter__(self) -> Iterator[Chunk]:
        data, clock, bus, marks = self.data, self.clock, self.bus, self.marks
        ends = self.ends.tolist()
        rows = zip(pairwise([0, *ends]), self.t_ns.tolist(), self.directions.tolist(), strict=True)
        for n, ((a, b), t_ns, way) in enumerate(rows):
            yield Chunk(data[a:b], t_ns, clock, bus, _DIRECTIONS[way], marks.get(n, ()))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and list(self) == list(other)

    __hash__ = None  # type: ignore[assignment]  # as of a list

    @property
    def sizes(self) -> I64:
        """Bytes of each chunk."""
        return np.diff(self.ends, prepend=0)

    def part(self, begin: int, end: int) -> ChunkRun:
        """Return the chunks from one row to another."""
        end = max(begin, end)
        if (begin, end) == (0, len(self)):
            return self
        first = int(self.ends[begin - 1]) if begin else 0
        behind = int(self.ends[end - 1]) if end else 0
        return ChunkRun(
            self.data[first : max(first, behind)],
            self.ends[begin:end] - first,
            self.t_ns[begin:end],
            self.directions[begin:end],
            self.clock,
            self.bus,
            {n - begin: marks for n, marks in self.marks.items() if begin <= n < end},
        )

    def until(self, size: int) -> int:
        """Return how many chunks have that many bytes together, or just more; all if none have."""
        return min(int(np.searchsorted(self.ends, size)) + 1, len(self))


def joined(parts: Sequence[Sequence[Chunk]]) -> Sequence[Chunk]:
    """Return parts that follow each other as one: a run if they are runs of one bus and clock."""
    if len(parts) == 1:
        return parts[0]
    runs = [part for part in parts if isinstance(part, ChunkRun)]
    if not runs or len(runs) < len(parts) or len({(run.bus, run.clock) for run in runs}) > 1:
        return [chunk for part in parts for chunk in part]
    first = runs[0]
    marks: dict[int, tuple[Mark, ...]] = {}
    ends, behind, rows = [], 0, 0
    for run in runs:
        marks |= {rows + n: told for n, told in run.marks.items()}
        ends.append(run.ends + behind)
        behind += len(run.data)
        rows += len(run)
    return ChunkRun(
        b"".join(run.data for run in runs),
        np.concatenate(ends),
        np.concatenate([run.t_ns for run in runs]),
        np.concatenate([run.directions for run in runs]),
        first.clock,
        first.bus,
        marks,
    )


def bytes_of(chunks: Sequence[Chunk]) -> bytes:
    """Return the bytes of chunks."""
    return chunks.data if isinstance(chunks, ChunkRun) else b"".join([c.data for c in chunks])


def has_marks(chunks: Sequence[Chunk]) -> bool:
    """Tell whether anything is remarked of chunks."""
    return bool(chunks.marks) if isinstance(chunks, ChunkRun) else any(c.marks for c in chunks)


def with_bytes(chunks: Sequence[Chunk]) -> Sequence[Chunk]:
    """Return the chunks that hold any; those of a run do."""
    return chunks if isinstance(chunks, ChunkRun) else tuple(c for c in chunks if c.data)


def by_bus(group: Iterable[Chunk]) -> Mapping[str, Sequence[Chunk]]:
    """Return the chunks of each bus; a run is of one."""
    if isinstance(group, ChunkRun):
        return {group.bus: group} if group else {}
    out: dict[str, list[Chunk]] = {}
    for chunk in group:
        out.setdefault(chunk.bus, []).append(chunk)
    return out
