"""Requests that one servo misses one by one: the very same ones that it else answers."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.placed import silent
from sniffer.ground.codes import NO_RESPONSE

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.model import Finding
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "same-request-missed",
        "A servo leaves a request unanswered now and then, and answers the very same one before and behind.",
        "Six requests and more of which no byte ever changes, each time it was left unanswered: half of them and more with an answer to it since the last one.",
    ),
    FindingCode(
        "missed-one-by-one",
        "A servo misses requests one by one: as many in a row as chance makes.",
        "Twenty stretches and more, two of them of several requests; these are as many as there are where each request is missed by itself, within two standard deviations. What is away for a time that is always the same has both only where that is just the time between two requests.",
    ),
)

LEAST: Final = 6
"""Requests from which on it is a habit."""

MOSTLY: Final = 0.5
"""Part of them between which the same request was answered: some are missed in a row."""

PLENTY: Final = 12
"""So many tell in full."""

STRETCHES: Final = 20
SEVERAL: Final = 2
"""Stretches, and such of several requests, from which on their lengths tell."""

DEVIATIONS: Final = 2.0


def same_request(case: Case) -> Iterator[Finding]:
    """Find servos that miss now and then what they else answer."""
    for servo in case.answering:
        missed, between = _missed(case, servo)
        runs = case.ledger.silences.runs(servo)
        if not runs or missed < LEAST or between < MOSTLY * missed:
            continue
        yield silent(
            "same-request-missed",
            servo,
            runs,
            f"servo {servo} left {missed} requests unanswered, and answered the very same ones "
            f"between {between} of them",
            min(missed / PLENTY, 1.0),
        )


def _missed(case: Case, servo: int) -> tuple[int, int]:
    """Return how many requests that are always the same a servo missed, and how many again.

    Again: it answered that request since it missed the last one.
    """
    exchanges = case.ledger.exchanges
    kinds = exchanges.kinds
    failed = [f for f in exchanges.failed if f.servo_id == servo and f.outcome == NO_RESPONSE]
    missed = answered = 0
    for kind in {f.kind for f in failed if f.kind >= 0 and kinds.are_alike[f.kind]}:
        lost = np.array([f.t_ns for f in failed if f.kind == kind])
        for t, said in exchanges.moments.stretches():
            mine = t[said == kind]
            row = np.searchsorted(mine, lost[(lost > t[0]) & (lost < t[-1])])
            missed += len(row)
            answered += int(np.count_nonzero(np.diff(row, prepend=0) > 1))
    return missed, answered


def one_by_one(case: Case) -> Iterator[Finding]:
    """Find servos whose stretches of missed requests are of the lengths that chance makes."""
    for servo in case.answering:
        lengths = case.ledger.silences.lengths(servo)
        stretches, several = sum(lengths), sum(lengths[1:])
        if stretches < STRETCHES or several < SEVERAL:
            continue
        due = stretches * case.total("missing", servo) / case.total("asked", servo)
        if abs(several - due) > DEVIATIONS * math.sqrt(due):
            continue
        yield silent(
            "missed-one-by-one",
            servo,
            case.ledger.silences.runs(servo),
            f"of {stretches} stretches in which servo {servo} answered nothing {several} are of "
            f"several requests, and {due:.1f} would be by chance",
            1.0,
        )


RULES: Final[tuple[Rule, ...]] = (same_request, one_by_one)
"""The rules of this file."""
