"""In what order did the pieces of two wires come? Of all orders that the stamps allow, the best.

A piece may stand before another if it can have ended before that one began: the soonest moment of
its end against the latest moment of the other's beginning. What an order is worth:

- an answer that fits the request before it counts most, one of the right servo half as much, bytes
  no frame claims right behind a request a quarter: it may be the answer, damaged;
- where all has come that could explain it, an answer to nothing costs as much as one that fits is
  worth, a request without the answer it must have a quarter.

Among orders of the same worth it is the one that moves pieces least, requests first on ties.
"""

from __future__ import annotations

import itertools
import math
from bisect import bisect_right
from dataclasses import replace
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.framing import Block
from sniffer.model import ANY_ID, ECHO_DIFFERS, NEVER_NS, NO_ALT, RESPONSE, Chunk, MarkKind

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from sniffer.protocols.base import BusProtocol

FITS: Final = 4_000_000
"""Worth of an answer that fits; to move one piece costs 1 at most. See above for the others."""

NEARLY: Final = FITS // 2
DAMAGED: Final = FITS // 4
UNASKED: Final = FITS
MISSED: Final = FITS // 4

NEVER: Final = math.inf
"""The cost of what the stamps forbid."""

BARE: Final = 8
"""Bytes that are looked at for an answer without a header."""

TRIALS: Final = 800
"""The most bytes that one pass tries as such answers, else pieces stay by their time."""

REMEMBERED: Final = 4096
"""Trials whose result is kept: passes overlap, and short answers are soon all known."""

CELLS: Final = 640
"""Pairs of places on both wires that one pass weighs, else pieces stay by their time."""

BURST: Final = 16
"""How many times as much of either is weighed where the tap came late: rare, and all at once."""

DIRECT, BEHIND, ANSWERED = range(3)
"""What stands since the last request: nothing, bytes no frame claims, an answer."""

OPEN: Final = (1.0, 0.75, 0.0)
"""How much a request is still open then: the bytes may have been its answer."""


class Said(NamedTuple):
    """What pairing needs to know about a frame; all but id and token is a request's."""

    servo_id: int
    token: int
    alt_id: int
    many: bool
    must: bool
    raw: bytes

    def worth(self, answer: Said) -> int:
        """Return what an answer to this request is worth."""
        may = self.servo_id, NO_ALT if self.alt_id < 0 else self.alt_id
        if self.alt_id != ANY_ID and answer.servo_id not in may:
            return 0
        return FITS if answer.token in (self.token, -1) else NEARLY


class Unit(NamedTuple):
    """What is not cut on one wire: a frame, unclaimed bytes of one chunk, or marks (no bytes).

    ``first_ns`` is the latest moment at which it can have begun, ``last_ns`` ended, ``soonest_ns``
    the soonest at which it can have ended. ``said`` is None for frames that neither wait for an
    answer nor are one.
    """

    start: int
    end: int
    first_ns: int
    last_ns: int
    soonest_ns: int
    framed: bool = False
    said: Said | None = None


Framed = list[tuple[int, int, Said | None]]
"""Start, end and content of the frames on one wire."""

Piece = tuple[Chunk, int, int, int]
"""A part of a chunk, from byte to byte, and the latest moment of its last byte."""


def held_of(chunk: Chunk) -> int:
    """Return by how much a chunk may be older still because the tap itself came late, in ns."""
    return max((m.count for m in chunk.marks if m.kind == MarkKind.HELD), default=0)


def stamp_of(chunk: Chunk) -> int:
    """Return the stamp of a chunk that a lane holds."""
    assert chunk.t_ns is not None  # the lane gave it one
    return chunk.t_ns


