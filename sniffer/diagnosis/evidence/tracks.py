"""Goals against positions of one joint: when it is away from its goals and does not come nearer.

Judged on buckets, so it takes the time between goal and position for nothing: a joint may follow as
late as it likes within ``LAG_NS``, and as slowly as it likes as long as it comes nearer.
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.diagnosis.evidence.witnesses import moves_elsewhere, runs, stands_elsewhere
from sniffer.ground.medians import median
from sniffer.ground.model import NEVER_NS, NS
from sniffer.protocols.base import LETS_GO, RESTARTS, TURNS_ELSEWHERE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.diagnosis.case import Case, Series
    from sniffer.ground.model import F64, I64, Mask

LAG_NS: Final = NS
"""A servo that follows at all begins to move within tenths of a second."""

WINDOW_NS: Final = NS
"""It is looked at for so long before something is said of it, and for ``LOOKS`` positions."""

LOOKS: Final = 4

GOALS: Final = 3
"""Goals that pass over the place where a joint stands: what it does at one tells little."""

SELDOM: Final = 3
"""A joint that is looked at so many times less often is seen where it rests, not on its way."""

REST: Final = 10
"""A pause so many times as long as those between looks usually are is no way of looking."""

SEEN: Final = 2
"""So many looks must see it away: one may be of a servo that takes its time."""

STOPS: Final = 3
STOPPED: Final = 0.8
"""So many looks, and such a part of those that see it away on one side, see it at one place: slow
servos on their way are met anywhere, at a fortieth of their way one of forty times."""

AGE_NS: Final = 30 * NS
"""A goal that was stated longer ago is not counted on: what it is to do since nobody knows."""

FAR: Final = {"deg": 4.0, "mm": 0.8, "us": 40.0}
"""Errors of position below this are dead bands, play and give of a sound servo: manuals have
margins up to 2 degrees, springy joints twice that."""

FAR_SHARE: Final = 0.03
"""The same as part of the register's range, where the unit is none of these."""

OF_RANGE: Final = 0.1
"""... and below this part of what its goals range over."""

FOLLOWS: Final = 0.15
"""Positions that range over less than this part of what the goals do, do not follow them."""

BRIDGED_NS: Final = 3 * NS // 4
"""Moments in which the goals pass by where a joint hangs do not end that it hangs there."""


OFF_GOALS: Final = 0.1
"""Part of its looks that see a joint away from its goals if it is held while they pass it by."""


class Away(NamedTuple):
    """A stretch in which a joint does not follow: rows of its positions, and how far it is off."""

    first: int
    last: int
    first_ns: int
    last_ns: int
    error: float


