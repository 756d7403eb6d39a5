"""By how much a servo is behind its goals: the shift in time that leaves the least error.

A joint that follows a trajectory is never where its goal is, and its following error says how
fast it moves as much as how well it follows. Shift the goals by some time and most of that error is
gone: that time is the lag. What is left then is what the servo does otherwise than it was told.

Five goals (t ms, mm) and three positions: every position is what the goal was 20 ms before it.

    goals        0: 10   10: 11   20: 12   30: 13   40: 14
    positions        25: 10           35: 11           45: 12
    goal now             12               13               14    squares of the errors: 4 + 4 + 4
    goal 20 ms ago       10               11               12    0 + 0 + 0

Nothing is told where no shift does better than others: a goal that stands still fits with any, and
a joint that hangs limp with none.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.milli import MILLI, in_milli
from sniffer.ground.model import MS

if TYPE_CHECKING:
    from collections.abc import Callable

    from sniffer.ground.model import F64, I64, Mask
    from sniffer.statistics.following import Course

STEP_NS: Final = 4_000_000
"""How far two shifts that are tried lie apart: less than servos are asked for where they are."""

LONGEST_NS: Final = 500_000_000
"""The longest shift that is tried: a joint further behind does not follow."""

SHIFTS: Final = np.arange(0, LONGEST_NS + 1, STEP_NS)

ENOUGH: Final = 50
"""Positions of a moving goal that are needed."""

MOST: Final = 1024
"""So many are weighed, of the next so many every second one, of twice as many behind them every
fourth...: a day costs little more than an hour."""

DEEP: Final = 0.5
"""What the best shift leaves of the mean square error of the worst one, at most."""

NEAR: Final = 1.1
"""A shift that leaves no more than so many times the least is as good: of a motion that repeats
within ``LONGEST_NS`` the shortest one counts."""

FARTHEST: Final = 1 << 13
"""A longer way from a goal to a position counts as this one, so squares can be summed for years."""


def whole_ms(low_ns: int, high_ns: int) -> str:
    """Return bounds in ms, rounded outwards: ``54-66``, or ``<6`` where it may be none."""
    low, high = low_ns // MS, -(-high_ns // MS)
    return f"{low}-{high}" if low else f"<{high}"


@dataclass(frozen=True, slots=True)
class Lag:
    """By how much the positions of a servo are behind its goals, as far as the stamps tell.

    ``low_ns`` and ``high_ns`` bound it; ``count`` positions were weighed. ``rms`` is what the best
    shift leaves of the following error, ``rms_unshifted`` what it is as it stands, both root mean
    squares in the unit of the position.
    """

    low_ns: int
    high_ns: int
    count: int
    rms: float
    rms_unshifted: float

    def ms(self) -> str:
        """Return it in whole ms: both bounds, or an upper one."""
        return whole_ms(self.low_ns, self.high_ns)


class _Past:
    """One servo's goals of the last ``LONGEST_NS``."""

    def __init__(self) -> None:
        self._t_ns: I64 = np.empty(0, np.int64)
        self._goal: F64 = np.empty(0)

    def weighed(self, course: Course, taken: Callable[[int], Mask]) -> tuple[I64, I64] | None:
        """Take more of its goals and positions.

        Return of each position of a moving goal the squares of its errors, by shift, and the
        uncertainty of its time; None: there is none. ``taken`` says which of so many are weighed.
        """
        changes = course.changes
        times = np.concatenate([self._t_ns, course.t_ns[changes]])
        times = np.maximum.accumulate(times)
        goals = np.concatenate([self._goal, course.goal[changes]])
        rows = np.flatnonzero(course.measured & course.shown & (course.spread >= 0))
        out = None
        if len(times) and len(rows):
            out = self._weigh(times, goals, course, rows, taken)
        if len(times):
            # the goal that held where the window begins is needed, too
            since = max(int(times[-1]), int(course.t_ns[-1])) - LONGEST_NS
            first = max(int(np.searchsorted(times, since, side="right")) - 1, 0)
            self._t_ns, self._goal = times[first:], goals[first:]
        return out

    def _weigh(
        self, times: I64, goals: F64, course: Course, rows: I64, taken: Callable[[int], Mask]
    ) -> tuple[I64, I64] | None:
        t_ns = course.t_ns[rows]
        oldest = np.searchsorted(times, t_ns - LONGEST_NS, side="right") - 1
        newest = np.searchsorted(times, t_ns, side="right") - 1
        unknown = np.concatenate([[0], np.cumsum(np.isnan(goals))])
        moving = (oldest >= 0) & (newest > oldest)
        moving &= unknown[newest + 1] == unknown[np.maximum(oldest, 0)]
        rows = rows[moving]
        rows = rows[taken(len(rows))]
        if not len(rows):
            return None
        held = np.searchsorted(times, course.t_ns[rows][:, None] - SHIFTS, side="right") - 1
        error = np.clip(goals[held] - course.position[rows][:, None], -FARTHEST, FARTHEST)
        return in_milli(error) ** 2, course.spread[rows]