class Lane:
    """What one wire holds that is not handed on yet.

    ``times`` is the latest moment at which each byte can have come, ``soonest`` the earliest.
    """

    def __init__(self, byte_ns: int, latency_ns: int) -> None:
        self.chunks: list[Chunk] = []
        self.data = bytearray()
        self.times: list[int] = []
        self.soonest: list[int] = []
        self._byte_ns = byte_ns
        self._latency_ns = latency_ns
        self._begun = 0  # bytes of the first chunk that were handed on
        self._last = 0

    def add(self, chunk: Chunk, t_ns: int) -> None:
        """Take a chunk in; the stamp of one without is ``t_ns``."""
        n, before = len(chunk.data), self._last
        self._last = t_ns = max(t_ns, before)
        self.chunks.append(chunk if chunk.t_ns == t_ns else replace(chunk, t_ns=t_ns))
        self.data += chunk.data
        times = [max(t_ns - k * self._byte_ns, before) for k in range(n - 1, -1, -1)]
        self.times += times
        # The adapter held the first byte no longer than its latency, and the others came behind it;
        # a read that holds more than comes in that time has been held up elsewhere.
        spare = max(self._latency_ns - (n - 1) * self._byte_ns, 0) or self._latency_ns
        spare += held_of(chunk)
        self.soonest += [t_ns - k * self._byte_ns - spare for k in range(n - 1, -1, -1)]

    def due_ns(self, hold_ns: int) -> int:
        """Return when what has been held longest must be handed on."""
        if not self.chunks:
            return NEVER_NS
        stamp = stamp_of(self.chunks[0])
        if not self.chunks[0].data or held_of(self.chunks[0]):
            return stamp + hold_ns  # what was held up with it on the other wire may come after it
        # A long read may be due before it came; then it is as soon as all of its time has come.
        return max(self.times[0] + hold_ns, stamp)

    def unit(self, start: int, end: int, *, framed: bool = False, said: Said | None = None) -> Unit:
        """Return the bytes between two offsets as a unit."""
        first = self.times[start] - self._byte_ns
        return Unit(start, end, first, self.times[end - 1], self.soonest[end - 1], framed, said)

    def units(self, frames: Framed, until: int) -> list[Unit]:
        """Return frames and what lies between them, up to offset ``until``."""
        ends: list[int] = []
        empty: list[tuple[int, int]] = []
        at = -self._begun
        for chunk in self.chunks:
            at += len(chunk.data)
            if chunk.data:
                ends.append(at)
            else:
                empty.append((at, stamp_of(chunk)))
        empty.reverse()
        out: list[Unit] = []
        at = 0
        for start, stop, said in [*frames, (until, until, None)]:
            while True:
                while empty and empty[-1][0] <= at:
                    offset, t_ns = empty.pop()
                    if offset == at:  # else a frame goes across it, and takes it along
                        out.append(Unit(at, at, t_ns, t_ns, t_ns - self._latency_ns))
                if at >= start:
                    break
                out.append(self.unit(at, min(start, ends[bisect_right(ends, at)])))
                at = out[-1].end
            if stop > start:
                out.append(self.unit(start, stop, framed=True, said=said))
                at = stop
        return out

    def take(self, unit: Unit) -> Iterator[Piece]:
        """Yield the parts of chunks that a unit is made of; units are taken in order."""
        at = unit.start
        while True:
            chunk = self.chunks[0]
            size = len(chunk.data)
            stop = min(self._begun + unit.end - at, size)
            at += stop - self._begun
            yield chunk, self._begun, stop, self.times[at - 1] if size else stamp_of(chunk)
            self._begun = stop
            if stop == size:
                del self.chunks[0]
                self._begun = 0
            if at == unit.end:
                return

    def forget(self, end: int) -> None:
        """Drop the bytes before an offset; their chunks have been taken."""
        del self.data[:end]
        del self.times[:end]
        del self.soonest[:end]


class Place(NamedTuple):
    """What the last request was, if it has an answer, and what stands since."""

    ask: Said | None = None
    since: int = ANSWERED

    def behind_asked(self, unit: Unit) -> Place:
        """Return the place behind a unit of the controller's wire."""
        if unit.framed:
            return Place(unit.said, DIRECT)
        return Place(self.ask, max(self.since, BEHIND)) if unit.end > unit.start else self

    def behind_heard(self, unit: Unit) -> tuple[Place, int]:
        """Return the place behind a unit of the servos' wire, and what it is worth as an answer."""
        if unit.end == unit.start:
            return self, 0
        if not unit.framed:
            worth = DAMAGED if self.ask and self.since == DIRECT else 0
            return Place(self.ask, max(self.since, BEHIND)), worth
        worth = 0
        if self.ask and unit.said and (self.ask.many or self.since != ANSWERED):
            worth = self.ask.worth(unit.said)
        return Place(self.ask, ANSWERED), worth


class Step(NamedTuple):
    """One step of an order: units of a wire (0 the controller's), and the place behind them."""

    wire: int
    units: Sequence[Unit]
    place: Place


Bare = dict[tuple[int, int], tuple[int, int]]
"""By requests passed and unit of the servos' wire: the unit behind a bare answer, and its worth."""


def by_time(asked: Sequence[Unit], heard: Sequence[Unit], place: Place) -> list[Step]:
    """Order by latest moments alone, the controller's wire first on ties."""
    out: list[Step] = []
    i = j = 0
    while i < len(asked) or j < len(heard):
        a = asked[i] if i < len(asked) else None
        b = heard[j] if j < len(heard) else None
        costs = _cost(a, b, tie=True), _cost(b, a, tie=False)
        wire = int(costs[1] < costs[0])
        unit = heard[j] if wire else asked[i]
        i, j = i + 1 - wire, j + wire
        place = place.behind_heard(unit)[0] if wire else place.behind_asked(unit)
        out.append(Step(wire, (unit,), place))
    return out


State = tuple[int, int, int]
"""Units passed on each wire, and what stands since the last request."""


