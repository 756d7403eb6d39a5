"""Goals that two programs state to one servo in turns."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import may_be_torn
from sniffer.diagnosis.evidence.misaddressed import misaddressed
from sniffer.diagnosis.model import Finding, Place
from sniffer.ground.medians import median
from sniffer.ground.milli import MILLI

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule

ONE_OF_THEM: Final = "Look which programs (nodes, threads, a tool left open) state goals to this servo, and stop all but one."

FINDINGS: Final = (
    FindingCode(
        "goals-in-turns",
        "Goals of a servo jump there and back, again and again: two programs state them in turns.",
        "Two dozen goals and more, a quarter of all in that time, each of which is a hundredth of the range (of a "
        "second's way of the fastest servo, if less) or more from the one before it, and the next one is back to an eighth of that within 0.12 s: no joint goes "
        "there meanwhile. Not where they are the same two places each time.",
        remedy=ONE_OF_THEM,
        settle=ONE_OF_THEM,
    ),
)

SAME: Final = 1 / 8
"""Part of the way between them by which two places differ that are the same each time."""

LEAST: Final = 24
PART: Final = 0.25
"""How many goals are away and back, and which part of all from the first to the last of them: goals
that tremble by chance have one in fourteen."""


def goals_in_turns(case: Case) -> Iterator[Finding]:
    """Find servos whose goals are stated by two."""
    if not case.has_clock or misaddressed(case):
        return
    for servo in case.measured_by("goal_position"):
        for goals in case.every(servo, "goal_position"):
            back = case.ledger.goals_back.of(servo, goals.index)
            if back.n < max(LEAST, PART * back.of) or may_be_torn(case, back.n):
                continue
            pairs = np.sort([(one.value, one.was) for one in back.kept], axis=1)
            size = float(median(pairs[:, 1] - pairs[:, 0])) / MILLI
            if (np.ptp(pairs, axis=0) / MILLI <= SAME * size).all():
                continue  # between two places one program sends it to and fro
            yield Finding(
                "goals-in-turns",
                servo,
                back.first_ns,
                back.last_ns,
                back.n,
                f"{back.n} of {back.of} goals of servo {servo} are away from the one before, by "
                f"{goals.told(size)} in the middle, and the next one is back there",
                tuple(
                    Place(one.at, 1, one.t_ns, "a goal from somebody else") for one in back.kept[:3]
                ),
                strength=min(0.7 + back.n / 200, 1.0),
                brief=f"goals of servo {servo} jump there and back by {goals.told(size)}",
            )


RULES: Final[tuple[Rule, ...]] = (goals_in_turns,)
"""The rules of this file."""
