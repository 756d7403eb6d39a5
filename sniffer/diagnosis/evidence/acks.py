"""What looks like answers to commands that a servo does not answer: it said something unasked."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.diagnosis.ledger.damage import AT_TURN, IN_REPLY
from sniffer.diagnosis.ledger.refusals import OPS
from sniffer.diagnosis.model import Place
from sniffer.ground.distinct import within

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.diagnosis.case import Case

SELDOM: Final = 1 / 3
"""Who answers a command answers nearly all of its likes, for that is a setting: so few are none."""


class Volunteered(NamedTuple):
    """Answers of one servo to commands that it does not answer."""

    n: int
    first_ns: int
    last_ns: int
    places: Sequence[Place]


def seldom_answered(case: Case) -> Mapping[int, Volunteered]:
    """Return by servo its answers to commands of which it answers hardly any.

    Held against what was said while it did, so one that is told to answer from now on is none.
    """
    told, kinds = case.ledger.optional.counted(), case.ledger.exchanges.kinds
    to, op = np.array(kinds.servo_id), np.array(kinds.op) % OPS
    out: dict[int, Volunteered] = {}
    columns = ("servo_id", "op", "n", "at", "length", "t_first", "t_last")
    for servo, of, n, at, length, first, last in zip(
        *(told[name].tolist() for name in columns), strict=True
    ):
        own = kinds.n[to == servo]
        alike = kinds.n[(to == servo) & (op == of)]
        rows = (case.traffic["servo_id"] == servo) & (case.traffic["t_last"] >= first)
        rows &= case.traffic["t_first"] <= last
        meanwhile = int(case.traffic["requests"][rows].sum())
        said = meanwhile * int(alike.sum()) / max(int(own.sum()), 1)
        if n + _torn(case, servo, first, last) > SELDOM * said:
            continue  # who is heard behind most of them answers them, whole or not
        place = Place(at, length, first, "an answer to a command that it does not answer")
        before = out.get(servo, Volunteered(0, first, last, ()))
        out[servo] = Volunteered(
            before.n + n,
            min(before.first_ns, first),
            max(before.last_ns, last),
            (*before.places, place),
        )
    return out


def _torn(case: Case, servo: int, first_ns: int, last_ns: int) -> int:
    """Return how often torn bytes stood where a servo may have answered, in a stretch of time."""
    d = case.damage
    rows = (d["servo_id"] == servo) & within(d["turn"], (IN_REPLY, AT_TURN))
    rows &= (d["t_last"] >= first_ns) & (d["t_first"] <= last_ns)
    return int(d["n"][rows].sum())
