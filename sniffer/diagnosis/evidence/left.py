"""Questions that a servo leaves unanswered from a moment on, while it answers others."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.diagnosis.ledger.keys import slots
from sniffer.ground.codes import NO_RESPONSE

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.exchanges import Failed
    from sniffer.diagnosis.ledger.silences import Silence

PLENTY: Final = 6
"""So many in vain are a habit."""

BETWEEN: Final = 3
"""Stretches in vain, and answers to something else between: who is gone answers nothing."""

OTHERS: Final = 0.02
"""How many others may be missing for each of these: what is lost by chance chooses none."""

CHANCE: Final = math.log(1e-6)
"""How likely it may be that chance chooses just these."""


class Left(NamedTuple):
    """Questions left: their kinds, how often they were asked, and how many others were answered."""

    kinds: tuple[int, ...]
    missed: int
    answered: int
    runs: Sequence[Silence]
    is_from_the_begin: bool


class _Fate(NamedTuple):
    """How often a question had no answer since its last one, and when that was asked."""

    since: int
    had_ns: int
    was_answered: bool


def left_since(case: Case, servo: int) -> Left | None:
    """Return the questions that a servo answers no more, or never did, and all others meanwhile."""
    kinds = case.ledger.exchanges.kinds
    number = slots(np.array(kinds.op, np.int64), np.array(kinds.address, np.int64))
    failed = [f for f in case.ledger.exchanges.failed if f.servo_id == servo and f.kind >= 0]
    lost = [(int(number[f.kind]), f) for f in failed if f.outcome == NO_RESPONSE]
    asked = _asked(case, servo, lost)
    most = max(asked, key=lambda q: asked[q].since, default=None)
    first = next((f for q, f in lost if q == most and f.t_ns > asked[q].had_ns), None)
    if most is None or first is None:
        return None
    left = {q: one for q, one in asked.items() if one.since and one.had_ns < first.t_ns}
    missed = sum(one.since for one in left.values())
    runs = [s for s in case.ledger.silences.runs(servo) if s.last_ns > asked[most].had_ns]
    a = case.answers
    mine = (a["servo_id"] == servo) & (a["t_last"] >= first.t_ns)
    others = int(a["missing"][mine].sum()) - missed
    # who answers in the bucket of the first one did so before it, too
    answered = int(a["ok"][mine & (a["t_first"] >= first.t_ns)].sum())
    is_habit = missed >= PLENTY and min(answered, len(runs)) >= BETWEEN
    if not is_habit or others > OTHERS * missed or _chance(missed, answered) > CHANCE:
        return None
    which = dict.fromkeys(f.kind for q, f in lost if q in left)
    return Left(
        tuple(which), missed, answered, runs, not any(one.was_answered for one in left.values())
    )


def _asked(case: Case, servo: int, lost: Sequence[tuple[int, Failed]]) -> Mapping[int, _Fate]:
    """Return the questions that a servo left unanswered, each by its number."""
    told = case.ledger.silences.questions()
    rows = np.flatnonzero((told["servo_id"] == servo) & (told["missing"] > 0))
    out = {}
    for question, missing, had, had_ns in zip(
        *(told[name][rows].tolist() for name in ("question", "missing", "had", "had_last")),
        strict=True,
    ):
        before = sum(q == question and f.t_ns <= had_ns for q, f in lost)
        out[question] = _Fate(missing - before, had_ns, had > 0)
    return out


def _chance(missed: int, answered: int) -> float:
    """Return the log of how likely just these are missed, where any of all may be."""
    every = missed + answered
    return missed * math.log(missed / every) + answered * math.log(answered / every)
