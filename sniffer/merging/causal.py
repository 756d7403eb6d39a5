"""In what order did the pieces of two wires come? Of all orders that the stamps allow, the best.

A piece may stand before another if it can have ended before that one began: the soonest moment of
its end against the latest moment of the other's beginning. What an order is worth:

- an answer that fits the request before it counts most, one that fits an earlier request which is
  still open an eighth less (as in ``pending``, by what both carry), one of the
  right servo half as much, bytes no frame claims right behind a request a quarter: it may be the
  answer, damaged;
- where all has come that could explain it, an answer to nothing costs as much as one that fits is
  worth, a request without the answer it must have a quarter;
- an adapter whose reads lie closer together than the latency stated holds bytes no longer than
  that, so its stamps tell more. A busy host may make it look so: therefore they forbid nothing, but
  an answer that begins in time only by the latency stated is worth five sixteenths less. That is
  more than a request missed, else the next request's answer would make up for one that is missing,
  and all that follow be shifted by one.

Among orders of the same worth it is the one that moves pieces least, requests first on ties.
"""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.ground.model import DEPTH, NEVER_NS
from sniffer.merging.lanes import ALWAYS, FITS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.merging.lanes import Said, Span, Unit

IN_TURN: Final = FITS * 7 // 8
DAMAGED: Final = FITS // 4
UNASKED: Final = FITS
MISSED: Final = FITS // 4
UNLIKELY: Final = FITS * 5 // 16

NEVER: Final = math.inf
"""The cost of what the stamps forbid."""

BARE: Final = 8
"""Bytes that are looked at for an answer without a header."""

TRIALS: Final = 800
"""The most bytes that one pass tries as such answers, else pieces stay by their time."""

CELLS: Final = 640
"""Pairs of places on both wires that one pass weighs, else pieces stay by their time."""

BURST: Final = 16
"""How many times as much of either is weighed where the tap came late: rare, and all at once."""

DIRECT, BEHIND, ANSWERED = range(3)
"""What stands since the last request: nothing, bytes no frame claims, an answer."""

OPEN: Final = (1.0, 0.75, 0.0)
"""How much a request is still open then: the bytes may have been its answer."""


class Asked(NamedTuple):
    """A request that is open; from offset ``until`` of the merged bytes on it is closed."""

    said: Said
    until: int
    awaited: Span


class Rules(NamedTuple):
    """How long requests of a protocol are open; ``ordered``: answers name nobody, one at a time."""

    reach: int
    tail_ns: int
    ordered: bool


class Spot(NamedTuple):
    """What the last request was, if it has an answer, what stands since, and who is still asked.

    ``awaited``: when an answer to the last request is likely to begin.
    """

    ask: Said | None = None
    since: int = ANSWERED
    pending: tuple[Asked, ...] = ()
    awaited: Span = ALWAYS

    def behind_asked(self, unit: Unit, at: int, rules: Rules) -> Spot:
        """Return the place behind a unit of the controller's wire, which begins at ``at``."""
        if not unit.framed:
            if unit.end == unit.start or self.since >= BEHIND:
                return self
            return Spot(self.ask, BEHIND, self.pending, self.awaited)
        pending = self.pending
        if unit.said and not rules.ordered:
            until = at + unit.end - unit.start + max(rules.reach, 0)
            pending = (*pending[1 - DEPTH :], Asked(unit.said, until, unit.awaited))
        return Spot(unit.said, DIRECT, pending, unit.awaited)

    def behind_heard(self, unit: Unit, at: int) -> tuple[Spot, int]:
        """Return the place behind a unit of the servos' wire, and what it is worth as an answer."""
        if unit.end == unit.start:
            return self, 0
        if not unit.framed:
            worth = DAMAGED if self.ask and self.since == DIRECT else 0
            return Spot(self.ask, max(self.since, BEHIND), self.pending, self.awaited), worth
        # Servos 1 and 2 are asked in one go, and both answer, the second twice:
        #
        #     unit      Q1      Q2      A1            A2            A2
        #     ask       1       2       2             2             2
        #     since     DIRECT  DIRECT  ANSWERED      ANSWERED      ANSWERED
        #     pending   1       1 2     2             -             -
        #     worth                     IN_TURN       IN_TURN       0
        #
        # An answer is the last request's if that can be; else that of the youngest open one which
        # it fits. What stays open is what the next one may answer: a second A2 finds nothing and
        # costs UNASKED.
        worth, awaited, pending = 0, ALWAYS, self.pending
        if self.ask and unit.said and (self.ask.many or self.since != ANSWERED):
            worth, awaited = self.ask.worth(unit.said), self.awaited
        if worth == FITS and pending and pending[-1].said is self.ask and not self.ask.many:
            pending = pending[:-1]
        elif worth < FITS and unit.said:
            for k in reversed(range(len(pending))):  # an answer to a retry is the retry's
                asked = pending[k]
                if at <= asked.until and asked.said.worth(unit.said) == FITS:
                    worth, awaited = IN_TURN, asked.awaited
                    pending = pending if asked.said.many else pending[:k] + pending[k + 1 :]
                    break
        if worth:
            worth -= UNLIKELY * unit.is_unlikely(awaited)
        return Spot(self.ask, ANSWERED, pending, self.awaited), worth

    def carried(self, passed: int) -> Spot:
        """Return the same where a new pass begins, with so many bytes handed on."""
        still = (a._replace(until=a.until - passed) for a in self.pending if a.until >= passed)
        return self._replace(pending=tuple(still))


