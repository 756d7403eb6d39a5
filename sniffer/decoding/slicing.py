"""A part of what was decoded, cut between two records.

All of a capture is decoded, and what lies outside is left out afterwards: so no frame is torn, no
answer loses its request, and what servos were set to before is known. What is left out are whole
frames and gaps from the beginning and from the end; each bus is cut for itself.
"""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from sniffer.anomalies.found import Anomalies
from sniffer.decoding.partends import BusEnds
from sniffer.decoding.surrounding import Surroundings
from sniffer.ground.heard import HeardSpan, SteadyTime, span_of
from sniffer.ground.model import NS, Clock, Mask

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sniffer.decoding.partends import EdgeTimes, EndsSince, PartEnds
    from sniffer.decoding.sink import Part
    from sniffer.ground.model import I64, Batch, Chunk
    from sniffer.protocols.base import BusProtocol

    Choose = Callable[[str, BusProtocol, Batch], Callable[[str], Mask]]

QUIET_NS = 5_000_000_000
"""So long after the end nothing more is told of what came before it: the longest a servo is waited
for is a second."""


def first_told_ns(stamp_ns: int | None, parts: Sequence[Part]) -> int | None:
    """Return when the first record of a capture was told, from which its seconds count, in ns.

    ``stamp_ns`` is the stamp of its first chunk, ``parts`` what was decoded first: where a host
    held bytes back, they were said long before that. Where it is of the beginning of the first
    frame, that frame's end is meant, as of each record.
    """
    if stamp_ns is None:
        return None
    clocked = [batch for _, batch in parts if batch.clock != Clock.NONE]
    first = [int(batch.frames.t_end[0]) for batch in clocked if len(batch.frames)]
    first += [batch.gaps[0].t_ns for batch in clocked if len(batch.gaps)]
    begun = [int(b.frames.t_start[0]) for b in clocked if len(b.frames)]
    is_of_first = any(t_ns <= stamp_ns for t_ns in begun)
    return min(first) if is_of_first else min((stamp_ns, *first))


