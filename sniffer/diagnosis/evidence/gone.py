"""Servos that fall silent at one moment, each of them once: what they share went away."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Set

    from sniffer.diagnosis.case import Case

LEAST: Final = 3
"""Servos that chance does not silence at one moment."""


def gone_at_once(case: Case) -> Set[int]:
    """Return the servos that fell silent at one moment, and at no other; none where they are few.

    A servo went between the last request that it answered and the first one that it did not.
    """
    return case.once(_gone_at_once)


def _gone_at_once(case: Case) -> Set[int]:
    silences = case.ledger.silences
    once = {s: runs[0] for s in case.answering if len(runs := silences.runs(s)) == 1}
    groups = (
        {s: run.missed for s, run in once.items() if run.before_ns < one.first_ns <= run.first_ns}
        for one in once.values()
    )
    missed = max(groups, key=len, default={})
    # one request alone is lost on many a line, but not beside others that are gone then
    return frozenset(missed) if sum(n > 1 for n in missed.values()) >= LEAST else frozenset()