class Step(NamedTuple):
    """One step of an order: units of a wire (0 the controller's), and the place behind them."""

    wire: int
    units: Sequence[Unit]
    place: Spot


Bare = dict[tuple[int, int], tuple[int, int]]
"""By requests passed and unit of the servos' wire: the unit behind a bare answer, and its worth."""


def by_time(
    asked: Sequence[Unit], heard: Sequence[Unit], place: Spot, rules: Rules
) -> tuple[list[Step], bool]:
    """Order by latest moments alone, the controller's wire first on ties.

    Also tell whether no order by cause can be better: every answer fits the request right before
    it, and stands where its adapter is likely to have passed it on; every request but the last has
    the answer it must have. Each answer is worth most then, what is missing at the end is missing
    in any order, and nothing is moved.
    """
    out: list[Step] = []
    i = j = at = 0
    is_best = True
    while i < len(asked) or j < len(heard):
        a = asked[i] if i < len(asked) else None
        b = heard[j] if j < len(heard) else None
        costs = _cost(a, b, tie=True), _cost(b, a, tie=False)
        wire = int(costs[1] < costs[0])
        unit = heard[j] if wire else asked[i]
        i, j = i + 1 - wire, j + wire
        since, must = place.since, place.ask is not None and place.ask.must
        if wire:
            place, worth = place.behind_heard(unit, at)
            fits = since == DIRECT and worth == FITS
        else:
            place = place.behind_asked(unit, at, rules)
            fits = not must or since == ANSWERED
        is_best = is_best and (unit.end == unit.start or (unit.framed and fits))
        at += unit.end - unit.start
        out.append(Step(wire, (unit,), place))
    return out, is_best


State = tuple[int, int, int]
"""Units passed on each wire, and what stands since the last request."""


