"""Servos that are asked and were never heard, while others answer."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.ledger.silences import ENOUGH
from sniffer.diagnosis.model import Finding, Place
from sniffer.diagnosis.physics.comparing import bits_wrong
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import I64

FINDINGS: Final = (
    FindingCode(
        "never-answered",
        "A servo was asked time and again, and never answered, while others did.",
        "At least five requests with an expected answer, no answer, another servo answered.",
    ),
)

LOOKS: Final = 3
"""Quarters of a second in which an id is asked for that is not just looked for."""

SWEEP: Final = 5
"""Ids without a servo, asked about alike: somebody looks who is there."""

MOSTLY: Final = 0.8
"""Part of the requests to a servo that is not there which have no answer: behind some stands what
noise or a hole leaves of others."""

MEANT: Final = 20
"""How many times as often a request was said of which one bit was misread where another one is heard."""


def never_answered(case: Case) -> Iterator[Finding]:
    """Servos that are asked and were never heard; looking for servos is none of that."""
    a = case.answers
    if not case.answering:
        return
    absent: dict[int, I64] = {}
    for servo in case.servos:
        rows = np.flatnonzero(a["servo_id"] == servo)
        asked, missing = int(a["asked"][rows].sum()), int(a["missing"][rows].sum())
        if missing and missing >= MOSTLY * asked and servo not in case.ledger.silences.heard:
            absent[servo] = rows
    counts = [int(a["missing"][rows].sum()) for rows in absent.values()]
    is_sweep = len(absent) >= SWEEP and max(counts) <= 2 * min(counts) + 1
    for servo, rows in absent.items():
        missing = int(a["missing"][rows].sum())
        first, last = int(a["t_first"][rows].min()), int(a["t_last"][rows].max())
        asked_along = len(rows) >= LOOKS or last - first > NS
        if not case.has_clock:  # counted from the bytes, a quarter second is anything
            asked_along |= 2 * (last - first) > case.last_ns - case.first_ns
        if missing < ENOUGH or is_sweep or not asked_along or _is_misread(case, servo):
            continue
        yield Finding(
            "never-answered",
            servo,
            first,
            last,
            missing,
            f"servo {servo} was asked {missing} times and never answered",
            (Place(int(a["at"][rows[0]]), 1, int(a["t_first"][rows[0]]), "the first request"),),
            brief=f"servo {servo} never answers ({missing} requests)",
        )


def _is_misread(case: Case, servo: int) -> bool:
    """Tell whether all that a servo is asked may be what others are asked, with one bit misread.

    What has no checksum holds all the same; and where that happens, other bits tear frames.
    """
    kinds = case.ledger.exchanges.kinds
    mine = [k for k in range(len(kinds)) if kinds.servo_id[k] == servo]
    if not mine or int(case.damage["n"].sum()) < int(kinds.n[mine].sum()):
        return False  # none of its own: who is named in lists alone is meant there
    others = [k for k in range(len(kinds)) if kinds.servo_id[k] in case.answering]
    return all(
        case.protocol.checksum_of(kinds.example[k]) is None
        and any(
            kinds.n[q] >= MEANT * kinds.n[k]
            and len(kinds.example[q]) == len(kinds.example[k])
            and bits_wrong(kinds.example[q], kinds.example[k]) == 1
            for q in others
        )
        for k in mine
    )


RULES: Final[tuple[Rule, ...]] = (never_answered,)
"""The rules of this file."""
