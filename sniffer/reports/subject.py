"""What rules are held to: a capture that was heard, and figures of it within bounds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.decoding.summary import Summary
    from sniffer.diagnosis.model import Incident
    from sniffer.reports.rules import Rule
    from sniffer.statistics.collector import Collector
    from sniffer.statistics.figures import ServoFigures


class Figure(NamedTuple):
    """A figure within bounds, what it is in words, and whose it is (-1: nobody's)."""

    low: float
    high: float
    told: str
    servo: int = -1


@dataclass(frozen=True, slots=True)
class Subject:
    """A capture after it was heard to its end, as far as rules ask for it."""

    summary: Summary
    collector: Collector
    incidents: Sequence[Incident]


def servos_of(rule: Rule, heard: Subject) -> Iterator[tuple[str, int, ServoFigures]]:
    """Yield the servos that a rule is about."""
    lanes = heard.collector.lanes
    for lane, servo, mine in heard.collector.servos():
        if rule.bus in ("", lane, lanes[lane].bus) and (not rule.servos or servo in rule.servos):
            yield lane, servo, mine


def name_of(heard: Subject, lane: str, servo: int) -> str:
    """Return a servo in words, with its bus where there are several."""
    told = heard.summary.names.servo(lane, servo)
    return f"{lane} {told}" if len(heard.collector.lanes) > 1 else told
