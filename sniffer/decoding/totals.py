"""The totals of a capture that was decoded in parts: those of the parts, added up in order."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from sniffer.decoding.durations import Quantiles
from sniffer.decoding.names import AND
from sniffer.decoding.summary import BusTotals

if TYPE_CHECKING:
    from sniffer.decoding.summary import Summary


def add_totals(whole: Summary, part: Summary) -> None:
    """Add to the totals of a stream those of the part that follows it.

    They are then the same as if all of it had been counted in one go, in their order, too.
    """
    for bus, totals in part.buses.items():
        if bus not in whole.buses:
            whole.buses[bus] = BusTotals(totals.protocol, totals.usual_model)
        _add(whole.buses[bus], totals)
    whole.shown.update(part.shown)
    whole.show(part.worst() if part.shown else None)


def _add(b: BusTotals, more: BusTotals) -> None:
    b.bytes += more.bytes
    b.bytes_in_frames += more.bytes_in_frames
    b.bytes_in_gaps += more.bytes_in_gaps
    b.samples += more.samples
    b.clock = more.clock
    for counter, counted in (
        (b.kinds, more.kinds),
        (b.gaps, more.gaps),
        (b.outcomes, more.outcomes),
        (b.codes, more.codes),
        (b.severities, more.severities),
        (b.by_command, more.by_command),
        (b.bad_by_servo, more.bad_by_servo),
    ):
        counter.update(counted)  # type: ignore[arg-type]
    for code, servos in more.by_servo.items():
        b.by_servo.setdefault(code, Counter()).update(servos)
    for code, anomaly in more.first.items():
        b.first.setdefault(code, anomaly)
    for servo, times in more.times.items():
        b.times.setdefault(servo, Quantiles()).join(times)
    b.models.update(more.models)
    b.heard.join(more.heard)
    for name, part in more.parts.items():
        _add(b.parts.setdefault(name, BusTotals(part.protocol, part.usual_model)), part)
    if b.parts:
        b.protocol = AND.join(sorted(b.parts))
