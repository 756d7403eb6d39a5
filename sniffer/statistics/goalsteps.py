"""How servos take a new goal: how long until they stay there, how far beyond they go.

A position is known only when it is asked for. So a settle time lies between the last position
outside the band and the first of those inside that stay there; an overshoot is at least what was
seen.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.decoding.durations import Quantiles
from sniffer.ground.milli import in_milli
from sniffer.ground.register import unseen_scale
from sniffer.statistics.figures import POSITION, Extreme
from sniffer.statistics.lags import LONGEST_NS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.ground.model import F64, I64, Mask
    from sniffer.ground.register import Register
    from sniffer.statistics.following import Course

BAND: Final = 0.05
"""A step has settled within this share of its travel: 5 %, one of the two usual bands (the other
one, 2 %, is below the dead band of small servos)."""

STEADY: Final = 2
"""Positions in the band, to the end of the step, that show that it stays there."""

RESOLUTION: Final = 4
"""A band is no narrower than so many counts of the position, a travel no shorter than two bands:
what is less cannot be told from noise."""

HELD_NS: Final = LONGEST_NS
"""A goal that holds so long, and is seen not to be reached then, is missed: of a trajectory nobody
expects that each is reached, nor that a joint is there as soon as it is told to go."""

LISTED: Final = 100
"""Goals of one servo that were not reached, of which each is told; of all how many they are."""

ENDS: Final = {"overtaken": "next_goal", "let_go": "let_go", "under_way": "capture_end"}
"""What ended a goal that was not reached, by its fate."""


class Unreached(NamedTuple):
    """A goal that was not reached: ``HELD_NS`` behind it and later, what was seen last was not it.

    ``start`` is the position when it was given, ``left`` the last one under it; ``stands``: the
    one before was the same. ``held_ns`` is until what ``ended`` it, at the end of a capture until
    the last position.
    """

    goal: Extreme
    start: float
    left: Extreme
    stands: bool
    held_ns: int
    ended: str


@dataclass(slots=True)
class StepFigures:
    """Steps of one servo in one unit.

    ``overshoot`` is in thousandths of a percent of the travel; ``worst`` in percent, where it was
    seen. ``unreached`` are the first ``LISTED`` of all such goals.
    """

    fates: Counter[str] = field(default_factory=Counter)
    """What became of the steps: ``settled``; ``overtaken`` by the next goal before; ``unseen``, no
    position was stated before the next goal; ``let_go`` by a command; ``under_way`` at the end."""
    settle: Quantiles = field(default_factory=Quantiles)
    overshoot: Quantiles = field(default_factory=Quantiles)
    worst: Extreme | None = None
    unreached: list[Unreached] = field(default_factory=list)
    unreached_count: int = 0

    @property
    def steps(self) -> int:
        """How many there were."""
        return sum(self.fates.values())

    def miss(self, goal: Unreached) -> None:
        """Take a goal that was not reached."""
        self.unreached_count += 1
        if len(self.unreached) < LISTED:
            self.unreached.append(goal)

    def copy(self) -> StepFigures:
        """Return the same figures, to which others can be added."""
        quantiles = self.settle.copy(), self.overshoot.copy()
        told = [*self.unreached], self.unreached_count
        return StepFigures(Counter(self.fates), *quantiles, self.worst, *told)


_NOWHERE: Final = Extreme(0.0, 0, 0)


@dataclass(frozen=True, slots=True)
class _Step:
    """A goal that is being sought: ``inside`` positions in the band since ``in_ns``.

    ``out_ns`` is the last moment outside, ``beyond`` how far it went past the goal, and where;
    ``left`` is the last position, ``moves`` how far it is from the one before.
    """

    goal: float
    travel: float
    band: float
    t_ns: int
    spread: int
    at: int
    out_ns: int
    in_ns: int = 0
    inside: int = 0
    seen: int = 0
    beyond: Extreme = _NOWHERE
    left: Extreme = _NOWHERE
    moves: float = np.inf

    def unreached(self, least: float, held_ns: int, fate: str) -> Unreached | None:
        """Return what is told of it if it was seen not to be reached; ``least`` is no motion."""
        is_late = self.left.t_ns - self.t_ns >= HELD_NS
        if self.spread < 0 or self.inside or not self.seen or not is_late:
            return None
        goal = Extreme(self.goal, self.t_ns, self.at)
        stands = self.moves <= least
        return Unreached(goal, self.goal - self.travel, self.left, stands, held_ns, ENDS[fate])


def counts_of(registers: Sequence[Register]) -> dict[str, float]:
    """Return how much a count of a position is, by the unit."""
    scales: dict[str, float] = {}
    for r in registers:
        if r.quantity == POSITION:
            scales[r.unit] = max(abs(unseen_scale(r)), scales.get(r.unit, 0.0))
    return scales


class GoalSteps:
    """Follows the steps of all servos of one protocol."""

    def __init__(self, registers: Sequence[Register]) -> None:
        self._count = counts_of(registers)
        self._figures: dict[tuple[int, str], StepFigures] = {}
        self._open: dict[tuple[int, str], _Step] = {}
        self._last: dict[tuple[int, str], float] = {}

    def add(self, course: Course) -> None:
        """Take the positions and goals of one servo."""
        key = course.servo_id, course.unit
        changes = course.changes
        measured = np.flatnonzero(course.measured)
        if not len(changes):
            self._go_on(key, course, measured)
            return
        first, last = np.searchsorted(measured, changes[[0, -1]]).tolist()
        self._go_on(key, course, measured[:first])
        before = self._last.get(key, np.nan)
        self._begin(key, course, int(changes[0]))
        if len(changes) > 1:
            self._between(key, course, changes, measured[first:last], before)
            self._open.pop(key, None)  # it is the first of those between
            if last > first:
                self._last[key] = float(course.position[measured[last - 1]])
            self._begin(key, course, int(changes[-1]))
        self._go_on(key, course, measured[last:])

    def _go_on(self, key: tuple[int, str], course: Course, rows: I64) -> None:
        """Take positions under one goal."""
        if len(rows):
            if key in self._open:
                self._open[key] = _further(self._open[key], course, rows)
            self._last[key] = float(course.position[rows[-1]])

    def _between(
        self, key: tuple[int, str], course: Course, changes: I64, rows: I64, last: float
    ) -> None:
        """Count the steps that begin and end here, all at once: a trajectory has thousands.

        ``rows`` are the positions from the first change to the last one, ``last`` the one before.
        """
        begins, goal = changes[:-1], course.goal[changes[:-1]]
        edges = np.searchsorted(rows, changes)
        position = course.position[rows]
        before: F64 = np.full(len(begins), last)
        if len(rows):
            before = np.where(edges[:-1] > 0, position[edges[:-1] - 1], last)
        travel = goal - before
        least = self._least(key)
        real = np.flatnonzero((np.abs(travel) > 2 * least) & course.shown[begins])
        if not len(real):
            return
        let_go = np.isnan(course.goal[changes[1:]])[real]
        seen = np.diff(edges)[real]
        mine = self._figures.setdefault(key, StepFigures())
        mine.fates["let_go"] += int(let_go[seen == 0].sum())
        mine.fates["unseen"] += int((~let_go[seen == 0]).sum())
        real, let_go = real[seen > 0], let_go[seen > 0]
        if not len(real):
            return
        first, behind = edges[real], edges[real + 1]
        size = behind - first
        # the positions of those steps one after another, and whose each is
        whose = np.repeat(np.arange(len(real)), size)
        place = np.arange(len(whose)) - np.repeat(np.cumsum(size) - size - first, size)
        off = position[place] - goal[real][whose]
        past = np.maximum(off * np.sign(travel[real])[whose], 0.0)
        band = np.maximum(BAND * np.abs(travel[real]), least)
        outside = np.where(np.abs(off) > band[whose], place, -1)
        starts = np.cumsum(size) - size
        out = np.maximum.reduceat(outside, starts)
        since = np.maximum(out + 1, first)
        settled = behind - since >= STEADY
        mine.fates["settled"] += int(settled.sum())
        mine.fates["let_go"] += int((let_go & ~settled).sum())
        mine.fates["overtaken"] += int((~let_go & ~settled).sum())
        t_ns = course.t_ns
        held = t_ns[changes[real + 1]] - t_ns[begins[real]]
        looked = t_ns[rows[behind - 1]] - t_ns[begins[real]]
        for k in np.flatnonzero((out == behind - 1) & (looked >= HELD_NS)).tolist():
            if course.spread[begins[real[k]]] >= 0:
                row, at = rows[behind[k] - 1], begins[real[k]]
                mine.miss(
                    Unreached(
                        Extreme(float(goal[real[k]]), int(t_ns[at]), int(course.at[at])),
                        float(before[real[k]]),
                        Extreme(float(course.position[row]), int(t_ns[row]), int(course.at[row])),
                        bool(size[k] >= STEADY and _moves(position[first[k] : behind[k]]) <= least),
                        int(held[k]),
                        ENDS["let_go" if let_go[k] else "overtaken"],
                    )
                )
        if not settled.any():
            return
        spread = np.maximum(course.spread, 0)
        began = begins[real[settled]]
        was = rows[np.maximum(out[settled], 0)]
        low = np.where(out[settled] >= 0, t_ns[was] - spread[was] - t_ns[began], 0)
        low = np.maximum(low, 0)
        high = t_ns[rows[since[settled]]] - t_ns[began] + spread[began]
        _add_between(mine, low, high, course.spread[began] >= 0)
        percent = 100 * np.maximum.reduceat(past, starts) / np.abs(travel[real])
        mine.overshoot.add(in_milli(percent[settled]), np.zeros(int(settled.sum()), np.int64))
        worst = int(np.where(settled, percent, -1.0).argmax())
        if percent[worst] > (mine.worst.value if mine.worst is not None else 0.0):
            of = slice(int(starts[worst]), int(starts[worst] + size[worst]))
            row = rows[place[of][int(past[of].argmax())]]
            mine.worst = Extreme(float(percent[worst]), int(t_ns[row]), int(course.at[row]))

    def _begin(self, key: tuple[int, str], course: Course, row: int) -> None:
        """End the step that was, begin the one to a new goal."""
        goal, t_ns = float(course.goal[row]), int(course.t_ns[row])
        before = self._open.pop(key, None)
        if before is not None:
            self._end(key, before, "let_go" if np.isnan(goal) else "overtaken", t_ns)
        travel = goal - self._last.get(key, np.nan)
        least = self._least(key)
        if course.shown[row] and abs(travel) > 2 * least:  # also false where either is not known
            band = max(BAND * abs(travel), least)
            place = int(course.spread[row]), int(course.at[row])
            self._open[key] = _Step(goal, travel, band, t_ns, *place, t_ns)

    def _end(self, key: tuple[int, str], step: _Step, otherwise: str, t_ns: int) -> None:
        mine = self._figures.setdefault(key, StepFigures())
        _count(mine, step, otherwise, self._least(key), t_ns - step.t_ns)

    def _least(self, key: tuple[int, str]) -> float:
        """Return what cannot be told from noise, in the unit of a servo's positions."""
        return RESOLUTION * self._count.get(key[1], 0.0)

    def figures(self) -> Mapping[tuple[int, str], StepFigures]:
        """Return the figures by servo and unit, those that are under way counted in."""
        out = {key: replace(mine, fates=+mine.fates) for key, mine in self._figures.items()}
        for key, step in self._open.items():
            out[key] = out.get(key, StepFigures()).copy()
            held_ns = step.left.t_ns - step.t_ns
            _count(out[key], step, "under_way", self._least(key), held_ns)
        return out


