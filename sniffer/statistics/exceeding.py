"""How long servos met rules of the user's own (``anomalies/alarms.py``), within bounds.

Nobody knows when between two values a limit was crossed. So a time is counted at least from the
first to the last value of a run that meets the rule, at most from the value before to the one
behind.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sniffer.anomalies.alarms import OPERATORS, meant
from sniffer.anomalies.thresholds import ThresholdWatch, taken, usable
from sniffer.ground.distinct import distinct
from sniffer.statistics.figures import Extreme

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.anomalies.alarms import Alarm, Meant
    from sniffer.anomalies.thresholds import JudgedValues
    from sniffer.ground.model import Batch, Mask
    from sniffer.protocols.base import BusProtocol


@dataclass(slots=True)
class ExceedingFigures:
    """One rule and one servo: times in ns, ``count`` values of which ``met`` meet the rule.

    ``spans`` are runs of such values, ``first`` and ``last`` the ends of them; ``worst`` the value
    furthest beyond the limit, None where the rule knows no side (``==``, ``!=``) or none meets it.
    ``heard_ns`` is from the first value to the last one.
    """

    rule: str
    servo_id: int
    unit: str
    count: int = 0
    met: int = 0
    spans: int = 0
    least_ns: int = 0
    most_ns: int = 0
    heard_ns: int = 0
    first: Extreme | None = None
    last: Extreme | None = None
    worst: Extreme | None = None


class _Exceeding:
    """One rule, for all servos of a bus."""

    def __init__(self, alarm: Alarm, what: Meant, protocol: BusProtocol) -> None:
        self.alarm = alarm
        self._unit = what.unit
        self._is_met: Any = OPERATORS[alarm.op]
        self._watch = ThresholdWatch(alarm, what, protocol)
        self._last: dict[int, tuple[int, bool]] = {}
        self.figures: dict[int, ExceedingFigures] = {}

    def add(self, batch: Batch, told: Mask) -> None:
        found = self._watch.judged(batch, told)
        for who in distinct(found.servo)[0].tolist():
            self._count(who, taken(found, found.servo == who), batch)

    def _count(self, who: int, found: JudgedValues, batch: Batch) -> None:
        met: Mask = self._is_met(found.value, self.alarm.limit)
        mine = self.figures.setdefault(who, ExceedingFigures(str(self.alarm), who, self._unit))
        mine.count += len(met)
        mine.met += int(met.sum())
        t_first, was = self._last.get(who, (int(found.t_ns[0]), False))
        took = np.diff(found.t_ns, prepend=t_first)
        before = np.concatenate([[was], met[:-1]])
        mine.heard_ns += int(took.sum())
        mine.least_ns += int(took[met & before].sum())
        mine.most_ns += int(took[met | before].sum())
        mine.spans += int((met & ~before).sum())
        self._last[who] = int(found.t_ns[-1]), bool(met[-1])
        if not met.any():
            return

        def said(k: int) -> Extreme:
            at = batch.base + int(batch.frames.start[found.row[k]])
            return Extreme(float(found.value[k]), int(found.t_ns[k]), at)

        rows = np.flatnonzero(met)
        mine.first, mine.last = mine.first or said(int(rows[0])), said(int(rows[-1]))
        if sign := {">": 1, "<": -1}.get(self.alarm.op[0], 0):
            worst = said(int((sign * found.value).argmax()))
            if mine.worst is None or sign * worst.value > sign * mine.worst.value:
                mine.worst = worst


class Exceedings:
    """Times of all rules of the user's on one bus; ``for`` in a rule says nothing here."""

    def __init__(self, protocol: BusProtocol, alarms: Sequence[Alarm]) -> None:
        told = [(alarm, meant(alarm, protocol.registers)) for alarm in dict.fromkeys(alarms)]
        self._rules = [_Exceeding(alarm, what, protocol) for alarm, what in told if what]
        self._heard: set[int] = set()

    def asked(self) -> set[str]:
        """Return the rules that are about servos which were heard."""
        whose = {str(rule.alarm): rule.alarm.servo_id for rule in self._rules}
        return {rule for rule, who in whose.items() if who is None or who in self._heard}

    def add(self, batch: Batch) -> None:
        """Count a batch in."""
        if self._rules:
            self._heard.update(distinct(batch.frames.servo_id)[0].tolist())
            told = usable(batch)
            for rule in self._rules:
                rule.add(batch, told)

    def figures(self) -> list[ExceedingFigures]:
        """Return them rule by rule, the servo that met it longest first."""
        return [
            each
            for rule in self._rules
            for each in sorted(rule.figures.values(), key=lambda e: (-e.most_ns, e.servo_id))
        ]
