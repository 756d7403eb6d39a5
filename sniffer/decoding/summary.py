"""Running totals of a decode, in constant memory: bytes, frames, outcomes, anomalies, times."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.anomalies.found import CODES, SEVERITY, Anomalies
from sniffer.decoding.called import ServoNames
from sniffer.decoding.durations import FIGURES, Quantiles
from sniffer.decoding.names import AND
from sniffer.ground.codes import KINDS, OK, OUTCOMES, PROVENANCES
from sniffer.ground.distinct import distinct
from sniffer.ground.gaps import REASONS, Gaps
from sniffer.ground.heard import HeardSpan, span_of
from sniffer.ground.model import I64, NS, U8, Anomaly, Batch, Clock, Severity

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.decoding.pacing import Pace
    from sniffer.decoding.sink import Part
    from sniffer.protocols.base import BusProtocol

ROWS: Final = ("frames", "gaps", "transactions", "samples", "anomalies")
"""The kinds of rows, by the names of their tables."""


UNTIMED: Final = "no clock in the input"
"""What is said where no byte has a time."""


@dataclass(slots=True)
class BusTotals:
    """Totals of one bus."""

    protocol: str
    usual_model: str = ""
    parts: dict[str, BusTotals] = field(default_factory=dict)
    """The same of each protocol by name, where two share the wire."""
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
    samples: int = 0
    first: dict[str, Anomaly] = field(default_factory=dict)
    by_servo: dict[str, Counter[int]] = field(default_factory=dict)
    """Code -> anomalies of each servo that is to blame."""
    looks_like: str | None = None
    """The protocol that the bytes speak, where another one was named."""
    models: dict[int, tuple[str, int]] = field(default_factory=dict)
    """Servo id -> model and grounds (a provenance), where it was named or the wire showed it."""
    clock: str = "none"
    heard: HeardSpan = field(default_factory=HeardSpan)
    _ops: dict[tuple[str, int], str] = field(default_factory=dict)

    def add(self, protocol: BusProtocol, batch: Batch) -> None:
        """Count a batch in."""
        f, t = batch.frames, batch.transactions
        self.bytes += accounted(batch)
        self.clock = batch.clock.name.lower()
        self.samples += int(batch.values.accepted.sum())
        if len(batch.gaps):
            self._count_gaps(batch)
        if len(batch.anomalies):
            self._count_anomalies(Anomalies.of(batch.anomalies))
        if not len(f):
            return
        self.models.update(batch.models)
        self.bytes_in_frames += int(f.length.sum())
        self.heard.take(protocol.name, f)
        for kind, n in zip(KINDS, np.bincount(f.kind, minlength=len(KINDS)).tolist(), strict=True):
            self.kinds[kind] += n
        for outcome, n in zip(
            OUTCOMES, np.bincount(t.outcome, minlength=len(OUTCOMES)).tolist(), strict=True
        ):
            self.outcomes[outcome] += n
        self._count_commands(protocol, batch)
        self._count_times(batch)

    def _count_gaps(self, batch: Batch) -> None:
        gaps = Gaps.of(batch.gaps)
        self.bytes_in_gaps += int(gaps.length.sum())
        for kind, _, n in _in_order(gaps.kind):
            self.gaps[REASONS[kind]] += n

    def _count_anomalies(self, found: Anomalies) -> None:
        for number, first, n in _in_order(found.code):
            code = CODES[number]
            self.codes[code] += n
            self.severities[SEVERITY[number]] += n
            if code not in self.first:
                self.first[code] = found[first]
        blamed = np.flatnonzero(found.servo_id >= 0)
        who = found.servo_id[blamed]
        for key, _, n in _in_order(found.code[blamed] << 32 | who):
            self.by_servo.setdefault(CODES[key >> 32], Counter())[key & 0xFFFFFFFF] += n

    def _count_commands(self, protocol: BusProtocol, batch: Batch) -> None:
        f = batch.frames
        ops, which, _ = distinct(f.op)
        ids = int(f.servo_id.max()) + 2
        found, _, counts = distinct((which * ids + f.servo_id + 1) << 1 | f.kind)
        for k, n in zip(found.tolist(), counts.tolist(), strict=True):
            who = (k >> 1) % ids - 1
            op = int(ops[(k >> 1) // ids])
            known = protocol.name, op
            name = self._ops.get(known) or self._ops.setdefault(known, protocol.op_name(op))
            self.by_command[who, name, KINDS[k & 1]] += n

    def _count_times(self, batch: Batch) -> None:
        f, t = batch.frames, batch.transactions
        asked = batch.rows_of(t.request) >= 0
        missing = asked & (t.outcome != OK) & (OUTCOMES.index("not_expected") != t.outcome)
        self.bad_by_servo.update(batch.asked(t.request[missing]).servo_id.tolist())
        known = (t.outcome == OK) & (t.response_time_ns >= 0)
        if not known.any():
            return
        servo = f.servo_id[t.response[known]]
        took = t.response_time_ns[known]
        spread = t.uncertainty_ns[known]
        for who in distinct(servo)[0].tolist():
            mine = servo == who
            self.times.setdefault(who, Quantiles()).add(took[mine], spread[mine])

    def know(self, told: Mapping[int, tuple[str, int]]) -> dict[int, tuple[str, int]]:
        """Keep what is known of servos in the end, as far as they were met; return it."""
        met = {servo for servo, _, _ in self.by_command}
        self.models = {servo: model for servo, model in told.items() if servo in met}
        return self.models

    @property
    def seconds(self) -> float | None:
        """Length of the capture by its own clock; None where it has none."""
        return None if self.clock == "none" or self.heard.first_ns is None else self.heard.ns / NS


def accounted(batch: Batch) -> int:
    """Return how many bytes a batch accounts for: all of its data, or its share of them."""
    if not batch.is_shared:
        return len(batch.data)
    return int(batch.frames.length.sum() + Gaps.of(batch.gaps).length.sum())


def _in_order(numbers: I64 | U8) -> list[tuple[int, int, int]]:
    """Return each number met, in the order of its first row, with that row and how often."""
    found, which, times = distinct(numbers)
    first = np.full(len(found), len(which))
    np.minimum.at(first, which, np.arange(len(which)))
    order = np.argsort(first)
    columns = (found[order].tolist(), first[order].tolist(), times[order].tolist())
    return list(zip(*columns, strict=True))


class Summary:
    """Totals of all buses of one decode."""

    def __init__(self, names: ServoNames | None = None) -> None:
        self.names = names or ServoNames()
        """What servos are called by those who read it."""
        self.buses: dict[str, BusTotals] = {}
        self.paces: dict[str, Pace] = {}
        """By what each bus is timed, where that is known."""
        self.narrowed: dict[str, Any] = {}
        """What was asked for, where that is not all (``sink.Narrowed``)."""
        self.shown: Counter[str] = Counter()
        """How many rows of each kind were selected; all else is counted of all rows."""
        self.began_ns: int | None = None
        """When the first frame with a clock began, left out or not: seconds count from it."""
        self._worst_shown: Severity | None = None

    def begin(self, parts: Sequence[Part]) -> None:
        """Take what one pass decided, before anything is left out of it."""
        for _, batch in parts:
            if len(batch.frames) and batch.clock != Clock.NONE:
                first = int(batch.frames.t_start[0])
                self.began_ns = first if self.began_ns is None else min(first, self.began_ns)

    def add(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Count a batch in."""
        usual = protocol.models[0].model
        totals = self.buses.setdefault(bus, BusTotals(protocol.name, usual))
        totals.add(protocol, batch)
        if batch.is_shared:
            part = totals.parts.setdefault(protocol.name, BusTotals(protocol.name, usual))
            part.add(protocol, batch)
            totals.protocol = AND.join(sorted(totals.parts))
        if batch.chosen is not None:
            for table in ROWS:
                self.shown[table] += int(batch.chosen(table).sum())
            for code in set(Anomalies.of(batch.anomalies).code[batch.chosen("anomalies")].tolist()):
                self.show(SEVERITY[code])

    def show(self, severity: Severity | None) -> None:
        """Take the severity of an anomaly that is selected; None: there is none."""
        if severity is not None:
            self._worst_shown = max(severity, self._worst_shown or Severity.NOTE)

    def know(self, bus: str, told: Mapping[str, Mapping[int, tuple[str, int]]]) -> None:
        """Take what is known in the end, by protocol: of each servo its model, and on what grounds.

        What was shown of a servo and refuted later is no longer told of it.
        """
        totals = self.buses[bus]
        if totals.parts:
            each = [part.know(told.get(name, {})) for name, part in sorted(totals.parts.items())]
            totals.models = {servo: model for one in each for servo, model in one.items()}
        else:
            totals.know(told.get(totals.protocol, {}))

    @property
    def seconds(self) -> float:
        """How long the capture is, all buses together, as far as it was read."""
        return span_of(bus.heard for bus in self.buses.values()) / NS

    def untimed(self) -> str | None:
        """Return what times are where the input has no clock; None: it has one, or no frame."""
        for name, bus in self.buses.items():
            if bus.clock == "none" and bus.kinds.total():
                return f"{UNTIMED}: times count its bytes{_at(self.paces.get(name))}"
        return None

    def narrow(self, told: Mapping[str, Any]) -> None:
        """Take what was asked for."""
        self.narrowed.update(told)

    def worst(self) -> Severity | None:
        """Return the highest severity met, of a selection the highest that is shown."""
        if self.shown:
            return self._worst_shown
        return max((s for b in self.buses.values() for s in b.severities), default=None)

    def as_dict(self) -> dict[str, Any]:
        """Return the summary record of the JSON lines: totals, then each bus."""
        each = {name: _totals(b, self.paces.get(name)) for name, b in self.buses.items()}
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
        if self.narrowed:
            out["selection"] = self.asked()
        return out

    def asked(self) -> dict[str, Any]:
        """Return what was asked for and how many rows of each kind were selected; empty: all."""
        return {**self.narrowed, **({"shown": dict(self.shown)} if self.shown else {})}