class Slice:
    """Passes on what was said in a part of a capture; ``ends`` gives it, once something is decoded.

    ``ends`` takes the time of the first record (None: no clock) and returns where the part ends.
    """

    def __init__(self, ends: Callable[[int | None], EndsSince], name: str = "in it") -> None:
        self._ends = ends
        self._since: EndsSince | None = None
        self._name = name
        self._first: int | None = None
        self._is_heard = False
        self._begun: set[str] = set()
        self._ended: set[str] = set()
        self._heard: dict[str, SteadyTime] = {}
        self._steady: dict[str, SteadyTime] = {}
        self._bus_ends: dict[str, BusEnds] = {}
        self._spans: dict[str, HeardSpan] = {}
        self._newest = 0
        self._stamp = 0
        """The last one that was heard."""

    def hear(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take chunks before they are decoded."""
        heard = self._heard.setdefault(bus, SteadyTime())
        for chunk in chunks:
            if not self._is_heard and chunk.data:
                self._is_heard = True
                self._first = chunk.t_ns
            if chunk.t_ns is not None:
                self._stamp = chunk.t_ns
                self._newest = max(self._newest, heard.at(chunk.t_ns))

    def __str__(self) -> str:
        return self._name

    @property
    def seconds(self) -> float | None:
        """How long the capture is, as far as it was read; None: nothing was said in it."""
        if self._spans:
            return span_of(self._spans.values()) / NS
        return (self._newest - (self._first or 0)) / NS if self._is_heard else None

    @property
    def is_over(self) -> bool:
        """Whether nothing more can belong to it."""
        if self._heard and self._heard.keys() <= self._ended:
            return True
        ends = [bus.ends for bus in self._bus_ends.values()]
        if any(each.stops_by_stamp for each in ends):  # a clock that is set may still come to it
            return bool(self._begun) and all(_is_past(self._stamp, each) for each in ends)
        return bool(ends) and all(_is_past(self._newest, each) for each in ends)

    def of(self, bus: str, parts: Sequence[Part]) -> list[Part]:
        """Return what of a pass belongs to it, none where nothing does."""
        if self._since is None:
            self._first = first_told_ns(self._first, parts)
            self._since = self._ends(self._first)
        batches = [batch for _, batch in parts]
        for protocol, batch in parts:
            if len(batch.frames):
                self._spans.setdefault(bus, HeardSpan()).take(protocol.name, batch.frames)
        records = self._steady.setdefault(bus, SteadyTime()).records(batches)
        if len(records.t_ns):
            self._newest = max(self._newest, int((records.t_ns + records.moved).max()))
        if bus not in self._bus_ends:
            self._bus_ends[bus] = BusEnds(self._since)
        edges = self._bus_ends[bus].edges(records)
        if bus in self._ended:
            return []
        begin, end = self._cut(bus, len(batches[0].data), edges)
        kept = [(protocol, _part_of(batch, begin, end, edges)) for protocol, batch in parts]
        return kept if any(b.data or b.remarks or b.anomalies for _, b in kept) else []

    def _cut(self, bus: str, size: int, edges: EdgeTimes) -> tuple[int, int]:
        """Return where in the bytes of a pass the part begins and ends."""
        at = edges.records.start
        begin, end = 0 if bus in self._begun or edges.ends.start is None else size, size
        if begin:
            first = at[edges.may_begin()]
            begin = int(first[0]) if len(first) else size
        if begin < size:
            self._begun.add(bus)
        later = at[edges.are_beyond(at >= begin)]
        if len(later):
            end = max(int(later[0]), begin)
            self._ended.add(bus)
        return begin, end


def _is_past(t_ns: int, ends: PartEnds) -> bool:
    """Tell whether nothing more is told of a part, when so much was heard."""
    return ends.stop is not None and t_ns > ends.stop + QUIET_NS


def _part_of(batch: Batch, begin: int, end: int, edges: EdgeTimes) -> Batch:
    """Return what a batch says of a part of its bytes, all of it where it is no less."""
    found = Anomalies.of(batch.anomalies)
    has = edges.has(found.t_ns, found.known_at - batch.base)
    if end - begin == len(batch.data) and has.all():
        return batch
    return sliced(batch, begin, end, edges.has)


class Narrowing:
    """What of a capture goes to the sinks: a part of it, and of that the rows that are chosen."""

    def __init__(
        self, part: Slice | None = None, choose: Choose | None = None, context: int = 0
    ) -> None:
        self.part = part
        self._choose = choose
        self._around = Surroundings(context) if context else None

    def hear(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take chunks before they are decoded."""
        if self.part is not None:
            self.part.hear(bus, chunks)

    def of(self, bus: str, parts: Sequence[Part]) -> list[Part]:
        """Return what the sinks are given of a pass, empty where that is nothing."""
        if self.part is not None:
            parts = self.part.of(bus, parts)
        if self._choose is None:
            return list(parts)
        return [(p, replace(b, chosen=self._choose(bus, p, b))) for p, b in parts]

    def passes(self, bus: str, parts: Sequence[Part]) -> list[list[Part]]:
        """Return what is due, pass by pass: with lines around a selection one waits for others."""
        mine = self.of(bus, parts)
        if self._around is None or not mine:
            return [mine] if mine else []
        return self._around.of(bus, mine)

    @property
    def open_buses(self) -> set[str]:
        """Buses of which a pass waits."""
        return set() if self._around is None else self._around.open_buses

    def rest(self) -> list[tuple[str, list[Part]]]:
        """Return what waits at the end, with its bus."""
        return [] if self._around is None else self._around.rest()


def sliced(batch: Batch, begin: int, end: int, has: Callable[[I64, I64], Mask]) -> Batch:
    """Return what a batch says of its bytes from ``begin`` on and before ``end``.

    Both stand between two records. ``has`` tells by their times, and by the bytes in the batch that
    they are about, which anomalies and remarks stay.
    """
    f, t, v = batch.frames, batch.transactions, batch.values
    low, high = np.searchsorted(f.start, (begin, end)).tolist()
    frames = f.take(slice(low, high))
    frames = replace(frames, start=frames.start - begin, data_start=frames.data_start - begin)
    last = np.maximum(batch.rows_of(t.request), t.response)
    t = t.take((last >= low) & (last < high))
    asked, earlier = t.request, None
    # requests that are left out, and those of earlier batches, stand before this one
    left_out = (asked != -1) & (asked < low)
    if left_out.any():
        earlier = batch.asked(asked[left_out])
        earlier = replace(
            earlier, start=earlier.start - begin, data_start=earlier.data_start - begin
        )
    request = np.where(asked >= low, asked - low, -1)
    request[left_out] = -2 - np.arange(int(left_out.sum()))
    response = np.where(t.response >= 0, t.response - low, -1)
    found = Anomalies.of(batch.anomalies)
    remarked = np.array([(r.t_ns, r.start - batch.base) for r in batch.remarks], np.int64)
    stays = has(*remarked.reshape(-1, 2).T).tolist()
    values = v.take((v.row >= low) & (v.row < high))
    return replace(
        batch,
        base=batch.base + begin,
        data=batch.data[begin:end],
        frames=frames,
        gaps=tuple(
            gap._replace(start=gap.start - begin) for gap in batch.gaps if begin <= gap.start < end
        ),
        transactions=replace(t, request=request, response=response),
        values=replace(values, row=values.row - low),
        anomalies=found.take(np.flatnonzero(has(found.t_ns, found.known_at - batch.base)))
        if len(found)
        else (),
        remarks=tuple(itertools.compress(batch.remarks, stays)),
        cut=batch.cut if end == len(batch.data) else None,
        before=earlier,
    )
