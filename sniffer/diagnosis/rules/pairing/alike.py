"""What all servos miss alike: then it is what they share, and no fault of each of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.model import Finding, Place

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule

WHAT_THEY_SHARE: Final = (
    "Look at what all servos share: the controller's baud rate (a few per cent off?), its level and the "
    "ground at the far end of the cable, its time-out. A tap beside a servo hears what servos hear."
)

FINDINGS: Final = (
    FindingCode(
        "all-miss-alike",
        "All servos leave requests unanswered now and then, one as often as the other, and hardly anything is torn.",
        "Two servos and more, twenty missing answers and more, five of each; no servo misses more or fewer than chance gives, silences are as short as chance makes them, and at most a tenth as many places are torn as answers are missing.",
        remedy=WHAT_THEY_SHARE,
        settle=WHAT_THEY_SHARE,
    ),
)

LEAST, EACH = 20, 5
"""Missing answers, and those of each servo, from which on rates can be compared."""

MOST: Final = 0.5
"""Part of the requests that may be missing: who misses more is mostly away."""

DEVIATIONS: Final = 3.0
"""How far from what chance gives the servos may be apart."""

LONGER: Final = 1.2
"""How many times longer than by chance the stretches without an answer may be."""

TORN: Final = 0.1
"""Torn places for each missing answer: where more is torn, who tears it leaves other signs."""


def all_miss_alike(case: Case) -> Iterator[Finding]:
    """Tell whether chance alone chooses whose answers are missing."""
    servos = [s for s in case.answering if case.total("asked", s)]
    missing = np.array([case.total("missing", s) for s in servos])
    asked = np.array([case.total("asked", s) for s in servos])
    total = int(missing.sum())
    if len(servos) < 2 or total < LEAST or missing.min() < EACH:
        return
    share = total / int(asked.sum())
    if share > MOST or len(case.damages) > TORN * total:
        return
    spread = float(((missing - share * asked) ** 2 / (share * (1 - share) * asked)).sum())
    free = len(servos) - 1
    if spread > free + DEVIATIONS * (2 * free) ** 0.5:
        return
    silences = case.ledger.silences
    if any(s.back_ns is None for servo in servos for s in silences.of(servo)):
        return
    in_a_row = sum(sum(silences.lengths(s)) for s in servos)
    if total * (1 - share) > in_a_row * LONGER:
        return  # who misses one by chance has the next one as often as any
    lost = case.anomalies("no-response")
    yield Finding(
        "all-miss-alike",
        None,
        int(lost.t_ns.min()),
        int(lost.t_ns.max()),
        total,
        f"{total} of {int(asked.sum())} answers are missing, of all {len(servos)} servos alike "
        f"({100 * min(missing / asked):.1f} to {100 * max(missing / asked):.1f} %), one by one, and "
        f"{len(case.damages) or 'nothing'} is torn",
        tuple(
            Place(at, n, t, "no answer")
            for at, n, t in zip(
                lost.at[:3].tolist(), lost.length[:3].tolist(), lost.t_ns[:3].tolist(), strict=True
            )
        ),
        brief=f"all {len(servos)} servos miss requests alike",
    )


RULES: Final[tuple[Rule, ...]] = (all_miss_alike,)
"""The rules of this file."""