def by_cause(
    asked: Sequence[Unit], heard: Sequence[Unit], place: Place, known_ns: int, bare: Bare
) -> list[Step]:
    """Order by cause and effect where the stamps allow it.

    Args:
        asked: the units of the controller's wire.
        heard: those of the servos' wire.
        place: what stands before them.
        known_ns: everything that came earlier is among them.
        bare: which units may be answers without a header.
    """
    n, m = len(asked), len(heard)
    # The last request follows from how many of the controller's units were passed.
    asks, missed = [place.ask], [MISSED if place.ask and place.ask.must else 0]
    for unit in asked:
        said = unit.said if unit.framed else asks[-1]
        due = unit.framed and said is not None and said.must and unit.last_ns <= known_ns
        missed.append(MISSED * due if unit.framed else missed[-1])
        asks.append(said)
    begin = 0, 0, place.since
    came: dict[State, tuple[float, State | None]] = {begin: (0.0, None)}
    waiting: list[list[State]] = [[] for _ in range(n + m + 1)]
    waiting[0].append(begin)

    def offer(state: State, score: float, before: State) -> None:
        known = came.get(state)
        if known is None:
            waiting[state[0] + state[1]].append(state)
        if known is None or score > known[0]:
            came[state] = score, before

    for state in itertools.chain.from_iterable(waiting):
        i, j, since = state
        score, here = came[state][0], Place(asks[i], since)
        a = asked[i] if i < n else None
        b = heard[j] if j < m else None
        if a is not None and (cost := _cost(a, b, tie=True)) < NEVER:
            if a.framed:
                cost += missed[i] * OPEN[since]
            offer((i + 1, j, here.behind_asked(a).since), score - cost, state)
        if b is None:
            continue
        behind, worth = here.behind_heard(b)
        answers = [(j + 1, behind.since, worth)]
        if since == DIRECT and (i, j) in bare:
            stop, worth = bare[i, j]
            answers.append((stop, ANSWERED, worth))
        for stop, after, worth in answers:
            if (cost := _cost(heard[stop - 1], a, b, tie=False)) < NEVER:
                if after == ANSWERED and not worth:
                    cost += missed[i] * OPEN[since]
                if not worth and b.last_ns <= known_ns and b.end > b.start:
                    cost += UNASKED
                offer((i, stop, after), score + worth - cost, state)

    ends = (s for s in came if s[:2] == (n, m))
    path: list[State] = [max(ends, key=lambda s: came[s][0] - missed[n] * OPEN[s[2]])]
    while (before := came[path[-1]][1]) is not None:
        path.append(before)
    path.reverse()
    return [
        Step(int(q[1] > p[1]), heard[p[1] : q[1]] or asked[p[0] : q[0]], Place(asks[q[0]], q[2]))
        for p, q in itertools.pairwise(path)
    ]


def _cost(unit: Unit | None, other: Unit | None, first: Unit | None = None, *, tie: bool) -> float:
    """Return what it costs to put a unit (from ``first`` on) before the other wire's next one.

    It costs nothing where it ends first by its latest moment (or, with ``tie``, with the other).
    Where by the stamps neither can have ended before the other began, that order is kept.
    """
    if unit is None:
        return NEVER
    if other is None:
        return 0.0
    moved = unit.last_ns - other.last_ns
    if unit.soonest_ns <= other.first_ns:
        return max(moved, 0) / max(unit.last_ns - unit.soonest_ns, 1)
    by_time = moved < 0 or (tie and not moved)
    return 0.0 if by_time and other.soonest_ns > (first or unit).first_ns else NEVER


class BareAnswers:
    """Finds answers without a header, by framing bytes together with the request before them."""

    def __init__(self) -> None:
        self._known: dict[tuple[bytes, bytes], tuple[int, int]] = {}

    def find(
        self, protocol: BusProtocol, pairs: Sequence[tuple[bytes, bytes]]
    ) -> list[tuple[int, int]]:
        """Return for each request with the bytes behind it: length and worth of an answer."""
        if len(self._known) > REMEMBERED:
            self._known.clear()
        new = [pair for pair in dict.fromkeys(pairs) if pair not in self._known]
        if new:
            self._known.update(_tried(protocol, new))
        return [self._known[pair] for pair in pairs]


def _tried(
    protocol: BusProtocol, pairs: Sequence[tuple[bytes, bytes]]
) -> Iterator[tuple[tuple[bytes, bytes], tuple[int, int]]]:
    """Frame all pairs in one block, with a silence behind each."""
    ends = np.cumsum([len(a) + len(b) for a, b in pairs])
    data = np.frombuffer(b"".join(itertools.chain.from_iterable(pairs)), np.uint8)
    block = Block(data, ends[:-1], True)
    spans, _ = protocol.frame(block)
    flags = protocol.describe(block, spans).flags
    rows: Mapping[int, int] = {at: row for row, at in enumerate(spans.start.tolist())}
    for pair, end in zip(pairs, ends.tolist(), strict=True):
        at = end - len(pair[1])
        row = rows.get(at, 0)
        told = 0, 0
        # The request must stand whole in front of it: only then is it an answer to that one.
        whole = row > 0 and spans.start[row - 1] == at - len(pair[0])
        if whole and spans.kind[row] == RESPONSE and spans.end[row - 1] == at:
            worth = NEARLY if flags[row] & ECHO_DIFFERS else FITS
            told = int(spans.end[row] - at), worth
        yield pair, told
