"""What is left when causes have taken what they explain: it is said, not kept quiet."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.rules.symptoms import MISSING, SILENT
from sniffer.diagnostics.catalogue import CATALOGUE
from sniffer.ground.model import Severity

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.model import Incident

SHOWN: Final = 6
"""Servos that are named of one code."""


def rest_of(cases: Sequence[Case], incidents: Iterable[Incident]) -> str:
    """Return the warnings and errors of codes that no incident of their bus has, in words.

    Empty where there are none. A few lost answers among many have no cause that could be told: a
    capture with them is not one in which nothing is wrong.
    """
    explained = {(i.bus, f.code) for i in incidents for f in i.findings}
    told = []
    for case in cases:
        counts: dict[str, dict[int, int]] = defaultdict(lambda: defaultdict(int))
        alarms = case.alarms
        for row in range(len(alarms["n"])):
            code, servo = case.code(int(alarms["code"][row])), int(alarms["servo_id"][row])
            if code == MISSING and servo not in case.answering:
                continue  # who looks for servos asks ids that there are not
            if CATALOGUE[code].severity >= Severity.WARN and code not in SILENT:
                counts[code][servo] += int(alarms["n"][row])
        for servo in case.answering:  # who was not there yet did not lose an answer
            late = case.ledger.silences.late(servo)
            if late is not None and servo in counts[MISSING]:
                counts[MISSING][servo] -= late.missed
                if counts[MISSING][servo] <= 0:
                    del counts[MISSING][servo]
        of_bus = f" on {case.bus}" if len(cases) > 1 else ""
        for code, by_servo in sorted(counts.items(), key=lambda e: -sum(e[1].values())):
            if by_servo and (case.bus, code) not in explained:
                n = int(np.sum(list(by_servo.values())))
                told.append(f"{n} x {code}{_whose(sorted(by_servo))}{of_bus}")
    return ", ".join(told)


def _whose(servos: Sequence[int]) -> str:
    known = [str(s) for s in servos if s >= 0]
    if not known:
        return ""
    more = f" and {len(known) - SHOWN} more" if len(known) > SHOWN else ""
    return f" (servo{'' if len(known) == 1 else 's'} {', '.join(known[:SHOWN])}{more})"