def by_cause(
    asked: Sequence[Unit],
    heard: Sequence[Unit],
    place: Spot,
    known_ns: int,
    bare: Bare,
    rules: Rules,
) -> list[Step]:
    """Order by cause and effect where the stamps allow it.

    Args:
        asked: the units of the controller's wire.
        heard: those of the servos' wire.
        place: what stands before them.
        known_ns: everything that came earlier is among them.
        bare: which units may be answers without a header.
        rules: how long requests are open.
    """
    # Two reads and their answers, each 0.9 ms long, adapters that hold for 4 ms. By its stamp the
    # first answer ends (9.5 ms) before its request does (10.0):
    #
    #     asked   Q1 ends 6.8 to 10.0    Q2 ends 9.3 to 12.5
    #     heard   A1 ends 6.3 to 9.5     A2 ends 9.8 to 13.0
    #
    # An order is a way through a grid: i of the one, j of the other, and what stands since the last
    # request (D nothing, A an answer). FITS is 4,000,000, and so is UNASKED:
    #
    #     state    way           score
    #     0 0 A                  0
    #     1 0 D    Q1            -0.16          Q1 is moved before A1, by 0.5 ms of 3.2
    #     0 1 A    A1            -4000000       an answer to nothing
    #     1 1 A    Q1 A1         3999999.84
    #     1 1 D    A1 Q1         -4000000
    #     2 1 D    Q1 A1 Q2      3999999.84
    #     1 2 A    Q1 A1 A2      -0.31
    #     2 2 A    Q1 A1 Q2 A2   7999999.84     the best
    #     2 2 D    Q1 A1 A2 Q2   -0.31
    #
    # Every step adds to i + j, so states are visited by that sum and each is final when its turn
    # comes: some 3 * n * m states instead of all orders, of which there are as many as ways through
    # the grid. Who is still open (``pending``) is not part of the state, else there would be no end
    # of them: of two ways to one state only the better one's is known from there on.
    n, m = len(asked), len(heard)
    # The last request follows from how many of the controller's units were passed.
    asks, missed = [place.ask], [MISSED if place.ask and place.ask.must else 0]
    awaited = [place.awaited]
    for unit in asked:
        said = unit.said if unit.framed else asks[-1]
        due = unit.framed and said is not None and said.must and unit.last_ns <= known_ns
        missed.append(MISSED * due if unit.framed else missed[-1])
        asks.append(said)
        awaited.append(unit.awaited if unit.framed else awaited[-1])
    begin = 0, 0, place.since
    # Who is still asked goes along with the best way to a state.
    came: dict[State, tuple[float, State | None, tuple[Asked, ...]]]
    came = {begin: (0.0, None, place.pending)}
    waiting: list[list[State]] = [[] for _ in range(n + m + 1)]
    waiting[0].append(begin)

    def offer(state: State, score: float, before: State, pending: tuple[Asked, ...]) -> None:
        known = came.get(state)
        if known is None:
            waiting[state[0] + state[1]].append(state)
        if known is None or score > known[0]:
            came[state] = score, before, pending

    for state in itertools.chain.from_iterable(waiting):
        i, j, since = state
        score, _, pending = came[state]
        a = asked[i] if i < n else None
        b = heard[j] if j < m else None
        at = (asked[i - 1].end if i else 0) + (heard[j - 1].end if j else 0)
        if pending and (i or j):
            until = max(u[k - 1].last_ns for u, k in ((asked, i), (heard, j)) if k) + rules.tail_ns
        else:
            until = NEVER_NS
        if a is not None and (cost := _cost(a, b, tie=True)) < NEVER:
            if a.framed:
                cost += missed[i] * OPEN[since]
            still = pending if not pending or a.begun_ns <= until else ()
            behind = Spot(asks[i], since, still).behind_asked(a, at, rules)
            offer((i + 1, j, behind.since), score - cost, state, behind.pending)
        if b is None:
            continue
        still = pending if not pending or b.begun_ns <= until else ()
        if (cost := _cost(b, a, tie=False)) < NEVER:
            behind, worth = Spot(asks[i], since, still, awaited[i]).behind_heard(b, at)
            if behind.since == ANSWERED and not worth:
                cost += missed[i] * OPEN[since]
            if not worth and b.last_ns <= known_ns and b.end > b.start:
                cost += UNASKED
            offer((i, j + 1, behind.since), score + worth - cost, state, behind.pending)
        # An answer without a header takes several units of the servos' wire in one step.
        if since == DIRECT and (i, j) in bare:
            stop, worth = bare[i, j]
            if (cost := _cost(heard[stop - 1], a, b, tie=False)) < NEVER:
                worth -= UNLIKELY * b.is_unlikely(awaited[i])
                offer((i, stop, ANSWERED), score + worth - cost, state, still)

    ends = (s for s in came if s[:2] == (n, m))
    path: list[State] = [max(ends, key=lambda s: came[s][0] - missed[n] * OPEN[s[2]])]
    while (before := came[path[-1]][1]) is not None:
        path.append(before)
    path.reverse()
    return [
        Step(
            int(q[1] > p[1]),
            heard[p[1] : q[1]] or asked[p[0] : q[0]],
            Spot(asks[q[0]], q[2], came[q][2], awaited[q[0]]),
        )
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
    # 0 where it ends first anyway; else how far it is moved, as a share of what its stamp leaves
    # open: Q1 before A1 is 10.0 - 9.5 of 10.0 - 6.8. So a move costs 1 at most, and no number of
    # moves that a pass can hold (``CELLS``) weighs as much as one answer more or less.
    moved = unit.last_ns - other.last_ns
    if unit.soonest_ns <= other.first_ns:
        return max(moved, 0) / max(unit.last_ns - unit.soonest_ns, 1)
    by_time = moved < 0 or (tie and not moved)
    return 0.0 if by_time and other.soonest_ns > (first or unit).first_ns else NEVER
