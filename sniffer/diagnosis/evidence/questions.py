"""Captures that end in one question, said again and again: of them nobody knows who is silent."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.ledger.exchanges import KEPT

if TYPE_CHECKING:
    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.silences import Silence

AGAIN: Final = 3
"""Times that a question was left before."""

LONGER: Final = 3
"""A servo is gone that is silent so many times as long as ever, though asked what it answered."""


def is_one_question(case: Case, servo: int, last: Silence) -> bool:
    """Tell whether a servo is asked nothing to the end but what it left unanswered before.

    A capture that ends in a storm of retries says nothing of the servo.
    """
    kept = case.ledger.exchanges.failed
    failed = [f for f in kept if f.servo_id == servo]
    ending = sum(f.at >= last.at for f in failed)
    if len({f.kind for f in failed}) != 1 or len(failed) - ending < AGAIN:
        return False
    longest = max((s.missed for s in case.ledger.silences.runs(servo)), default=0)
    answered = int(case.ledger.exchanges.kinds.n[failed[0].kind]) - len(failed)
    if answered >= len(failed) - ending and last.missed > LONGER * longest:
        return False  # it answered that question, and was never away for so long
    if len(kept) == KEPT:  # later ones are not known: it came back from as many before
        return last.missed <= longest
    return ending >= last.missed - 1  # what became of the very last request is not told yet
