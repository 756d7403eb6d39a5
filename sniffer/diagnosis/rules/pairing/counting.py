"""Servos that leave out every second request, or all but every third: a count, and no chance."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.model import Finding, Place

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "answers-every-nth",
        "A servo answers every second request, or every third: it counts.",
        "Twenty silences and more, nineteen in twenty of which are of as many requests, with one answer between; each question that it leaves it answers as well.",
        remedy="Wait longer between two requests to this servo (it may be busy with the one before), and ask it from one program alone: two that ask in turns may each get the other's answer.",
        settle="Ask it half as often: if it answers each request then, it needs the time.",
        concerns="",
    ),
)

TURNS: Final = 20
"""So many turns of one length chance has once in a million times where it leaves half of them."""

NEARLY: Final = 0.95
"""Part of the silences that are of one length, and of those behind which one answer stands."""

AS_OFTEN: Final = 1.1
FEW: Final = 2
"""How much more of one question than of all it may leave, and so many times: it does not choose."""


def every_nth(case: Case) -> Iterator[Finding]:
    """Find servos that answer in turns."""
    for servo in case.answering:
        runs = case.ledger.silences.runs(servo)
        if len(runs) < TURNS:
            continue
        missed, often = Counter(run.missed for run in runs).most_common(1)[0]
        asked, missing = case.total("asked", servo), case.total("missing", servo)
        turns = sum(case.ledger.silences.lengths(servo))
        is_in_turns = often >= NEARLY * len(runs) and (asked - missing) * NEARLY <= turns + 1
        if not is_in_turns or _chooses(case, servo, asked):
            continue
        first, last = runs[0], runs[-1]
        yield Finding(
            "answers-every-nth",
            servo,
            first.first_ns,
            last.back_ns or last.first_ns,
            missing,
            f"servo {servo} answers one request of {missed + 1}, in turns: {asked - missing} of {asked}",
            tuple(
                Place(run.at, run.length, run.first_ns, "left out in its turn") for run in runs[:3]
            ),
            brief=f"servo {servo} answers one request of {missed + 1}",
        )


def _chooses(case: Case, servo: int, asked: int) -> bool:
    """Tell whether a servo leaves some questions oftener than it is asked them.

    Args:
        case: what is known of a bus.
        servo: the servo.
        asked: how often it was asked anything.
    """
    left = Counter(f.kind for f in case.ledger.exchanges.failed if f.servo_id == servo)
    n = case.ledger.exchanges.kinds.n
    most = AS_OFTEN * left.total() / asked
    return any(times > most * n[k] + FEW for k, times in left.items())


RULES: Final[tuple[Rule, ...]] = (every_nth,)
"""The rules of this file."""