def _moves(position: F64) -> float:
    """Return how far the last positions that show whether a joint stays are apart."""
    return float(np.ptp(position[-STEADY:]))


def _further(step: _Step, course: Course, rows: I64) -> _Step:
    """Return a step with more positions."""
    position: F64 = course.position[rows]
    off = position - step.goal
    t_ns = course.t_ns[rows]
    past = off * np.sign(step.travel)
    far = int(past.argmax())
    if past[far] > step.beyond.value:
        end = Extreme(float(past[far]), int(t_ns[far]), int(course.at[rows[far]]))
        step = replace(step, beyond=end)
    outside = np.flatnonzero(np.abs(off) > step.band)
    left = Extreme(float(position[-1]), int(t_ns[-1]), int(course.at[rows[-1]]))
    near = np.append(step.left.value, position)[-STEADY:] if step.seen else position
    step = replace(step, left=left, moves=_moves(near) if len(near) >= STEADY else np.inf)
    out_ns, in_ns, inside, first = step.out_ns, step.in_ns, step.inside, 0
    if len(outside):
        first = int(outside[-1]) + 1
        # the stamp is the latest moment
        out_ns = int(t_ns[outside[-1]]) - max(int(course.spread[rows[outside[-1]]]), 0)
        inside = 0
    if first < len(rows):
        in_ns = in_ns if inside else int(t_ns[first])
        inside += len(rows) - first
    return replace(step, out_ns=out_ns, in_ns=in_ns, inside=inside, seen=step.seen + len(rows))


