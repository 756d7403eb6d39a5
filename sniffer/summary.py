"""Running totals of a decode, in constant memory: bytes, frames, outcomes, anomalies, times."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.model import (
    I64,
    KINDS,
    NS,
    OK,
    OUTCOMES,
    PROVENANCES,
    Anomaly,
    Batch,
    Severity,
)

if TYPE_CHECKING:
    from sniffer.protocols.base import BusProtocol

_PER_OCTAVE: Final = 32
_BINS: Final = 64 * _PER_OCTAVE


class Quantiles:
    """Quantiles of durations to 2 % in fixed memory: a histogram of their logarithms."""

    def __init__(self) -> None:
        self._bins = np.zeros(_BINS, np.int64)
        self.count = 0
        self.least: int | None = None
        self.most: int | None = None

    def add(self, ns: I64) -> None:
        """Count durations, in ns; negative ones are not known and left out."""
        ns = ns[ns >= 0]
        if not len(ns):
            return
        at = np.log2(np.maximum(ns, 1)) * _PER_OCTAVE
        self._bins += np.bincount(at.astype(np.int64), minlength=_BINS)
        self.count += len(ns)
        low, high = int(ns.min()), int(ns.max())
        self.least = low if self.least is None else min(self.least, low)
        self.most = high if self.most is None else max(self.most, high)

    def at(self, share: float) -> int | None:
        """Return the duration that ``share`` of all stay below, in ns."""
        if self.least is None or self.most is None:
            return None
        wanted = share * self.count
        k = int(np.searchsorted(np.cumsum(self._bins), wanted))
        middle = 2 ** ((k + 0.5) / _PER_OCTAVE)
        return int(min(max(middle, self.least), self.most))


@dataclass(slots=True)
class BusTotals:
    """Totals of one bus."""

    protocol: str
    bytes: int = 0
    bytes_in_frames: int = 0
    kinds: Counter[str] = field(default_factory=Counter)
    gaps: Counter[str] = field(default_factory=Counter)
    bytes_in_gaps: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    codes: Counter[str] = field(default_factory=Counter)
    severities: Counter[Severity] = field(default_factory=Counter)
    by_command: Counter[tuple[int, str, str]] = field(default_factory=Counter)
    """(servo id, command, kind) -> frames; servo -1 is none."""
    bad_by_servo: Counter[int] = field(default_factory=Counter)
    times: dict[int, Quantiles] = field(default_factory=dict)
    blur: dict[int, int] = field(default_factory=dict)
    """Servo id -> what a reply time of zero may be at most, in ns: one read held it all."""
    samples: int = 0
    first: dict[str, Anomaly] = field(default_factory=dict)
    models: dict[int, tuple[str, int]] = field(default_factory=dict)
    """Servo id -> model and grounds (a provenance), where it was named or the wire showed it."""
    clock: str = "none"
    t_first_ns: int | None = None
    t_last_ns: int | None = None
    _ops: dict[int, str] = field(default_factory=dict)

    def add(self, protocol: BusProtocol, batch: Batch) -> None:
        """Count a batch in."""
        f, t = batch.frames, batch.transactions
        self.bytes += len(batch.data)
        self.clock = batch.clock.name.lower()
        self.samples += int(batch.values.accepted.sum())
        for g in batch.gaps:
            self.gaps[g.reason] += 1
            self.bytes_in_gaps += g.length
        for a in batch.anomalies:
            self.codes[a.code] += 1
            self.severities[a.severity] += 1
            self.first.setdefault(a.code, a)
        if not len(f):
            return
        self.models.update(batch.models)
        self.bytes_in_frames += int(f.length.sum())
        if self.t_first_ns is None:
            self.t_first_ns = int(f.t_start[0])
        self.t_last_ns = int(f.t_end[-1])
        for kind, n in zip(KINDS, np.bincount(f.kind, minlength=len(KINDS)).tolist(), strict=True):
            self.kinds[kind] += n
        for outcome, n in zip(
            OUTCOMES, np.bincount(t.outcome, minlength=len(OUTCOMES)).tolist(), strict=True
        ):
            self.outcomes[outcome] += n
        self._count_commands(protocol, batch)
        self._count_times(batch)

    def _count_commands(self, protocol: BusProtocol, batch: Batch) -> None:
        f = batch.frames
        ops, which = np.unique(f.op, return_inverse=True)
        key = (which.astype(np.int64) << 20) | ((f.servo_id.astype(np.int64) + 2) << 1) | f.kind
        found, counts = np.unique(key, return_counts=True)
        for k, n in zip(found.tolist(), counts.tolist(), strict=True):
            op = int(ops[k >> 20])
            name = self._ops.get(op) or self._ops.setdefault(op, protocol.op_name(op))
            self.by_command[(k >> 1 & 0x7FFFF) - 2, name, KINDS[k & 1]] += n

    def _count_times(self, batch: Batch) -> None:
        f, t = batch.frames, batch.transactions
        asked = t.request >= 0
        missing = asked & (t.outcome != OK) & (OUTCOMES.index("not_expected") != t.outcome)
        self.bad_by_servo.update(f.servo_id[t.request[missing]].tolist())
        known = (t.outcome == OK) & (t.response_time_ns >= 0)
        if not known.any():
            return
        servo = f.servo_id[t.response[known]]
        took = t.response_time_ns[known]
        blur = np.where(took == 0, t.uncertainty_ns[known], 0)
        for who in np.unique(servo).tolist():
            mine = servo == who
            self.times.setdefault(who, Quantiles()).add(took[mine])
            self.blur[who] = max(self.blur.get(who, 0), int(blur[mine].max()))

    @property
    def seconds(self) -> float | None:
        """Length of the capture by its own clock; None where it has none."""
        if self.clock == "none" or self.t_first_ns is None or self.t_last_ns is None:
            return None
        return (self.t_last_ns - self.t_first_ns) / NS


class Summary:
    """Totals of all buses of one decode."""

    def __init__(self) -> None:
        self.buses: dict[str, BusTotals] = {}

    def add(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Count a batch in."""
        if bus not in self.buses:
            self.buses[bus] = BusTotals(protocol.name)
        self.buses[bus].add(protocol, batch)

    def worst(self) -> Severity | None:
        """Return the highest severity met."""
        return max((s for b in self.buses.values() for s in b.severities), default=None)

    def as_dict(self) -> dict[str, Any]:
        """Return the summary record of the JSON lines: totals, then each bus."""
        each = {name: _totals(b) for name, b in self.buses.items()}
        out: dict[str, Any] = {"type": "summary"}
        for key in ("bytes", "bytes_in_frames", "bytes_in_gaps", "frames", "gaps", "transactions"):
            out[key] = sum(b[key] for b in each.values())
        for key in ("samples", "anomalies"):
            out[key] = sum(b[key] for b in each.values())
        for key in ("kinds", "reasons", "outcomes", "codes", "severities"):
            total: Counter[str] = Counter()
            for b in each.values():
                total.update(b[key])
            out[key] = dict(total)
        out["buses"] = each
        return out


def _totals(b: BusTotals) -> dict[str, Any]:
    out: dict[str, Any] = {
        "protocol": b.protocol,
        "bytes": b.bytes,
        "bytes_in_frames": b.bytes_in_frames,
        "bytes_in_gaps": b.bytes_in_gaps,
        "frames": sum(b.kinds.values()),
        "gaps": sum(b.gaps.values()),
        "transactions": sum(b.outcomes.values()),
        "samples": b.samples,
        "anomalies": sum(b.codes.values()),
        "kinds": {k: n for k, n in b.kinds.items() if n},
        "reasons": dict(b.gaps),
        "outcomes": {k: n for k, n in b.outcomes.items() if n},
        "codes": dict(b.codes),
        "severities": {s.name.lower(): n for s, n in b.severities.items()},
        "clock": b.clock,
        "response_times_ns": {
            str(servo): {"count": q.count, "p50": q.at(0.5), "p99": q.at(0.99), "max": q.most}
            for servo, q in sorted(b.times.items())
        },
    }
    if b.models:
        out["models"] = {
            str(servo): {"model": model, "scale": PROVENANCES[grounds]}
            for servo, (model, grounds) in sorted(b.models.items())
        }
    return out