def _at(told: Pace | None) -> str:
    """Return at which rate bytes follow each other that have no stamp."""
    rate = "" if told is None else f" at {told.baud} baud"
    return f"{rate}, without the pauses between them"


def _timing(told: Pace | None) -> dict[str, Any]:
    if told is None:
        return {}
    return {
        "baud": told.baud,
        "rate": told.rate,
        "slowest_baud": told.slowest,
        "latency_ns": told.latency_ns,
        "latency": told.latency or "usual",
        "impossible": bool(told.faster),
    }


def _figures(q: Quantiles) -> dict[str, Any]:
    """Return the figures of one servo: a number only where the stamps carry one."""
    bounds = {name: q.at(share) for name, share in FIGURES.items()}
    return {
        "count": q.count,
        **{name: b.point if b is not None else None for name, b in bounds.items()},
        **{f"{name}_bounds": list(b) if b is not None else None for name, b in bounds.items()},
    }


def _totals(b: BusTotals, told: Pace | None) -> dict[str, Any]:
    apart = not b.parts  # an id is that of another servo in each protocol
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
        "codes_by_servo": {
            code: {str(servo): n for servo, n in servos.most_common()}
            for code, servos in b.by_servo.items()
            if apart
        },
        "severities": {s.name.lower(): n for s, n in b.severities.items()},
        "clock": b.clock,
        **({"looks_like": b.looks_like} if b.looks_like else {}),
        **_timing(told),
        "response_times_ns": {
            str(servo): _figures(q) for servo, q in sorted(b.times.items()) if apart
        },
    }
    if b.parts:
        out["protocols"] = {name: _totals(part, None) for name, part in sorted(b.parts.items())}
    elif b.models:
        out["models"] = {
            str(servo): {"model": model, "scale": PROVENANCES[grounds]}
            for servo, (model, grounds) in sorted(b.models.items())
        }
    return out