def _best(squares: I64, count: int) -> int | None:
    """Return which shift leaves least of so many positions; None: no one does better."""
    least = int(squares.min())
    if count < ENOUGH or least > DEEP * int(squares.max()):
        return None
    best = int(np.flatnonzero(squares <= NEAR * least)[0])
    while best + 1 < len(SHIFTS) and squares[best + 1] <= squares[best]:
        best += 1
    return None if best == len(SHIFTS) - 1 else best


class _Shifted:
    """The squares of one servo's errors by shift."""

    def __init__(self) -> None:
        self.squares: I64 = np.zeros(len(SHIFTS), np.int64)
        self.count = 0
        self.doubt_ns = 0
        """Uncertainties of the times of all positions, summed."""
        self._past = _Past()
        self._met = 0

    def add(self, course: Course) -> None:
        """Take more of its goals and positions."""
        weighed = self._past.weighed(course, self._taken)
        if weighed is not None:
            squares, spread = weighed
            self.squares += squares.sum(axis=0)
            self.count += len(spread)
            self.doubt_ns += int(spread.sum())

    def _taken(self, n: int) -> Mask:
        number = self._met + np.arange(n)
        self._met += n
        taken: Mask = number % (1 << np.log2(np.maximum(number / MOST, 1)).astype(np.int64)) == 0
        return taken

    def lag(self) -> Lag | None:
        """Return what the shifts tell."""
        best = _best(self.squares, self.count)
        if best is None:
            return None
        # a shift is an average: one stamp that came late moves it by its share
        doubt = STEP_NS + self.doubt_ns // self.count
        left, whole = (float(np.sqrt(self.squares[k] / self.count) / MILLI) for k in (best, 0))
        low, high = max(int(SHIFTS[best]) - doubt, 0), int(SHIFTS[best]) + doubt
        return Lag(low, high, self.count, left, whole)


class LagSeries:
    """The lags of one servo, one after the other: each of ``ENOUGH`` positions of a moving goal."""

    def __init__(self) -> None:
        self._past = _Past()
        self._squares: I64 = np.empty((0, len(SHIFTS)), np.int64)
        self._spread: I64 = np.empty(0, np.int64)

    def add(self, course: Course) -> list[tuple[int, int]]:
        """Take more of its goals and positions; return lags that are known by them.

        Each is in ns, with what the stamps and the step leave open; where no shift does better than
        others there is none.
        """
        weighed = self._past.weighed(course, lambda n: np.ones(n, bool))
        if weighed is None:
            return []
        squares = np.concatenate([self._squares, weighed[0]])
        spread = np.concatenate([self._spread, weighed[1]])
        out = []
        whole = len(squares) // ENOUGH * ENOUGH
        for at in range(0, whole, ENOUGH):
            best = _best(squares[at : at + ENOUGH].sum(axis=0), ENOUGH)
            if best is not None:
                doubt = STEP_NS + int(spread[at : at + ENOUGH].mean())
                out.append((int(SHIFTS[best]), doubt))
        self._squares, self._spread = squares[whole:], spread[whole:]
        return out


class Lags:
    """Finds the lags of all servos of one protocol."""

    def __init__(self) -> None:
        self._shifted: dict[tuple[int, str], _Shifted] = {}

    def add(self, course: Course) -> None:
        """Take the positions and goals of one servo."""
        self._shifted.setdefault((course.servo_id, course.unit), _Shifted()).add(course)

    def of(self, servo_id: int, unit: str) -> Lag | None:
        """Return the lag of a servo; None: its goals do not tell."""
        mine = self._shifted.get((servo_id, unit))
        return None if mine is None else mine.lag()
