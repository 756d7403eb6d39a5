"""What one fault did, told as a story, with what speaks against its rival and what to do next."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.acting import next_of
from sniffer.diagnosis.causes import CAUSES
from sniffer.diagnosis.gathering import steps
from sniffer.diagnosis.model import Incident
from sniffer.diagnosis.weighing import explain
from sniffer.diagnosis.weights import WEIGHTS
from sniffer.ground.model import NS
from sniffer.ground.wording import servos

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.model import Finding, Ranked
    from sniffer.diagnosis.weighing import Explained

LOOKS_SO: Final = 0.1
"""What counts no more for a cause only looks so in what it has torn: it is no step of a story."""

TOLD: Final = 5
"""Findings that a story has."""

AHEAD_NS: Final = MappingProxyType(
    dict.fromkeys(("voltage-sag", "load-high", "load-high-and-still", "temperature-high"), NS // 4)
)
"""What is measured may be polled a little later than the servo complains of it: it comes first."""


def told(case: Case, found: Sequence[Finding]) -> list[Incident]:
    """Return what the findings of a bus come to: an incident a cause, none numbered yet."""
    return [_made(case, explained, found) for explained in explain(found)]


def _made(case: Case, explained: Explained, found: Sequence[Finding]) -> Incident:
    first, *others = explained.causes
    cause = CAUSES[first.cause]
    rival = others[0] if others else None
    by_time = tuple(sorted(explained.findings, key=lambda f: (f.first_ns, f.code)))
    return Incident(
        0,
        cause.severity,
        case.bus,
        explained.servo_ids,
        min(f.first_ns for f in by_time),
        max(f.last_ns for f in by_time),
        explained.key.count,
        explained.causes,
        by_time,
        _story(explained, by_time),
        "" if rival is None else _against(rival, found),
        next_of(case, explained),
    )


def _story(explained: Explained, by_time: Sequence[Finding]) -> str:
    """Return what happened, in order."""
    cause = CAUSES[explained.causes[0].cause]
    who = servos(explained.servo_ids)
    title = f"{cause.title} ({who})" if who else cause.title
    in_order = sorted(by_time, key=lambda f: f.first_ns - AHEAD_NS.get(f.code, 0))
    side = {w.finding for w in WEIGHTS[cause.slug].values() if w.weight <= LOOKS_SO}
    telling = [f for f in in_order if f.code not in side] or in_order
    told = steps(telling)[:TOLD]
    return f"{title}: {' -> '.join(told)}" if told else f"{title}: {explained.key.what}"


def _against(rival: Ranked, found: Sequence[Finding]) -> str:
    """Say what speaks against a cause: the finding that does, or the one that is missing."""
    title = CAUSES[rival.cause].title
    worst = min(rival.reasons, key=lambda r: r.weight, default=None)
    if worst is not None and worst.weight < 0:
        return f"against {title}: {worst.reason}"
    there = {f.code for f in found}
    missing = [w for w in WEIGHTS[rival.cause].values() if w.weight > 0 and w.finding not in there]
    if missing:
        most = max(missing, key=lambda w: w.weight)
        return f"against {title}: no {most.finding} ({most.reason})"
    return f"{title} explains less of it"
