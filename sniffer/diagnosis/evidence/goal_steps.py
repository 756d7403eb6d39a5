"""When goals jump: motors pull hard for a while behind that."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.diagnosis.evidence.chances import at_least
from sniffer.diagnosis.evidence.outages import outages
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.silences import Silence
    from sniffer.ground.model import I64

KNOWN: Final = 8
"""Quarters of a second with goals that are enough to know their way."""

FAR: Final = 0.15
SELDOM: Final = 0.5
"""A step is so great a part of the way, in no greater part of the time."""

BEHIND_NS: Final = 3 * NS // 4
"""For so long a motor pulls harder."""

LEAST: Final = 5
NEARLY: Final = 0.9
"""Outages, and which part of them begin behind steps."""

CHANCE: Final = 1e-3
"""How likely so many are there by chance."""


def goal_steps(case: Case) -> I64:
    """Return when goals jump far, behind a time in which none does, in ns."""
    return case.once(_goal_steps)


def _goal_steps(case: Case) -> I64:
    found: list[int] = []
    for servo in case.measured_by("goal_position"):
        goals = case.series(servo, "goal_position")
        if goals is None or len(goals) < KNOWN:
            continue
        far = goals.step >= FAR * float(goals.high.max() - goals.low.min())
        # whoever says each goal once says nothing in between
        time = int(goals.bucket[-1] - goals.bucket[0]) + 1
        if 0 < far.sum() <= SELDOM * max(time, len(goals)):
            found += goals.t_first[far].tolist()
    times = np.sort(np.array(found, np.int64))
    alone: I64 = times[np.diff(times, prepend=times[:1] - 2 * BEHIND_NS) > BEHIND_NS]
    return alone


class SetOut(NamedTuple):
    """Outages that begin while motors pull that were just sent somewhere.

    ``behind`` of ``runs`` do, and by ``chance`` as many would; for this ``share`` of the time
    motors pull.
    """

    behind: int
    runs: Sequence[Silence]
    share: float
    chance: float


def set_out(case: Case, servo: int) -> SetOut | None:
    """Return of a servo that its outages begin so; None: they do not, or nobody knows."""
    return case.once(_set_out).get(servo)


def _set_out(case: Case) -> Mapping[int, SetOut]:
    steps = goal_steps(case) if case.has_clock else np.empty(0, np.int64)
    if not len(steps):
        return {}
    # whether the first goal was a step nobody knows
    share = min(len(steps) * BEHIND_NS / max(case.last_ns - int(steps[0]), 1), 1.0)
    found = {}
    for servo in case.answering:
        runs = [run for run in outages(case, servo) if run.first_ns >= steps[0]]
        begun = np.array([run.first_ns for run in runs], np.int64)
        since = np.searchsorted(steps, begun - BEHIND_NS)
        behind = int((np.searchsorted(steps, begun, "right") > since).sum())
        chance = at_least(behind, len(runs), share)
        if len(runs) >= LEAST and behind >= NEARLY * len(runs) and chance <= CHANCE:
            found[servo] = SetOut(behind, runs, share, chance)
    return found
