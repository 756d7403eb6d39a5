"""Where a capture can be cut so that what lies between reads as it does in the whole.

Between two frames, neither within an exchange nor beside bytes that no frame claims: what becomes
of those depends on what stands around them. A place like that is looked for outwards from the
moment that was asked for, up to ``NEAR`` bytes; on a line that has none the cut is between two
records.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.decoding.partends import BusEnds, PartEnds
from sniffer.decoding.spans import Span
from sniffer.ground.codes import OUTCOMES
from sniffer.ground.gaps import Gaps
from sniffer.ground.heard import SteadyPass, SteadyTime

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from sniffer.decoding.partends import EdgeTimes, EndsSince
    from sniffer.decoding.sink import Part
    from sniffer.ground.model import I64, Batch, Chunk, Mask
    from sniffer.protocols.base import BusProtocol

NEAR: Final = 4096
"""How far a clear place is looked for, in bytes: as far as the decoder looks for one."""

_DAMAGED: Final = OUTCOMES.index("damaged")


@dataclass(frozen=True, slots=True)
class _Records:
    """Frames and gaps of a pass in order, and its exchanges as (begin, end)."""

    start: I64
    end: I64
    t_start: I64
    t_end: I64
    is_frame: Mask
    exchanges: I64

    @classmethod
    def of(cls, parts: Sequence[Part]) -> _Records:
        starts, ends, begins, times, frames, exchanges = [], [], [], [], [], []
        for _, batch in parts:
            f, g = batch.frames, Gaps.of(batch.gaps)
            starts += [f.start + batch.base, g.start + batch.base]
            ends += [f.end + batch.base, g.start + g.length + batch.base]
            begins += [f.t_start, g.t_ns]
            times += [f.t_end, g.t_ns]
            frames += [np.ones(len(f), bool), np.zeros(len(g), bool)]
            exchanges.append(_exchanges(batch, g))
        start = np.concatenate(starts)
        order = np.argsort(start, kind="stable")
        end, t_start, t_end = (np.concatenate(c)[order] for c in (ends, begins, times))
        is_frame = np.concatenate(frames)[order]
        return cls(start[order], end, t_start, t_end, is_frame, np.concatenate(exchanges))

    @classmethod
    def joined(cls, parts: Sequence[_Records]) -> _Records:
        names = ("start", "end", "t_start", "t_end", "is_frame", "exchanges")
        return cls(*(np.concatenate([getattr(p, name) for p in parts]) for name in names))

    def clear(self) -> I64:
        """Return the places between two frames across which no exchange leads."""
        between = (self.end[:-1] == self.start[1:]) & self.is_frame[:-1] & self.is_frame[1:]
        places = self.start[1:][between]
        begin, end = np.sort(self.exchanges[:, 0]), np.sort(self.exchanges[:, 1])
        begun = np.searchsorted(begin, places, "left")
        over = np.searchsorted(end, places, "right")
        clear: I64 = places[begun == over]
        return clear


def _exchanges(batch: Batch, gaps: Gaps) -> I64:
    """Return where exchanges begin and end; a torn answer is the unclaimed bytes behind it."""
    t, base = batch.transactions, batch.base
    whole = np.flatnonzero((t.request != -1) & (t.response >= 0))
    asked = batch.asked(t.request[whole])
    pairs = [np.stack([asked.start, batch.frames.end[t.response[whole]]], 1)]
    torn = np.flatnonzero((t.request != -1) & (t.response < 0) & (t.outcome == _DAMAGED))
    if len(torn) and len(gaps):
        asked = batch.asked(t.request[torn])
        after = np.searchsorted(gaps.start, asked.end)
        there = after < len(gaps)
        after = after[there]
        ends = gaps.start[after] + gaps.length[after]
        pairs.append(np.stack([asked.start[there], ends], 1))
    return np.concatenate(pairs).astype(np.int64) + base


@dataclass(slots=True)
class _PartEdge:
    """The records around a place that moves on until it is known."""

    kept: list[_Records] = field(default_factory=list)

    def add(self, records: _Records, place: int | None, *, known: bool) -> None:
        """Take a pass; let go of what is too far away to matter."""
        if known and place is not None and int(records.start[0]) > place + 2 * NEAR:
            return
        self.kept.append(records)
        here = int(records.end[-1]) if place is None else place
        while len(self.kept) > 1 and int(self.kept[1].start[0]) < here - 2 * NEAR:
            del self.kept[0]


class _PartOfBus:
    def __init__(self) -> None:
        self.begin: int | None = None
        self.end: int | None = None
        self.first = self.last = -1
        self._is_ended = False
        self._lower, self._upper = _PartEdge(), _PartEdge()

    def add(self, records: _Records, edges: EdgeTimes) -> None:
        if self.first < 0:
            self.first = int(records.start[0])
        self.last = max(self.last, int(records.end.max()))
        known = self.begin is not None
        if not known:
            after = edges.may_begin()
            if after.any():
                self.begin = int(records.start[int(np.argmax(after))])
        self._lower.add(records, self.begin, known=known)
        was_ended = self._is_ended
        if not was_ended:
            begin = np.inf if self.begin is None else self.begin
            later = edges.are_beyond(records.start >= begin)
            self._is_ended = bool(later.any())
            stop = int(np.argmax(later)) if self._is_ended else len(later)
            if stop:
                self.end = int(records.end[:stop].max())
        self._upper.add(records, self.end, known=was_ended and self.end is not None)

    @property
    def is_over(self) -> bool:
        """Whether what comes from now on changes nothing of where it ends."""
        return self.end is not None and self.last > self.end + 2 * NEAR

    def span(self) -> Span | None:
        """Return what is cut out, None where there is nothing."""
        if self.begin is None or self.end is None or self.begin >= self.end:
            return None
        lower = _Records.joined(self._lower.kept).clear()
        upper = _Records.joined(self._upper.kept)
        below = lower[(lower <= self.begin) & (lower >= self.begin - NEAR)]
        begin = int(below[-1]) if len(below) else self.begin
        if not len(below) and self.begin - NEAR <= self.first:
            begin = self.first
        places = upper.clear()
        above = places[(places >= self.end) & (places <= self.end + NEAR)]
        end = int(above[0]) if len(above) else self.end
        if not len(above) and self.end + NEAR >= self.last:
            end = self.last
        then = np.flatnonzero(upper.start == end)
        return Span(begin, end, int(upper.t_start[then[0]]) if len(then) else None)


class Slicer:
    """A sink that finds what lies between two moments.

    A record belongs to it that ends there: its last byte is when its content was known.
    """

    def __init__(self) -> None:
        self._find: Callable[[Sequence[Part]], EndsSince] = lambda parts: functools.partial(
            _fixed, PartEnds()
        )
        self._since: EndsSince | None = None
        self._steady: dict[str, SteadyTime] = {}
        self._ends: dict[str, BusEnds] = {}
        self._buses: dict[str, _PartOfBus] = {}

    def find(self, ends: Callable[[Sequence[Part]], EndsSince]) -> None:
        """Take which moments are meant: ``ends`` tells them from what was decoded first."""
        self._find = ends

    @property
    def ends(self) -> PartEnds:
        """The moments, as they are meant where the capture begins."""
        return PartEnds() if self._since is None else self._since(None)

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing."""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Take what a pass decided."""
        self.write_together(bus, [(protocol, batch)])

    def write_together(self, bus: str, parts: Sequence[Part]) -> None:
        """Take what several protocols said in one pass."""
        records = _Records.of(parts)
        if self._since is None:
            self._since = self._find(parts)
        if not len(records.start):
            return
        if bus not in self._buses:
            self._buses[bus], self._steady[bus] = _PartOfBus(), SteadyTime()
            self._ends[bus] = BusEnds(self._since)
        steady = self._steady[bus].of(records.t_end)
        told = SteadyPass(records.start, records.t_end, steady - records.t_end)
        self._add(bus, records, self._ends[bus].edges(told))

    def _add(self, bus: str, records: _Records, edges: EdgeTimes) -> None:
        self._buses[bus].add(records, edges)

    def close(self) -> None:
        """Do nothing."""

    def spans(self) -> dict[str, Span]:
        """Return what is cut out of each bus that says anything there."""
        found = {name: bus.span() for name, bus in self._buses.items()}
        return {name: span for name, span in found.items() if span is not None}


class Splitter(Slicer):
    """The same, and where each bus is cut every so many ns from the begin on.

    Pieces of a bus lie side by side: each begins where the one before it ends, and all bytes of the
    whole are in one. They are known by their numbers, from 0.
    """

    def __init__(self, every_ns: int) -> None:
        super().__init__()
        self._every_ns = every_ns
        self._base_ns: int | None = None
        self._cuts: dict[str, dict[int, Span | None]] = {}
        self._open: dict[str, dict[int, _PartOfBus]] = {}

    def ends_of(self, number: int) -> tuple[int, int]:
        """Return from when to when a piece goes, but that no exchange is torn."""
        begin = (self._base_ns or 0) + number * self._every_ns
        return begin, begin + self._every_ns - 1

    def pieces(self, whole: Mapping[str, Span]) -> dict[int, dict[str, Span]]:
        """Return the pieces of some spans, by number and bus: those in which anything was said."""
        out: dict[int, dict[str, Span]] = {}
        for bus, span in whole.items():
            begin = span.begin
            last = {number: part.span() for number, part in self._open[bus].items()}
            every = sorted({**self._cuts[bus], **last}.items())
            cuts = [(number, one) for number, one in every if one is not None]
            for number, found in cuts:
                # behind its last piece nothing is left of a bus
                is_last = number == cuts[-1][0] or found.end >= span.end
                end, next_ns = (span.end, span.next_ns) if is_last else (found.end, found.next_ns)
                if end > begin:
                    out.setdefault(number, {})[bus] = Span(begin, end, next_ns)
                    begin = end
        return dict(sorted(out.items()))

    def _add(self, bus: str, records: _Records, edges: EdgeTimes) -> None:
        is_before = all(part.begin is None for part in self._buses.values())
        super()._add(bus, records, edges)
        if is_before and (base_ns := self._base(records, edges)) != self._base_ns:
            self._base_ns = base_ns
            self._cuts.clear()
            self._open.clear()
        cuts, pending = self._cuts.setdefault(bus, {}), self._open.setdefault(bus, {})
        told = edges.records
        t_ns = np.maximum(told.t_ns + told.moved - (self._base_ns or 0), 0)
        for number in np.unique(t_ns // self._every_ns).tolist():
            if number not in cuts:
                pending.setdefault(number, _PartOfBus())
        for number, part in [*pending.items()]:
            ends = PartEnds(stop=self.ends_of(number)[1])
            part.add(records, BusEnds(functools.partial(_fixed, ends)).edges(told))
            if part.is_over:
                cuts[number] = pending.pop(number).span()

    def _base(self, records: _Records, edges: EdgeTimes) -> int:
        """Return from when on pieces count, as far as is known: a clock may still come to it."""
        if edges.ends.start is None:
            return int(records.t_start[0]) if self._base_ns is None else self._base_ns
        begun = np.flatnonzero(edges.may_begin())
        row = int(begun[0]) if len(begun) else -1
        return int(edges.low[row] + edges.records.moved[row])


def _fixed(ends: PartEnds, told_ns: int | None) -> PartEnds:
    """Return ends that are the same whatever the clock says."""
    del told_ns
    return ends
