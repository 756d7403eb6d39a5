"""Anomalies as findings: one for each code and servo, with the places of the first of them.

What servos complain of themselves has a rule of its own (``complaints``).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.anomalies.catalogue import CATALOGUE
from sniffer.anomalies.found import NUMBER
from sniffer.diagnosis.case import episodes
from sniffer.diagnosis.evidence.misaddressed import misaddressed
from sniffer.diagnosis.evidence.twins import twins
from sniffer.diagnosis.ledger.buckets import SERVOS
from sniffer.diagnosis.ledger.silences import MISSING
from sniffer.diagnosis.model import Finding
from sniffer.diagnosis.rules.device.complaints import COMPLAINTS
from sniffer.ground.distinct import numbers

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case

SILENT: Final = frozenset(
    {"capture-start", "capture-end", "clock-step", "late-read", "reordered", "model-evidence"}
)
"""Codes that tell nothing of a fault."""

SECOND: Final = "duplicate-response"
"""Where two servos share an id, and the second answers when the next servo was asked already, this is
said of the next one's answer: the fault is not that one's."""

BEYOND: Final = "value-out-of-range"
"""Where items of a command are misread, what they state is no servo's value."""

GONE: Final = "port-lost"
"""The port went away: where it came back, bytes between were lost."""

ONCE: Final = {"adapter-echo": "every request is heard twice, byte for byte (adapter-echo)"}
"""What is told once, however often it is so: the number of times would say nothing."""

PLENTY: Final = 20
"""So many of one kind are beyond doubt; one alone has half the weight."""


def symptoms(case: Case) -> Iterator[Finding]:
    """Return what the decoder reported, by code and servo."""
    alarms = case.alarms
    of_whom = {s: servo for servo, twin in twins(case).items() for s in twin.before}
    of_nobody = (alarms["code"] == NUMBER[BEYOND]) & bool(misaddressed(case))
    key = alarms["code"] * SERVOS + np.where(of_nobody, -1, alarms["servo_id"]) + 1
    for one in numbers(key).tolist():
        rows = np.flatnonzero(key == one)
        code, servo = case.code(one // SERVOS), one % SERVOS - 1
        if code in SILENT or code in COMPLAINTS:
            continue
        if code == GONE and alarms["t_first"][rows].min() >= case.last_ns:
            continue  # nothing was said behind it that could be lost
        count = int(alarms["n"][rows].sum())
        spans = episodes(alarms["t_first"][rows], alarms["t_last"][rows])
        who = None if servo < 0 else servo
        of = "" if who is None else f" of servo {who}"
        whose = of_whom.get(servo) if code == SECOND else None
        if whose is not None:
            who, of = whose, f" in exchanges with servo {servo}"
        known = CATALOGUE[code]
        # beside servos that answer, who was never heard is not there: nobody lost its answers
        is_absent = (
            code == MISSING and bool(case.answering) and servo not in case.ledger.silences.heard
        )
        yield Finding(
            code,
            who,
            spans[0][0],
            max(last for _, last in spans),
            count,
            ONCE.get(code, f"{count} x {code}{of}"),
            case.places(
                case.anomalies(code, servo_id=None if of_nobody[rows[0]] else servo),
                f"{code}{of}: {known.means}",
                2,
            ),
            strength=0.5 + 0.5 * min(count / PLENTY, 1.0),
            episodes=spans,
            is_own=is_absent,
        )