class JointTrack:
    """One joint: what it was told and where it was, in one unit."""

    def __init__(self, case: Case, servo_id: int, goal: Series, position: Series) -> None:
        self.servo_id = servo_id
        self.goal = goal
        self.position = position
        self._case = case

    @functools.cached_property
    def span(self) -> float:
        """What its goals range over."""
        return float(self.goal.high.max() - self.goal.low.min())

    @functools.cached_property
    def far(self) -> float:
        """From which error on it is away from its goal, in the unit."""
        register = self.position.register
        least = FAR.get(self.position.unit, 0.0)
        if not least:
            low, high = register.range or (0, 0)
            least = FAR_SHARE * (high - low) * self.position.scale
        return max(least, OF_RANGE * self.span, 4 * self.position.scale)

    @functools.cached_property
    def ends(self) -> I64:
        """When its goal was ended without another: motor off, a restart, another way to move."""
        case, who = self._case, self.servo_id
        told = [case.order_times(who, LETS_GO, RESTARTS, TURNS_ELSEWHERE)]
        for one in (who, *case.everyone):
            off = case.settings("torque_enable", servo_id=one)
            told.append(off.t_ns[(off.written == 1) & (off.after != 1)])
        told += [s.t for s in case.every(who, "goal_position") if not _alike(s, self.goal)]
        return np.sort(np.concatenate(told))

    @functools.cached_property
    def away(self) -> Sequence[Away]:
        """The stretches in which it does not follow, in order."""
        flag = self._is_away & self._is_told
        rows = np.flatnonzero(flag)
        if not len(rows):
            return ()
        t = self.position.t
        apart = np.diff(t[rows]) > BRIDGED_NS + self._window_ns // 2
        split = np.flatnonzero(apart & ~self._stays(rows[:-1], rows[1:])) + 1
        out = []
        for part in np.split(rows, split):
            a, b = int(part[0]), int(part[-1])
            began = max(int(t[a]) - self._window_ns, int(self.position.t_first[0]))
            if int(t[b]) - began >= WINDOW_NS:
                out.append(Away(a, b, began, int(t[b]), float(median(self._error[part]))))
        return [one for one in out if not (self._is_seen_to_move(one) or self._is_in_step(one))]

    def follows(self, since_ns: int) -> bool:
        """Tell whether it is near its goals for the second that begins a second later."""
        p = self.position
        rows = np.flatnonzero((p.t_first > since_ns + LAG_NS) & (p.t <= since_ns + 3 * LAG_NS))
        if not len(rows) or int(p.t[rows[-1]] - p.t_first[rows[0]]) < LAG_NS:
            return False
        low, high = in_force(self.goal, p.t[rows] - LAG_NS // 2, p.t[rows])
        near = np.maximum(low - p.last[rows], p.last[rows] - high) <= self.far / 2
        return bool(near.all()) and float(np.ptp(p.last[rows])) > self.far

    def _stays(self, since: I64, until: I64) -> Mask:
        """Tell whether it stood still from one row to another, whatever its goals did."""
        low, high = _extremes(self.position, since, until + 1)
        told = self._is_told.astype(np.int64)
        kept = np.cumsum(told)[until] - np.cumsum(told)[since] == until - since
        stays: Mask = (high - low < self.far / 2) & kept
        return stays

    def _is_seen_to_move(self, away: Away) -> bool:
        """Tell whether another register has it moving where this one's positions have it stand."""
        case, who, span = self._case, self.servo_id, (away.first_ns, away.last_ns)
        return moves_elsewhere(case, who, self.position, span, self.far) or runs(case, who, span)

    def _is_in_step(self, away: Away) -> bool:
        """Tell whether it is met at one place, where it was told to be: looked at in step."""
        p, span = self.position, (away.first_ns, away.last_ns)
        rows = np.flatnonzero((p.t >= span[0]) & (p.t <= span[1]))
        low, high = in_force(self.goal, p.t_first[rows] - LAG_NS // 4, p.t[rows])
        off = np.maximum(low - p.last[rows], p.last[rows] - high) > self.far
        if np.count_nonzero(off) >= max(SEEN, OFF_GOALS * len(rows)):
            return False
        return not stands_elsewhere(self._case, self.servo_id, p, span, self.far)

    @functools.cached_property
    def _window_ns(self) -> int:
        """How long it is looked at: long enough for some positions.

        Rests in which nobody looks are left out: a loop that was stopped does not look seldom.
        """
        p = self.position
        looks = int(p.n.sum())
        gaps = np.diff(p.t)
        rests = int(gaps[gaps > REST * median(gaps)].sum()) if len(gaps) else 0
        each = (int(p.t[-1] - p.t_first[0]) - rests) // max(looks - 1, 1)
        return max(WINDOW_NS, LOOKS * each)

    @property
    def _long_ns(self) -> int:
        """The same, and the time that a joint may take to follow."""
        return self._window_ns + LAG_NS

    @functools.cached_property
    def _is_told(self) -> Mask:
        """Whether a goal is in force in each row, and was for as long as is looked at."""
        t = self.position.t
        told_at = _latest(self.goal.t_first, t, self.goal.t)
        ended_at = _latest(self.ends, t)
        since = t - self._window_ns
        out: Mask = (t - told_at <= AGE_NS) & (ended_at <= since) & (ended_at <= told_at)
        # what it was told before its motor was off is no goal of the time until it is told again
        again = np.minimum(np.searchsorted(self.goal.t, ended_at, "right"), len(self.goal) - 1)
        out &= np.maximum(self.goal.t_first[again], ended_at) <= since
        silences = self._case.ledger.silences
        late = silences.late(self.servo_id)
        for s in (*silences.runs(self.servo_id), *((late,) if late else ())):
            if s.missed > 1:  # what did not reach it, it cannot follow
                out &= (t < s.first_ns) | (t > (s.back_ns or 0) + self._long_ns)
        return out

    @functools.cached_property
    def _goals(self) -> tuple[F64, F64]:
        """What was in force in the window of each row, and before it."""
        p, g = self.position, self.goal
        return in_force(g, p.t - self._long_ns, p.t)

    @functools.cached_property
    def _places(self) -> tuple[F64, F64, I64]:
        """Where it was in the window of each row, and how often it was looked at."""
        p = self.position
        first = np.searchsorted(p.t, p.t - self._window_ns)
        low, high = _extremes(p, first, np.arange(len(p)) + 1)
        total = np.concatenate([[0], np.cumsum(p.n)])
        return low, high, total[np.arange(len(p)) + 1] - total[first]

    @functools.cached_property
    def _error(self) -> F64:
        """How far the last position of each row is from the nearest goal."""
        low, high = self._goals
        last = self.position.last
        return np.maximum(np.maximum(low - last, last - high), 0.0)

    @functools.cached_property
    def _is_away(self) -> Mask:
        p = self.position
        low, high, looks = self._places
        goal_low, goal_high = self._goals
        gap = np.maximum(goal_low - high, low - goal_high)
        first = np.searchsorted(p.t, p.t - self._window_ns)
        began = p.first[first]
        error_then = np.maximum(np.maximum(goal_low - began, began - goal_high), 0.0)
        moved = high - low
        nearer = error_then - self._error
        step = 4 * p.scale
        comes = (nearer > step) & (nearer > 0.3 * moved)
        away: Mask = (gap > self.far) & ~comes
        # goals that pass over the place where it hangs: slow ones, for fast ones nobody follows
        means = self._slow_goals
        # where it was when the goals began to move, which may have been looked at a little before
        since = np.maximum(np.searchsorted(p.t, self._goals_since) - 1, 0)
        low, high = _extremes(p, since, np.arange(len(p)) + 1)
        stands = (means > 2 * self.far) & (high - low < FOLLOWS * means) & ~self._obeys
        # a joint that follows is met at one place a few times, on its way; looks at once are one
        off = np.concatenate([[0], np.cumsum(self._is_off)])
        behind = np.arange(len(p)) + 1
        stands &= (off[behind] - off[since] >= SEEN) | (behind - since > LOOKS)
        away |= stands
        return (away & (looks >= LOOKS - 1)) | self._is_away_at_looks

    @property
    def _is_seldom(self) -> bool:
        """Whether it is looked at so seldom that it is seen here and there, and not on its way."""
        return self._window_ns > SELDOM * WINDOW_NS

    @functools.cached_property
    def _is_off(self) -> Mask:
        """Whether a joint is where no goal was in the time that one takes to follow."""
        p = self.position
        low, high = in_force(self.goal, p.t - LAG_NS // 2, p.t_first)
        off: Mask = np.maximum(low - p.last, p.last - high) > self.far
        return off

    @functools.cached_property
    def _is_away_at_looks(self) -> Mask:
        """Whether a joint that is looked at seldom is far from all that it was told lately.

        Who looks where a joint has got to once a move sees it stand there. Told for as long as a
        servo takes to begin, it has not come nearer since the look before; one such look may be a
        slow servo on its way, several are none. Or it comes, and whatever its goals beyond that
        are, to one place.
        """
        p = self.position
        none = np.zeros(len(p), bool)
        if not self._is_seldom or len(p) < 2:
            return none
        low, high = in_force(self.goal, p.t - LAG_NS, p.t_first)
        error = np.maximum(np.maximum(low - p.last, p.last - high), 0.0)
        then = np.roll(p.last, 1)
        error_then = np.maximum(np.maximum(low - then, then - high), 0.0)
        far: Mask = error > self.far
        away: Mask = far & (error_then - error <= self.far / 8)
        away[0] = False
        seen = away if np.count_nonzero(away) >= SEEN else none
        return (
            seen | self._stops(far & (low > p.last), high) | self._stops(far & (high < p.last), low)
        )

    def _stops(self, far: Mask, goal: F64) -> Mask:
        """Tell which looks see it away on one side, all at one place, though its goals differ."""
        rows = np.flatnonzero(far)
        out = np.zeros(len(far), bool)
        if len(rows) < STOPS:
            return out
        place = self.position.last[rows]
        there = rows[np.abs(place - median(place)) < self.far / 8]
        if len(there) >= max(STOPS, STOPPED * len(rows)) and np.ptp(goal[there]) > self.far:
            out[there] = True
        return out

    @functools.cached_property
    def _obeys(self) -> Mask:
        """Whether it is where its latest goal is, or has come nearer since that was stated."""
        p, g = self.position, self.goal
        changed = np.flatnonzero(g.step > 0)
        if not len(changed):
            return np.zeros(len(p), bool)
        row = changed[np.maximum(np.searchsorted(g.t[changed], p.t, "right") - 1, 0)]
        goal, told_ns = g.last[row], g.t[row]
        began = np.maximum(np.searchsorted(p.t_first, told_ns, "right") - 1, 0)
        was = np.where(p.t[began] <= told_ns, p.last[began], p.first[began])
        nearer = np.abs(goal - was) - np.abs(goal - p.last)
        # what it was told right before it is looked at it has not done, but what it was told before
        known = np.searchsorted(g.t[changed], p.t - LAG_NS // 4, "right") - 1
        in_time = g.last[changed[np.maximum(known, 0)]]
        is_there = (np.abs(in_time - p.last) < self.far / 2) & (known >= 0)
        obeys: Mask = (told_ns <= p.t) & ((nearer > self.far / 8) | is_there)
        return obeys

    @functools.cached_property
    def _goals_since(self) -> I64:
        """Since when goals are held against each row: for so long that there are some.

        A program that states one each second or two moves on before a window of it is over.
        """
        p, g = self.position, self.goal
        changed = g.t_first[g.step > 0]
        if not len(changed):
            return p.t - self._long_ns
        latest = np.searchsorted(changed, p.t - LAG_NS // 2, "right") - 1
        some = changed[np.maximum(latest - GOALS + 1, 0)]
        return np.minimum(p.t - self._long_ns, np.maximum(some, p.t - GOALS * self._long_ns))

    @functools.cached_property
    def _slow_goals(self) -> F64:
        """How far the goals of each window range, by the means of their buckets.

        Of the last moments none count: a joint that has just begun to move was told where to.
        """
        p, g = self.position, self.goal
        # What it was told before it was looked at, it may have done.
        first = np.searchsorted(g.t, np.maximum(self._goals_since, p.t_first[0]))
        behind = np.searchsorted(g.t, p.t - LAG_NS // 2, "right")
        low, high = _extremes(g, first, behind, g.mean, g.mean)
        return np.where(np.isfinite(low), high - low, 0.0)


def in_force(s: Series, since: I64, until: I64) -> tuple[F64, F64]:
    """Return the extremes of what was stated in stretches of time, or last before them."""
    first = np.searchsorted(s.t, since)
    behind = np.searchsorted(s.t_first, until, "right")
    low, high = _extremes(s, first, behind)
    before = first - 1
    held = np.where(before >= 0, s.last[np.maximum(before, 0)], np.nan)
    low, high = np.fmin(low, held), np.fmax(high, held)
    none = np.isinf(low)
    return np.where(none, np.nan, low), np.where(none, np.nan, high)


def _extremes(
    s: Series, first: I64, behind: I64, lows: F64 | None = None, highs: F64 | None = None
) -> tuple[F64, F64]:
    """Return the least and the greatest of rows from ``first`` to before ``behind``; inf: none."""
    lows = s.low if lows is None else lows
    highs = s.high if highs is None else highs
    low, high = np.full(len(first), np.inf), np.full(len(first), -np.inf)
    for k in range(int((behind - first).max(initial=0))):
        there = first + k < behind
        row = np.minimum(first + k, len(s) - 1)
        low = np.where(there, np.minimum(low, lows[row]), low)
        high = np.where(there, np.maximum(high, highs[row]), high)
    return low, high


def _latest(moments: I64, t: I64, until: I64 | None = None) -> I64:
    """Return for each time the latest of some moments (where ``until`` is given: its end)."""
    if not len(moments):
        return np.full(len(t), -NEVER_NS)
    place = np.searchsorted(moments, t, "right") - 1
    ends = moments if until is None else until
    return np.where(place >= 0, ends[np.maximum(place, 0)], -NEVER_NS)


def track(case: Case, servo_id: int) -> JointTrack | None:
    """Return goals and positions of a servo that are counted alike; None: there are none."""
    for position in case.every(servo_id, "position"):
        for goal in case.every(servo_id, "goal_position"):
            if goal.register.access != "r" and _alike(goal, position):
                return JointTrack(case, servo_id, goal, position)
    return None


def _alike(one: Series, other: Series) -> bool:
    """Tell whether two registers count alike."""
    a, b = one.register, other.register
    return (a.unit, a.scale, bool(a.scale_by)) == (b.unit, b.scale, bool(b.scale_by))
