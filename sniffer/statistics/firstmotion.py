"""How soon joints begin to move: from a goal that came while they stood still to the first motion.

A joint that is moving already begins nothing, so goals of a trajectory do not count but the first
one that asks for a motion. Three positions and two goals (t ms, mm; a count is 0.01):

    positions   0: 5.00   100: 5.00   200: 5.00           260: 5.01   320: 5.30
    goals                                        250: 8.00       300: 8.20

It stood for ``REST_NS``, was told at 250 to be elsewhere, was still there at 260 and away at 320:
it began 10 to 70 ms after the goal. What no position shows is no motion: both bounds are stamps.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.decoding.durations import Bounds, Quantiles
from sniffer.ground.model import MS
from sniffer.statistics.goalsteps import RESOLUTION, STEADY, counts_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from sniffer.ground.model import F64, I64, Mask
    from sniffer.ground.register import Register
    from sniffer.statistics.following import Course

REST_NS: Final = 200 * MS
"""So long a joint must have been where it is, and asked for nothing else, before it is told to go:
longer than a servo takes for a step of a trajectory, shorter than a pause that one can see."""

STRIDE: Final = 64
"""Rows that are looked at at once, at first: most of what is looked for is near."""


@dataclass(frozen=True, slots=True)
class SlowestStart:
    """The motion that began latest for sure: how long it took, when it was told to, and where."""

    bounds: Bounds
    t_ns: int
    offset: int


@dataclass(slots=True)
class StartFigures:
    """Goals from rest of one servo in one unit: how many, and how long until it moved.

    Of ``told`` goals ``moved`` were followed by a motion; ``recalled`` ended before one was seen:
    the goal came back to the joint, turned to its other side, or was let go.
    """

    told: int = 0
    moved: int = 0
    recalled: int = 0
    times: Quantiles = field(default_factory=Quantiles)
    slowest: SlowestStart | None = None


@dataclass(frozen=True, slots=True)
class _Wait:
    """A joint at ``rest`` that was told to go; ``still_ns``: it was there at least until then."""

    rest: float
    sign: float
    t_ns: int
    spread: int
    at: int
    still_ns: int


class _Joint:
    """One servo: what of its past decides whether it stands still, and the goal it waits with."""

    def __init__(self, least: float) -> None:
        self.figures = StartFigures()
        self._least = least
        self._wait: _Wait | None = None
        self._begun: list[Bounds] = []
        self._t: I64 = np.empty(0, np.int64)
        self._spread: I64 = np.empty(0, np.int64)
        self._position: F64 = np.empty(0)
        self._told_t: I64 = np.empty(0, np.int64)
        self._told: F64 = np.empty(0)

    def add(self, course: Course) -> list[Bounds]:
        """Take more of its goals and positions; return how long the motions took that began."""
        self._begun = []
        rows, changes = np.flatnonzero(course.measured), course.changes
        before = len(self._t) + np.searchsorted(rows, changes)
        earlier, known = len(self._told_t), len(self._t)
        self._t = np.maximum.accumulate(np.concatenate([self._t, course.t_ns[rows]]))
        self._spread = np.concatenate([self._spread, course.spread[rows]])
        self._position = np.concatenate([self._position, course.position[rows]])
        self._told_t = np.maximum.accumulate(np.concatenate([self._told_t, course.t_ns[changes]]))
        self._told = np.concatenate([self._told, course.goal[changes]])
        free = 0
        if self._wait is not None:
            free = self._go_on(self._wait, known, 0, before, earlier)
        for k in self._likely(course, changes, before, earlier).tolist():
            if self._wait is None and k >= free and self._rests(int(before[k]), earlier + k):
                rest = float(self._position[before[k] - 1])
                t_ns, row = int(self._told_t[earlier + k]), changes[k]
                sign = float(np.sign(self._told[earlier + k] - rest))
                place = int(course.spread[row]), int(course.at[row])
                self.figures.told += 1
                wait = _Wait(rest, sign, t_ns, *place, t_ns)
                free = self._go_on(wait, int(before[k]), k + 1, before, earlier)
        self._forget()
        return self._begun

    def _likely(self, course: Course, changes: I64, before: I64, earlier: int) -> I64:
        """Return the goals that ask for a motion where the one before did not, or long before."""
        if not len(changes) or not len(self._position):
            return np.empty(0, np.int64)
        goal = self._told[earlier:]
        rest = self._position[np.maximum(before - 1, 0)]
        last = np.concatenate([[course.before], goal[:-1]])
        long_ago = np.ones(len(goal), bool)
        since = np.diff(self._told_t)[max(earlier - 1, 0) :]
        long_ago[len(goal) - len(since) :] = since > REST_NS
        asked = np.abs(goal - rest) > 2 * self._least  # false where there is none
        idle = ~(np.abs(last - rest) > self._least)  # what it would be seen to do if it did it
        mine: Mask = asked & (idle | long_ago) & (before >= STEADY)
        mine &= course.shown[changes] & (course.spread[changes] >= 0)
        return np.flatnonzero(mine)

    def _rests(self, before: int, told: int) -> bool:
        """Tell whether it stood still until a goal, and no other one asked it to go."""
        since = int(self._told_t[told]) - REST_NS
        first = int(np.searchsorted(self._t[:before], since, side="right")) - 1
        if first < 0:
            return False
        there = self._position[min(first, before - STEADY) : before]
        first = int(np.searchsorted(self._told_t[:told], since, side="right"))
        asked = np.abs(self._told[first:told] - there[-1]) > self._least
        return float(np.ptp(there)) <= self._least and not asked.any()

    def _go_on(self, wait: _Wait, row: int, change: int, before: I64, earlier: int) -> int:
        """Look what becomes of a wait, from a position and a change of the goal on.

        Return from which change on others are looked for.
        """
        goal = self._told[earlier:]
        back = _first(
            lambda a, b: ~((goal[a:b] - wait.rest) * wait.sign > 2 * self._least),
            change,
            len(goal),
        )
        end = int(before[back]) if back < len(goal) else len(self._position)
        moved = _first(
            lambda a, b: (self._position[a:b] - wait.rest) * wait.sign > self._least, row, end
        )
        if moved > row:
            still = moved - 1
            until = int(self._t[still]) - max(int(self._spread[still]), 0)
            wait = replace(wait, still_ns=max(until, wait.still_ns))
        if moved < end:
            self._wait = None
            self._count(wait, int(self._t[moved]), int(self._spread[moved]))
            return int(np.searchsorted(before, moved, side="right"))
        if back < len(goal):
            self._wait = None
            self.figures.recalled += 1
            return back
        self._wait = wait
        return len(goal)

    def _count(self, wait: _Wait, t_ns: int, spread: int) -> None:
        self.figures.moved += 1
        if spread < 0:
            return
        low = max(wait.still_ns - wait.t_ns, 0)
        high = max(t_ns - wait.t_ns + wait.spread, low)
        middle = (low + high) // 2
        self.figures.times.add(np.array([middle]), np.array([high - middle]))
        bounds = Bounds(max(2 * middle - high, 0), high)  # as the quantiles have it
        self._begun.append(bounds)
        slowest = self.figures.slowest
        if slowest is None or bounds.low > slowest.bounds.low:
            self.figures.slowest = SlowestStart(bounds, wait.t_ns, wait.at)

    def _forget(self) -> None:
        """Keep what a goal that comes next looks back at."""
        ends = [int(t[-1]) for t in (self._t, self._told_t) if len(t)]
        since = max(ends, default=0) - REST_NS
        first = max(int(np.searchsorted(self._t, since, side="right")) - 1 - STEADY, 0)
        self._t, self._spread = self._t[first:], self._spread[first:]
        self._position = self._position[first:]
        first = max(int(np.searchsorted(self._told_t, since, side="right")) - 1, 0)
        self._told_t, self._told = self._told_t[first:], self._told[first:]


def _first(holds: Callable[[int, int], Any], begin: int, end: int) -> int:
    """Return the first row of which something holds, ``end`` where of none."""
    stride = STRIDE
    while begin < end:
        found = np.flatnonzero(holds(begin, min(begin + stride, end)))
        if len(found):
            return begin + int(found[0])
        begin, stride = begin + stride, 2 * stride
    return end


class FirstMotions:
    """Follows how all servos of one protocol begin to move."""

    def __init__(self, registers: Sequence[Register]) -> None:
        self._count = counts_of(registers)
        self._joints: dict[tuple[int, str], _Joint] = {}

    def add(self, course: Course) -> list[Bounds]:
        """Take the positions and goals of one servo; return how long motions took that began."""
        key = course.servo_id, course.unit
        joint = self._joints.get(key)
        if joint is None:
            least = RESOLUTION * self._count.get(course.unit, 0.0)
            joint = self._joints[key] = _Joint(least)
        return joint.add(course)

    def figures(self) -> Mapping[tuple[int, str], StartFigures]:
        """Return the figures by servo and unit, of those that were told to go from rest."""
        return {k: joint.figures for k, joint in self._joints.items() if joint.figures.told}
