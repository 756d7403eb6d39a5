"""How fast a program goes around a pause: what its rests usually are, and whether there was one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.case import BUCKET_NS
from sniffer.diagnosis.evidence.cycles import ALIKE
from sniffer.ground.medians import median, quantile
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.exchanges import Pause

AROUND_NS: Final = 4 * NS
MOSTLY: Final = 0.7
"""What is usual around a pause: what most of so much time on each side has at most."""

SIDE: Final = 4
"""Quarter seconds that tell what was usual before a pause, or behind it."""

AT_ONCE: Final = 64
"""Requests that are looked at behind a pause."""

PACES: Final = 4
"""How many times as long as on the other side the rests on one side of a pause mostly are where a
program does something else behind it."""

ITS_KIND: Final = 0.25
"""Part of the pause that the rests of what takes its time have at least."""


def rests_of(case: Case) -> Sequence[Pause]:
    """Return the longest pauses, each less what the stamps behind it are late by.

    A line carries no more bytes than its rate. Where more stand behind a pause, with one stamp or
    hardly later ones, they were held up, and were said in the pause. What stands so behind most of
    the pauses is how a program hands its requests over.
    """
    return case.once(_rests)


def _rests(case: Case) -> Sequence[Pause]:
    exchanges = case.ledger.exchanges
    pauses = exchanges.pauses
    asked = np.array([len(example) for example in exchanges.kinds.example], np.int64)
    told = np.flatnonzero(exchanges.answer_lengths)
    answered = [exchanges.turns.count(k) > 0 for k in range(len(asked))]
    size = asked + (int(told[0]) if len(told) else 0) * np.array(answered, np.int64)
    late = np.zeros(len(pauses), np.int64)
    for t, kind in exchanges.moments.stretches():
        said = np.concatenate([[0], np.cumsum(np.where(kind >= 0, size[kind], 0))[:-1]])
        ahead = said * case.ledger.byte_ns - t
        rows = np.searchsorted(t, [p.t_ns + p.sure_ns for p in pauses])
        for n, row in enumerate(rows.tolist()):
            if 0 < row < len(t):
                late[n] = int(ahead[row : row + AT_ONCE].max() - ahead[row])
    usual = int(median(late)) if len(late) else 0
    return [
        p._replace(sure_ns=p.sure_ns - max(by - usual, 0))
        for p, by in zip(pauses, late.tolist(), strict=True)
    ]


def usual_around(case: Case, pause: Pause) -> float:
    """Return how long the longest rests of the quarter seconds around a pause mostly are, in ns.

    A program that does one thing, then another, has another cycle there.
    """
    line = case.line
    first = np.searchsorted(line["bucket"], (pause.t_ns - AROUND_NS) // BUCKET_NS)
    last = (pause.t_ns + pause.sure_ns + AROUND_NS) // BUCKET_NS
    rests = line["pause_max"][first : np.searchsorted(line["bucket"], last, "right")]
    rests = rests[rests > 0]
    return float(quantile(rests, MOSTLY)) if len(rests) else 0.0


def is_of_slower_loop(case: Case, pause: Pause) -> bool:
    """Tell whether a pause is as long as those before it mostly are, or as those behind it.

    The last rest before a program goes on faster is, and has only that on its other side.
    """
    longest = max(_on_each_side(case, pause, MOSTLY), default=0)
    return longest >= (1 - ALIKE) * pause.sure_ns - 2 * case.latency_ns


def is_between_paces(case: Case, pause: Pause) -> bool:
    """Tell whether a pause stands between a fast loop and what takes its time."""
    usual = _on_each_side(case, pause, 0.5)  # of a few, long ones are no pace
    if len(usual) < 2 or max(usual) < ITS_KIND * pause.sure_ns:
        return False  # a loop that catches up behind a stall is faster, too, and rests for no time
    return max(usual) > PACES * min(usual) + 2 * case.latency_ns


def _on_each_side(case: Case, pause: Pause, share: float) -> Sequence[float]:
    """Return what such a share of the rests before a pause has at most, and of those behind it."""
    line = case.line
    begin, end = pause.t_ns, pause.t_ns + pause.sure_ns + 2 * case.latency_ns
    edges = np.array([begin - AROUND_NS, begin, end, end + AROUND_NS]) // BUCKET_NS + (0, 1, 1, 1)
    first, until, since, last = np.searchsorted(line["bucket"], edges)  # a rest is where it ends
    sides = line["pause_max"][first:until], line["pause_max"][since:last]
    return [float(quantile(s[s > 0], share)) for s in sides if (s > 0).sum() >= SIDE]
