"""The last seconds of some buses, raw: what a flight recorder has when something happens.

Bounded in time and in bytes. Chunks are held as columns, a block a round, because a minute of eight
busy buses is half a million reads: as objects they would take more than their bytes do.
"""

from __future__ import annotations

import array
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from sniffer.ground.cutting import behind
from sniffer.ground.model import Chunk, Clock, Direction

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from sniffer.ground.cutting import Placed
    from sniffer.ground.model import Mark

MARGIN_NS: Final = 3_000_000_000
"""The ring is longer than was asked for by this: what happened is known only after a while (bytes
wait to be decoded), and the time before it is to be there in full."""

MEMORY: Final = 64 << 20
"""What a ring may take in any case. A slow bus says a few bytes a round: they take twenty times as
much memory as there are."""

BLOCK_COST: Final = 400
"""What a block takes beside its chunks, in bytes; 392 were measured (tracemalloc, CPython 3.11)."""

CHUNK_COST: Final = 17
"""What a chunk takes beside its bytes: a time, a size, a direction."""

MARKED_COST, MARK_COST = 85, 88
"""What a chunk with marks takes more, and each of them (measured likewise): noise leaves many."""

_WIRES: Final = tuple(Direction)  # by their numbers, without a call for each chunk


@dataclass(frozen=True, slots=True)
class RingBlock:
    """Chunks of one bus that came in one round; ``start`` is the offset of their first byte."""

    bus: str
    start: int
    data: bytes
    clock: Clock
    times: array.array[int]
    sizes: array.array[int]
    directions: bytes
    marks: Mapping[int, tuple[Mark, ...]]

    @classmethod
    def of(cls, bus: str, start: int, chunks: Sequence[Chunk]) -> RingBlock:
        """Make a block of chunks, which all have a time."""
        return cls(
            bus,
            start,
            b"".join(c.data for c in chunks),
            chunks[0].clock,
            array.array("q", [c.t_ns or 0 for c in chunks]),
            array.array("q", [len(c.data) for c in chunks]),
            bytes(c.direction for c in chunks),
            {i: c.marks for i, c in enumerate(chunks) if c.marks},
        )

    @property
    def end(self) -> int:
        """Offset behind the last byte."""
        return self.start + len(self.data)

    @property
    def cost(self) -> int:
        """Bytes of memory that it takes, about: many small blocks are more than their bytes."""
        marks = sum(map(len, self.marks.values()))
        cost = len(self.data) + len(self.times) * CHUNK_COST + BLOCK_COST
        return cost + len(self.marks) * MARKED_COST + marks * MARK_COST

    def placed(self) -> Iterator[Placed]:
        """Yield the chunks again, each with its offset."""
        at = 0
        for i, (t_ns, size) in enumerate(zip(self.times, self.sizes, strict=True)):
            wire = _WIRES[self.directions[i]]
            marks = self.marks.get(i, ())
            data = self.data[at : at + size]
            yield self.start + at, Chunk(data, t_ns, self.clock, self.bus, wire, marks)
            at += size

    def latest(self, t_ns: int) -> int | None:
        """Return the offset of the last chunk that came until a time; None: all came later."""
        if min(self.times) > t_ns:  # most of them, and at once
            return None
        last = max(i for i, came_ns in enumerate(self.times) if came_ns <= t_ns)
        return self.start + sum(self.sizes[:last])


@dataclass(frozen=True, slots=True)
class Past:
    """What a bus said from a place in its stream on; ``start`` is its offset.

    The chunks are made as they are asked for: those of a minute take a second, in which nothing
    would be recorded.
    """

    start: int
    blocks: Sequence[RingBlock]

    @property
    def first_ns(self) -> int:
        """When its first chunk came."""
        return next(self.chunks()).t_ns or 0

    def chunks(self) -> Iterator[Chunk]:
        """Yield its chunks; of the first one what lies behind the place."""
        for block in self.blocks:
            for _, chunk in behind(block.placed(), self.start, 0)[0]:
                yield chunk


class _RingBus:
    """One bus: its blocks, and the places at which nothing is open."""

    def __init__(self) -> None:
        self.end = 0
        self.blocks: deque[RingBlock] = deque()
        self.places: deque[int] = deque()


class Ring:
    """Keeps the latest chunks.

    Args:
        span_ns: how much of the past is kept.
        most: bytes that are kept, of all buses together; older ones go sooner than ``span_ns``
            where there are more, or where they take more memory than that and ``MEMORY``.
    """

    def __init__(self, span_ns: int, most: int) -> None:
        self.span_ns = span_ns
        self.size = 0
        """Bytes that are here."""
        self.is_short = False
        """Whether bytes had to go before their time."""
        self._most, self._cost = most, 0
        self._buses: dict[str, _RingBus] = {}

    def add(self, bus: str, chunks: Sequence[Chunk]) -> RingBlock:
        """Take chunks of a bus, as they came."""
        held = self._buses.setdefault(bus, _RingBus())
        block = RingBlock.of(bus, held.end, chunks)
        held.blocks.append(block)
        held.end = block.end
        self.size += len(block.data)
        self._cost += block.cost
        return block

    def decided(self, places: Mapping[str, int]) -> None:
        """Learn up to which byte each bus is decoded: there a file may begin."""
        for bus, at in places.items():
            held = self._buses.get(bus)
            if held is not None and (not held.places or at > held.places[-1]):
                held.places.append(at)

    def trim(self, now_ns: int) -> None:
        """Let go of what is too old, or too much."""
        for held in self._buses.values():
            while held.blocks and held.blocks[0].times[-1] < now_ns - self.span_ns - MARGIN_NS:
                self._drop(held)
        while self.size > self._most or self._cost > max(self._most, MEMORY):
            older = [h for h in self._buses.values() if len(h.blocks) > 1]
            if not older:
                break
            self.is_short = True
            self._drop(min(older, key=lambda h: h.blocks[0].times[0]))
        for held in self._buses.values():
            begin = held.blocks[0].start if held.blocks else held.end
            while len(held.places) > 1 and held.places[1] <= begin:
                held.places.popleft()

    def since(self, t_ns: int) -> dict[str, Past]:
        """Return what each bus said from about then on.

        A bus begins where nothing is open, a little before that time; one that was never decoded
        begins with the last chunk until then.
        """
        out: dict[str, Past] = {}
        for bus, held in self._buses.items():
            if not held.blocks:
                continue
            oldest = held.blocks[0].start
            until = (block.latest(t_ns) for block in reversed(held.blocks))
            first = next((at for at in until if at is not None), oldest)
            begin = max(max((p for p in held.places if p <= first), default=first), oldest)
            out[bus] = Past(begin, [block for block in held.blocks if block.end > begin])
        return out

    def offsets(self, t_ns: int) -> dict[str, int]:
        """Return how far each bus had got at a time, in bytes of its stream."""
        out: dict[str, int] = {}
        for bus, held in self._buses.items():
            later = next((b for b in held.blocks if b.times[-1] > t_ns), None)
            out[bus] = held.end
            if later is not None:
                out[bus] = next(at for at, c in later.placed() if (c.t_ns or 0) > t_ns)
        return out

    def blocks(self) -> list[RingBlock]:
        """Return all that is here, in the order of time."""
        every = [block for held in self._buses.values() for block in held.blocks]
        return sorted(every, key=lambda block: block.times[0])

    def _drop(self, held: _RingBus) -> None:
        block = held.blocks.popleft()
        self.size -= len(block.data)
        self._cost -= block.cost
