"""In what order did the pieces of two wires come? Of all orders that the stamps allow, the best.

A piece may stand before another if it can have ended before that one began: the soonest moment of
its end against the latest moment of the other's beginning. What an order is worth:

- an answer that fits the request before it counts most, one of the right servo half as much, bytes
  no frame claims right behind a request a quarter: it may be the answer, damaged;
- half of that is lost if the answer must then have taken longer than the protocol allows;
- where all has come that could explain it, an answer to nothing costs as much as one that fits is
  worth, a request without the answer it must have a quarter.

Among orders of the same worth it is the one that moves pieces least, requests first on ties.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.framing import Block
from sniffer.model import ANY_ID, ECHO_DIFFERS, NO_ALT, RESPONSE

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from sniffer.protocols.base import BusProtocol

FITS: Final = 4_000_000
"""Worth of an answer that fits; to move one piece costs 1 at most. See above for the others."""

NEARLY: Final = FITS // 2
DAMAGED: Final = FITS // 4
import os
W=float(os.environ.get('W','0'))*FITS or 1.0
LATE=int(float(os.environ.get('LATE','0.5'))*FITS)
UNASKED: Final = FITS
MISSED = int(float(os.environ.get('MISSED','0.25'))*FITS)

BARE: Final = 8
"""Bytes that are looked at for an answer without a header."""

TRIALS: Final = 1024
"""The most bytes that one pass tries as such answers, else pieces stay by their time."""

REMEMBERED: Final = 4096
"""Trials whose result is kept: passes overlap, and short answers are soon all known."""

CELLS: Final = 4000
"""Pairs of places on both wires that one pass weighs, else pieces stay by their time."""

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
    closes_ns: int
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
        fresh = self.ask and unit.said and (self.ask.many or self.since != ANSWERED)
        worth = self.ask.worth(unit.said) if fresh and self.ask and unit.said else 0
        return Place(self.ask, ANSWERED), worth

    def judge(self, worth: int, first: Unit, last: Unit, known_ns: int) -> int:
        """Return what an answer is worth, given when it came."""
        began_ns = last.soonest_ns - (last.last_ns - first.first_ns)
        if worth >= NEARLY and self.ask and began_ns > self.ask.closes_ns:
            return worth - LATE
        if not worth and last.last_ns <= known_ns and last.end > first.start:
            return -UNASKED
        return worth


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
        wire = int(i == len(asked) or (j < len(heard) and heard[j].last_ns < asked[i].last_ns))
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
        if a is not None and (cost := _cost(a, b, tie=True)) is not None:
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
            last = heard[stop - 1]
            if (cost := _cost(last, a, tie=False)) is not None:
                if after == ANSWERED and not worth:
                    cost += missed[i] * OPEN[since]
                gain = here.judge(worth, b, last, known_ns)
                offer((i, stop, after), score + gain - cost, state)

    ends = (s for s in came if s[:2] == (n, m))
    path: list[State] = [max(ends, key=lambda s: came[s][0] - missed[n] * OPEN[s[2]])]
    while (before := came[path[-1]][1]) is not None:
        path.append(before)
    path.reverse()
    return [
        Step(int(q[1] > p[1]), heard[p[1] : q[1]] or asked[p[0] : q[0]], Place(asks[q[0]], q[2]))
        for p, q in itertools.pairwise(path)
    ]


def _cost(unit: Unit, other: Unit | None, *, tie: bool) -> float | None:
    """Return what it costs to put a unit before the other wire's next one; None: it cannot be.

    It costs nothing where it ends first by its latest moment (or, with ``tie``, with the other).
    """
    if other is None:
        return 0.0
    moved = unit.last_ns - other.last_ns
    if moved < 0 or (tie and not moved):
        return 0.0
    if unit.soonest_ns > other.first_ns:
        return None
    return W*moved / max(unit.last_ns - unit.soonest_ns, 1)


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
