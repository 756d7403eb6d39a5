"""Goals against their own history: a step that no other of them comes near to."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.diagnosis.case import BUCKET_NS
from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import TORN, may_be_torn
from sniffer.diagnosis.evidence.jumping import jumping
from sniffer.diagnosis.evidence.trips import BEYOND, trips
from sniffer.diagnosis.model import Finding, Place
from sniffer.ground.medians import median
from sniffer.ground.milli import MILLI
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case, Series
    from sniffer.diagnosis.evidence.trips import Trip
    from sniffer.diagnosis.ledger.steps import Leap
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import F64, I64

FINDINGS: Final = (
    FindingCode(
        "goal-jump",
        "One goal jumps far from the one before it, in a row of goals that move in small steps.",
        "A step four times beyond all others within two seconds, and a quarter of the travel, "
        "between goals that go on in small steps, with no pause before it, and twice as far as the "
        "path goes in that time beside it. Where no clock tells pauses: "
        "four times beyond all other steps and back within eight goals, while other servos' goals go on "
        "in small steps or, where there are none, from where no other goal is.",
    ),
)

ABOUT: Final = 0.5
"""Steps that are at least so much of a jump are jumps, too: the way back."""

PART: Final = 0.25
"""Part of the travel of the goals: less is no jump that anybody would see."""

BACK: Final = 3
"""Quarter seconds within which a jump comes back."""

AMONG: Final = 5
"""Goals in a quarter second among which one step alone can be told from a fast move."""

BUCKETS: Final = 12
"""Quarter seconds of moving goals that make a history."""

NEAR: Final = 8
"""Quarter seconds around a jump in which the goals must be moving in small steps."""

SHARE: Final = 0.2
"""Of so many steps that are far beyond the others they are the program's way: it moves from point
to point."""

PAUSED: Final = 2.5
"""A pause so much longer than usual lets a path go on that is a function of time."""

STATED: Final = 0.6
"""Where fewer goals than so much of the usual number are stated, some are missing in between."""

LEAPS: Final = 2.0
"""So many times the usual step is one behind a rest."""

GOES_ON: Final = 2.0
"""A path that turns meanwhile is at most so many times as fast as it is right beside."""

RETRIES: Final = 2
"""Times that a usual client asks once more; it does so for a servo that is gone in every cycle."""

DOUBT: Final = 3
"""Damaged places from which on another may have held by chance, where the checksum is weak or there
is none."""


class _Jump(NamedTuple):
    """A goal that jumps: where it is, until when it is back, and by how much in the unit."""

    at: int
    first_ns: int
    last_ns: int
    size: float


def goal_jumps(case: Case) -> Iterator[Finding]:
    """Jumps in goals that else move smoothly."""
    for servo in case.measured_by("goal_position"):
        goals = case.series(servo, "goal_position")
        if goals is None:
            continue
        jumps, usual, returns = (
            _timed(case, servo, goals) if case.has_clock else _ordered(case, servo, goals)
        )
        if not jumps:
            continue
        if may_be_torn(case, len(jumps)) or (case.count(*TORN) >= DOUBT and _is_weak(case)):
            continue
        if returns and _is_weak(case) and _is_as_positions(case, jumps, usual):
            continue
        size = goals.told(max(jump.size for jump in jumps))
        yield Finding(
            "goal-jump",
            servo,
            jumps[0].first_ns,
            jumps[-1].last_ns,
            len(jumps),
            f"a goal of servo {servo} jumps by {size}, and no other step "
            f"near is above {goals.told(usual)}" + (", and comes back" if returns else ""),
            tuple(Place(j.at, 1, j.first_ns, "a goal that jumps") for j in jumps[:3]),
            brief=f"a goal of servo {servo} jumps by {size}",
            episodes=tuple((j.first_ns, j.last_ns) for j in jumps),
        )


def _is_as_positions(case: Case, jumps: Sequence[_Jump], usual: float) -> bool:
    """Tell whether a measured position jumps as far that no goal sent there.

    One bit is altered then, of answers and of requests.
    """
    for servo, (_, leaps) in jumping(case).items():
        first = leaps[0]
        size = first.size / MILLI
        alike = any(abs(jump.size - size) <= usual for jump in jumps)
        goals = case.series(servo, "goal_position")
        if not alike or goals is None:
            continue
        since, until = first.t_ns - first.took_ns, first.t_ns
        then = (goals.t >= since - NS) & (goals.t_first <= until + NS)
        if float(goals.step[then].max(initial=0.0)) < size / 2:
            return True
    return False


def _timed(case: Case, servo: int, goals: Series) -> tuple[list[_Jump], float, bool]:
    """Return the jumps by the clock, the greatest other step near them, and whether they come back."""
    if len(goals) < BUCKETS:
        return [], 0.0, False
    rows, usual = _jumps(case, servo, goals)
    if not len(rows):
        return [], 0.0, False
    worst = int(rows[np.argmax(goals.step[rows])])
    returns = bool(np.abs(goals.last[worst] - goals.first[worst]) < goals.step[worst] / 2)
    leaps = case.ledger.steps.of(servo, goals.index)
    jumps: list[_Jump] = []
    out: Leap | None = None
    for r in rows.tolist():
        leap = _leap_in(leaps, goals, r)
        if leap is None:  # there are more than are kept one by one
            since, until = int(goals.t_first[r]), int(goals.t[r])
            jumps.append(_Jump(int(goals.at[r]), since, until, float(goals.step[r])))
        elif out is not None and _is_way_back(out, leap):
            jumps[-1] = jumps[-1]._replace(last_ns=leap.t_ns)
        else:
            jumps.append(_Jump(leap.at, leap.t_ns, leap.t_ns, leap.size / MILLI))
        out = leap
    return jumps, usual, returns


def _leap_in(leaps: Sequence[Leap], goals: Series, r: int) -> Leap | None:
    """Return the first jump among the goals of a bucket, if it is kept."""
    since, until = int(goals.t_first[r]), int(goals.t[r])
    least = ABOUT * float(goals.step[r]) * MILLI
    return next((s for s in leaps if since <= s.t_ns <= until and s.size >= least), None)


def _is_way_back(out: Leap, leap: Leap) -> bool:
    """Tell whether a jump comes back from where the one before it went, soon."""
    back = (leap.after - leap.before) * (out.after - out.before) < 0
    return back and leap.t_ns - out.t_ns <= BACK * BUCKET_NS


def _ordered(case: Case, servo: int, goals: Series) -> tuple[list[_Jump], float, bool]:
    """Return the same by the order of goals alone.

    Each may be a pause, or two: a path goes on meanwhile, to where it goes anyway, and so do those
    of other servos. Only what comes back at once while others go on in small steps, or, where there are
    none, from where no other goal is, is a jump.
    """
    found, usual = trips(case, servo, goals)
    jumps = [
        _Jump(t.out.at, t.out.t_ns, t.back.t_ns, t.out.size / MILLI)
        for t in found
        if _goes_on_meanwhile(case, goals, found, t)
        and not _asks_again(case, t.out.t_ns, t.back.t_ns)
    ]
    return jumps, usual, True


def _is_weak(case: Case) -> bool:
    """Tell whether a damaged frame may hold: it has no checksum, or one of fewer than eight bits."""
    for example in case.ledger.exchanges.kinds.example:
        known = case.protocol.checksum_of(example)
        if known is None:
            return True
        whole, covered, _ = known
        if whole(bytes(len(covered))) == whole(b"\x80" + bytes(len(covered) - 1)):
            return True
    return False


def _jumps(case: Case, servo: int, goals: Series) -> tuple[I64, float]:
    """Return the buckets with a jump, and what the other steps near them are below."""
    none = np.empty(0, np.int64)
    step: F64 = goals.step
    moving = step > 0
    if moving.sum() < BUCKETS:
        return none, 0.0
    travel = float(goals.high.max() - goals.low.min())
    far = step > max(BEYOND * float(median(step[moving])), PART * travel)
    if not far.any():
        return none, 0.0
    leaps = case.ledger.steps.of(servo, goals.index)
    found = [
        (r, usual)
        for r in np.flatnonzero(far).tolist()
        if (usual := _usual(case, goals, r, leaps)) and not _goes_on(case, leaps, goals, r)
    ]
    if not 0 < len(found) <= max(SHARE * moving.sum(), 1):
        return none, 0.0
    return np.array([r for r, _ in found], np.int64), max(usual for _, usual in found)


def _usual(case: Case, goals: Series, r: int, leaps: Sequence[Leap]) -> float:
    """Return the greatest of the small steps around a jump; 0: it is none."""
    bucket, step = goals.bucket, goals.step
    near = np.abs(bucket - bucket[r]) <= NEAR
    small = near & (step > 0) & (step < ABOUT * step[r])
    before, behind = int(small[:r].sum()), int(small[r + 1 :].sum())
    # Behind the last goal of all nothing says whether it was one of the path or another move.
    ends = bucket[r] >= max(bucket[-1] - 1, case.last_ns // BUCKET_NS - 2)
    if before < NEAR // 2 or (behind < NEAR // 4 and not ends) or _lacks_goals(case, goals, r):
        return 0.0
    usual = float(step[small].max())
    return usual if step[r] >= BEYOND * usual and _stands_out(goals, r, leaps) else 0.0


def _goes_on(case: Case, leaps: Sequence[Leap], goals: Series, r: int) -> bool:
    """Tell whether a step is what its path does in the time that it took: its controller was late.

    How fast the path goes is told by the goals that are stated close to each other beside it.
    """
    size = float(goals.step[r])
    since, until = int(goals.t[max(r - 1, 0)]), int(goals.t[r])
    took = [s.took_ns for s in leaps if since <= s.t_ns <= until and s.size >= ABOUT * size * MILLI]
    near = np.flatnonzero((np.abs(goals.bucket - goals.bucket[r]) <= BACK) & (goals.step < size))
    lasted = goals.t[near] - goals.t_first[near]
    told = lasted > 2 * case.latency_ns
    way = np.abs(goals.last[near] - goals.first[near])[told]
    fastest = float((way / lasted[told]).max(initial=0.0))
    return bool(took) and size <= GOES_ON * fastest * max(took)


def _stands_out(goals: Series, r: int, leaps: Sequence[Leap]) -> bool:
    """Tell whether a step is no part of a fast move: it comes back, or stands alone among many."""
    alike = np.flatnonzero(
        (np.abs(goals.bucket - goals.bucket[r]) <= BACK) & (goals.step >= ABOUT * goals.step[r])
    )
    before, after = max(int(alike[0]) - 1, 0), int(alike[-1])
    way = abs(float(goals.last[after] - goals.last[before]))
    if way <= ABOUT * goals.step[r]:
        return True
    # of a fast path the ends of quarter seconds are far apart: the jumps themselves tell
    least, since, until = ABOUT * goals.step[r] * MILLI, goals.t_first[alike[0]], goals.t[after]
    near = [s for s in leaps if since <= s.t_ns <= until and s.size >= least]
    if any(_is_way_back(a, b) and abs(b.after - a.before) <= least for a, b in pairwise(near)):
        return True
    alone = len(alike) == 1 and goals.n[r] >= AMONG
    return bool(alone and way <= goals.step[r] * (1 + 1 / BEYOND))


def _goes_on_meanwhile(case: Case, goals: Series, found: Sequence[Trip], trip: Trip) -> bool:
    """Tell whether the program did not rest: goals of others go on in small steps meanwhile."""
    out, back = trip
    spare, is_alone = back.at - out.at, True
    for servo in case.measured_by("goal_position"):
        other = case.series(servo, "goal_position")
        if other is None or other is goals:
            continue
        if not ((other.t >= out.t_ns) & (other.t_first <= back.t_ns)).any():
            continue
        leaps = case.ledger.steps.of(servo, other.index)
        # of the greatest steps of a path that goes on, the least is as long as the first
        least = LEAPS * min((s.size for s in leaps), default=0)
        if any(s.size >= least and -spare <= s.at - out.at <= 2 * spare for s in leaps):
            return False
        is_alone = False
    return not is_alone or _is_beyond(goals, found, trip)


def _is_beyond(goals: Series, found: Sequence[Trip], trip: Trip) -> bool:
    """Tell whether a goal jumps to where no other goal is."""
    ways = [s for t in found for s in t]
    free = np.ones(len(goals), bool)
    for s in ways:
        free &= (goals.t < s.t_ns) | (goals.t_first > s.t_ns)
    ends = np.array([x / MILLI for t in found for x in (t.out.before, t.back.after)])
    low = min(goals.low[free].min(initial=np.inf), ends.min())
    high = max(goals.high[free].max(initial=-np.inf), ends.max())
    there, size = trip.out.after / MILLI, trip.out.size / MILLI
    return bool(max(there - high, low - there) >= PART * size)


def _asks_again(case: Case, since_ns: int, until_ns: int) -> bool:
    """Tell whether one request was said again and again: the path goes on meanwhile."""
    runs = [run for run in case.ledger.exchanges.all_runs if run.again > RETRIES]
    return any(run.t_ns < until_ns and run.until_ns > since_ns for run in runs)


def _lacks_goals(case: Case, goals: Series, r: int) -> bool:
    """Tell whether goals are missing before a jump: a path is a function of time, and goes on."""
    beside = slice(max(r - 1, 0), r + 1)
    if (np.diff(goals.bucket[beside]) > 1).any():
        return True
    near = np.abs(goals.bucket - goals.bucket[r]) <= NEAR
    most = float(median(goals.n[near]))
    # a quarter second has one of a period more or less: two hundred milliseconds make it one or two
    if ((goals.n[beside] < STATED * most) & (goals.n[beside] < most - 1)).any():
        return True
    if _asks_again(case, int(goals.t_first[beside.start]), int(goals.t[r])):
        return True
    pauses = case.line["pause_max"]
    seen = pauses[pauses > 0]
    if not len(seen):
        return False
    place = np.searchsorted(case.line["bucket"], goals.bucket[beside])
    return bool((pauses[place] > PAUSED * float(median(seen))).any())


RULES: Final[tuple[Rule, ...]] = (goal_jumps,)
"""The rules of this area."""
