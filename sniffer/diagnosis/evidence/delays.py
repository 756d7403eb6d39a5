"""How soon each servo answers, as its sound answers are stamped."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sniffer.diagnosis.case import Case


class Delay(NamedTuple):
    """From the end of a request to the beginning of its answer: on average, and at most."""

    mean_ns: float
    latest_ns: int


def delays(case: Case) -> Mapping[int, Delay]:
    """Return the delays of the servos of which answers were timed; none where nothing is."""
    return case.once(_delays)


def _delays(case: Case) -> Mapping[int, Delay]:
    a = case.answers
    out = {}
    for servo in case.answering if case.has_clock else ():
        mine = np.flatnonzero((a["servo_id"] == servo) & (a["took_n"] > 0))
        if len(mine):
            n, total = int(a["took_n"][mine].sum()), int(a["took_sum"][mine].sum())
            out[servo] = Delay(total / n, int(a["told_max"][mine].max()))
    return out
