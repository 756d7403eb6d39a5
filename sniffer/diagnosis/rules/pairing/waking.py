"""Requests that are left unanswered where each is the first one behind a rest of the line."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import at_least
from sniffer.diagnosis.model import Finding, Place
from sniffer.ground.model import NS
from sniffer.ground.wording import counted

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "first-behind-rest",
        "What is left unanswered is what a servo is asked first when the line has rested.",
        "Four rests of a second and more, and nine in ten of the missing answers, are to the first request to a servo behind such a rest, or to those right behind it; chance does not choose them.",
    ),
)

REST_NS: Final = NS
"""No loop rests for so long; adapters, drivers and servos that save power do so after seconds."""

LEAST: Final = 4
NEARLY: Final = 0.9
CHANCE: Final = 1e-6
"""Rests behind which answers are missing, the part of all that are missing which must stand there, and
how likely that may be by chance."""


def first_behind_rest(case: Case) -> Iterator[Finding]:
    """Tell whether all that is missing stands first behind rests."""
    if not case.has_clock:
        return
    silences = case.ledger.silences
    runs = [run for servo in case.answering for run in silences.runs(servo)]
    rested = [run for run in runs if run.first_ns - run.before_ns >= REST_NS]
    missing, first = sum(run.missed for run in runs), sum(run.missed for run in rested)
    rests = case.ledger.exchanges.idle.above(0, REST_NS)
    asked = case.total("asked")
    likely = min((rests + 1) * len(case.answering) / max(asked, 1), 1.0)
    if len(rested) < LEAST or first < NEARLY * missing or at_least(first, missing, likely) > CHANCE:
        return
    rested.sort(key=lambda run: run.first_ns)
    servos = [s for s in case.answering if any(run in rested for run in silences.runs(s))]
    shortest = min(run.first_ns - run.before_ns for run in rested) / NS
    yield Finding(
        "first-behind-rest",
        servos[0] if len(servos) == 1 < len(case.answering) else None,
        rested[0].first_ns,
        rested[-1].first_ns,
        first,
        f"{first} of {missing} missing answers are to what a servo was asked first behind a rest of "
        f"{shortest:.1f} s and more ({counted(len(servos), 'servo')})",
        tuple(
            Place(run.at, run.length, run.first_ns, "the first request behind a rest")
            for run in rested[:3]
        ),
        strength=min(0.6 + len(rested) / 25, 1.0),
        brief="what is asked first behind a rest goes unanswered",
    )


RULES: Final[tuple[Rule, ...]] = (first_behind_rest,)
"""The rules of this file."""
