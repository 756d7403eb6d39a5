"""Goals against their own history: a step that no other of them comes near to."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.model import Finding, Place

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case, Series
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import F64, I64

FINDINGS: Final = (
    FindingCode(
        "goal-jump",
        "controller",
        "One goal jumps far from the one before it, in a row of goals that move in small steps.",
        "A step six times beyond nine tenths of all others and a twentieth of the travel, between "
        "goals that go on in small steps, with no pause before it.",
    ),
)

BEYOND: Final = 6.0
"""A path that is smooth has no step several times beyond its fast parts."""

PART: Final = 0.05
"""Part of the travel of the goals: less is no jump that anybody would see."""

BUCKETS: Final = 12
"""Quarter seconds of moving goals that make a history."""

NEAR: Final = 8
"""Quarter seconds around a jump in which the goals must be moving in small steps."""

SHARE: Final = 0.1
"""Of so many steps that are far beyond the others they are the program's way: it moves from point
to point."""

PAUSED: Final = 2.5
"""A pause so much longer than usual lets a path go on that is a function of time."""

STATED: Final = 0.6
"""Where fewer goals than so much of the usual number are stated, some are missing in between."""

DOUBT: Final = 3
"""Damaged places from which on another may have held by chance, where the checksum is weak or there
is none."""


def goal_jumps(case: Case) -> Iterator[Finding]:
    """Jumps in goals that else move smoothly."""
    for servo in case.measured_by("goal_position"):
        goals = case.series(servo, "goal_position")
        if goals is None or len(goals) < BUCKETS:
            continue
        rows, usual = _jumps(case, goals)
        if not len(rows):
            continue
        worst = int(rows[np.argmax(goals.step[rows])])
        returns = bool(np.abs(goals.last[worst] - goals.first[worst]) < goals.step[worst] / 2)
        torn = case.count("bad-checksum", "damaged-frame", "noise", "truncated-frame")
        if torn >= DOUBT and _is_weak(case):
            continue
        yield Finding(
            "goal-jump",
            servo,
            int(goals.t_first[rows[0]]),
            int(goals.t[rows[-1]]),
            len(rows),
            f"a goal of servo {servo} jumps by {goals.told(float(goals.step[worst]))}, where nine "
            f"tenths of its steps are below {goals.told(usual)}"
            + (", and comes back" if returns else ""),
            tuple(
                Place(int(goals.at[r]), 1, int(goals.t_first[r]), "goals among which one jumps")
                for r in rows[:3]
            ),
            brief=f"a goal of servo {servo} jumps by {goals.told(float(goals.step[worst]))}",
            episodes=tuple((int(goals.t_first[r]), int(goals.t[r])) for r in rows),
        )


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


def _jumps(case: Case, goals: Series) -> tuple[I64, float]:
    """Return the buckets with a jump, and what nine tenths of the steps are below."""
    none = np.empty(0, np.int64)
    step: F64 = goals.step
    moving = step > 0
    if moving.sum() < BUCKETS:
        return none, 0.0
    usual = float(np.quantile(step[moving], 0.9))
    travel = float(goals.high.max() - goals.low.min())
    far = step > max(BEYOND * usual, PART * travel)
    if not 0 < far.sum() <= max(SHARE * moving.sum(), 1):
        return none, usual
    pauses = case.line["pause_max"]
    seen = pauses[pauses > 0]
    long = PAUSED * float(np.median(seen)) if len(seen) and case.has_clock else np.inf
    small = moving & ~far
    often = STATED * float(np.median(goals.n))
    out = []
    for r in np.flatnonzero(far).tolist():
        bucket = goals.bucket[r]
        near = (goals.bucket >= bucket - NEAR) & (goals.bucket <= bucket + NEAR) & small
        before, behind = near[:r].sum(), near[r + 1 :].sum()
        ends = bucket >= goals.bucket[-1] - 1
        place = int(np.searchsorted(case.line["bucket"], bucket))
        here = slice(max(place - 1, 0), place + 1)
        paused = bool((pauses[here] > long).any()) or bool(
            np.diff(goals.bucket[max(r - 1, 0) : r + 1]).max(initial=0) > 1
        )
        missing = goals.n[r] < often or goals.n[max(r - 1, 0)] < often
        if before >= NEAR // 2 and not missing and (behind >= NEAR // 4 or ends) and not paused:
            out.append(r)
    return np.array(out, np.int64), usual


RULES: Final[tuple[Rule, ...]] = (goal_jumps,)
"""The rules of this area."""