def _count(mine: StepFigures, step: _Step, otherwise: str, least: float, held_ns: int) -> None:
    """Count a step that is over; ``otherwise`` says what became of it if it did not settle."""
    if step.inside < STEADY:
        mine.fates[otherwise if step.seen or otherwise != "overtaken" else "unseen"] += 1
        missed = step.unreached(least, held_ns, otherwise)
        if missed is not None:
            mine.miss(missed)
        return
    mine.fates["settled"] += 1
    low = np.array([max(step.out_ns - step.t_ns, 0)])
    high = np.array([step.in_ns - step.t_ns + step.spread])
    _add_between(mine, low, high, np.array([step.spread >= 0]))
    percent = 100 * step.beyond.value / abs(step.travel)
    mine.overshoot.add(in_milli(np.array([percent])), np.zeros(1, np.int64))
    if percent > (mine.worst.value if mine.worst is not None else 0.0):
        mine.worst = Extreme(percent, step.beyond.t_ns, step.beyond.offset)


def _add_between(mine: StepFigures, low: I64, high: I64, known: Mask) -> None:
    """Count settle times that lie between bounds, where there is a clock."""
    low, high = low[known], np.maximum(high, low)[known]
    middle = (low + high) // 2
    mine.settle.add(middle, high - middle)
