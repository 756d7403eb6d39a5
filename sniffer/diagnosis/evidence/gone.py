"""What goes with a servo that falls silent: others at that moment, and who waits for its part."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.ledger.silences import MISSING
from sniffer.diagnosis.model import LINE
from sniffer.ground.distinct import within

if TYPE_CHECKING:
    from collections.abc import Sequence, Set

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.silences import Silence
    from sniffer.ground.model import I64

LEAST: Final = 3
"""Servos that chance does not silence at one moment."""

NEARLY_ALL: Final = 0.95
"""Part of what another one lost since, or of what is torn, that must be its: some is chance's."""


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


def taken_along(case: Case, servo: int, last: Silence) -> Sequence[int]:
    """Return whose answers are missing only where a servo that fell silent was asked, too.

    One request asks them all, and each waits for the one before it, or adds to what that one began:
    so ``LINE`` is among them where all that is torn since stands right behind these requests.
    """
    lost = case.anomalies(MISSING, servo_id=servo)
    lost = lost.take(lost.t_ns >= last.first_ns)
    out = []
    for other in case.answering:
        theirs = case.anomalies(MISSING, servo_id=other)
        at = theirs.at[theirs.t_ns >= last.first_ns]
        if other != servo and _are_mostly_of(at, lost.at):
            out.append(other)
    torn = np.array([d.at for d in case.damages if d.t_ns >= last.first_ns], np.int64)
    return [*out, LINE] if _are_mostly_of(torn, lost.at + lost.length) else out


def _are_mostly_of(some: I64, places: I64) -> bool:
    """Tell whether there are places enough, and nearly all among others."""
    return len(some) >= LEAST and float(within(some, places).mean()) >= NEARLY_ALL
