"""Records one by one, as frozen dataclasses in wire order: for people, scripts and JSON lines.

The only place where a Python object per frame exists; bulk work stays in the columns of a Batch.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Final

import numpy as np

from sniffer.anomalies.catalogue import CATALOGUE
from sniffer.decoding.fields import frame_fields, tidy, value_ranges
from sniffer.ground.codes import KINDS, OUTCOMES, PARTS, PROVENANCES, ROLES, WHOLE
from sniffer.ground.model import (
    ECHO,
    ECHO_DIFFERS,
    MALFORMED,
    UNKNOWN,
    UNUSUAL,
    Anomaly,
    Batch,
    Clock,
    Direction,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from sniffer.protocols.base import BusProtocol


FLAGS: Final[Mapping[int, str]] = {
    MALFORMED: "malformed",
    UNKNOWN: "unknown",
    ECHO_DIFFERS: "echo_differs",
    UNUSUAL: "unusual",
    ECHO: "echo",
}


OF_FRAMES, OF_SAMPLES, OF_TRANSACTIONS, OF_ANOMALIES = range(4)
"""The order of what stands at one place of the stream; gaps stand where frames do."""


@dataclass(frozen=True, slots=True)
class FrameRow:
    """A frame that holds; ``fields`` is every value it states."""

    type: ClassVar[str] = "frame"
    bus: str
    t_ns: int
    offset: int
    length: int
    hex: str
    protocol: str
    kind: str
    servo_id: int | None
    op: str
    checksum: str
    fields: dict[str, Any]
    flags: tuple[str, ...]
    t_start_ns: int
    uncertainty_ns: int | None
    clock: str
    direction: str | None


@dataclass(frozen=True, slots=True)
class GapRow:
    """Bytes no frame claims."""

    type: ClassVar[str] = "gap"
    bus: str
    t_ns: int
    offset: int
    length: int
    hex: str
    reason: str
    detail: dict[str, Any]
    clock: str
    protocol: str | None = None


@dataclass(frozen=True, slots=True)
class TransactionRow:
    """A request and its response."""

    type: ClassVar[str] = "transaction"
    bus: str
    request_offset: int | None
    response_offset: int | None
    servo_id: int | None
    op: str
    outcome: str
    response_time_ns: int | None
    uncertainty_ns: int | None
    protocol: str | None = None


@dataclass(frozen=True, slots=True)
class SampleRow:
    """One value of one register; ``name`` is what an enumerated value means."""

    type: ClassVar[str] = "sample"
    bus: str
    t_ns: int
    servo_id: int | None
    register: str
    quantity: str
    role: str
    raw: int
    value: float | None
    unit: str
    scale: str
    name: str | list[str] | None
    part: str | None
    offset: int
    protocol: str | None = None


@dataclass(frozen=True, slots=True)
class AnomalyRow:
    """What is wrong, with its bytes, its numbers and its likely cause."""

    type: ClassVar[str] = "anomaly"
    bus: str
    t_ns: int
    severity: str
    group: str
    code: str
    servo_id: int | None
    detail: str
    evidence: list[list[int]] = field(default_factory=list)
    means: str = ""
    causes: str = ""
    remedy: str = ""
    protocol: str | None = None


Row = FrameRow | GapRow | TransactionRow | SampleRow | AnomalyRow

_KEYS: Final[Mapping[str, tuple[str, ...]]] = {
    kind.type: tuple(f.name for f in dataclasses.fields(kind))
    for kind in (FrameRow, GapRow, TransactionRow, SampleRow, AnomalyRow)
}
"""Asking a dataclass for its fields takes longer than reading them."""


def as_dict(row: Row) -> dict[str, Any]:
    """Return a row as the JSON lines have it: ``type`` first, keys in order.

    Rows other than frames tell their protocol where two share the wire, and only there.
    """
    out: dict[str, Any] = {"type": row.type}
    for name in _KEYS[row.type]:
        value = getattr(row, name)
        if value is not None or name != "protocol":
            out[name] = value
    return out


def frame_row(
    batch: Batch, protocol: BusProtocol, bus: str, i: int, fields: dict[str, Any]
) -> FrameRow:
    """Return frame ``i`` of a batch; ``fields`` are what it states."""
    f = batch.frames
    start, length = int(f.start[i]), int(f.length[i])
    raw = batch.data[start : start + length]
    uncertainty, servo = int(f.uncertainty[i]), int(f.servo_id[i])
    flags, wire = int(f.flags[i]), int(f.direction[i])
    return FrameRow(
        bus=bus,
        t_ns=int(f.t_end[i]),
        offset=batch.base + start,
        length=length,
        hex=raw.hex(),
        protocol=protocol.name,
        kind=KINDS[int(f.kind[i])],
        servo_id=servo if servo >= 0 else None,
        op=protocol.op_name(int(f.op[i])),
        checksum="ok" if protocol.checksum_of(raw) else "none",
        fields=fields,
        flags=tuple(name for bit, name in FLAGS.items() if flags & bit) if flags else (),
        t_start_ns=int(f.t_start[i]),
        uncertainty_ns=uncertainty if uncertainty >= 0 else None,
        clock=batch.clock.name.lower(),
        direction=Direction(wire).name if wire else None,
    )


def _samples(batch: Batch, protocol: BusProtocol, bus: str) -> Iterator[tuple[int, SampleRow]]:
    v = batch.samples
    columns = (v.t_ns, v.servo_id, v.register, v.role, v.raw, v.value, v.provenance, v.part, v.row)
    starts = (batch.frames.start[v.row] + batch.base).tolist()
    for start, (t, servo, register, role, raw, value, scale, part, _) in zip(
        starts, zip(*(c.tolist() for c in columns), strict=True), strict=True
    ):
        r = protocol.registers[register]
        yield (
            start,
            SampleRow(
                bus,
                t,
                servo if servo >= 0 else None,
                r.name,
                r.quantity,
                ROLES[role],
                raw,
                tidy(value),
                r.unit,
                PROVENANCES[scale],
                r.names(raw) if part == WHOLE else None,
                PARTS[part] or None,
                start,
                beside(protocol, batch),
            ),
        )


def _transactions(
    batch: Batch, protocol: BusProtocol, bus: str
) -> Iterator[tuple[int, TransactionRow]]:
    f, t = batch.frames, batch.transactions
    if batch.chosen is not None:
        t = t.take(batch.chosen("transactions"))
    before = batch.asked(t.request[t.request < -1])  # no row of this batch
    earlier = iter(range(len(before)))
    told_at = np.where(t.response >= 0, t.response, batch.rows_of(t.request))
    columns = (told_at, t.request, t.response, t.outcome, t.response_time_ns, t.uncertainty_ns)
    for told, q, r, outcome, took, spread in zip(*(c.tolist() for c in columns), strict=True):
        request, row = (before, next(earlier)) if q < -1 else (f, q)
        asked = int(request.servo_id[row]) if q != -1 else -1
        servo = asked if asked >= 0 else int(f.servo_id[told])
        yield (
            batch.base + int(f.start[told]),
            TransactionRow(
                bus,
                batch.base + int(request.start[row]) if q != -1 else None,
                batch.base + int(f.start[r]) if r >= 0 else None,
                servo if servo >= 0 else None,
                protocol.op_name(int(request.op[row] if q != -1 else f.op[r])),
                OUTCOMES[outcome],
                took if took >= 0 else None,
                spread if took >= 0 and spread >= 0 else None,
                beside(protocol, batch),
            ),
        )


def beside(protocol: BusProtocol, batch: Batch) -> str | None:
    """Return the protocol's name where another one is on the wire."""
    return protocol.name if batch.is_shared else None


def anomaly_row(anomaly: Anomaly, bus: str, protocol: str | None = None) -> AnomalyRow:
    """Return an anomaly with what the catalogue knows about its code."""
    known = CATALOGUE[anomaly.code]
    return AnomalyRow(
        bus,
        anomaly.t_ns,
        anomaly.severity.name.lower(),
        anomaly.group,
        anomaly.code,
        anomaly.servo_id,
        anomaly.detail,
        [list(span) for span in anomaly.evidence],
        known.means,
        known.causes,
        anomaly.remedy or known.remedy,
        protocol,
    )


def rows(batch: Batch, protocol: BusProtocol, bus: str = "bus0") -> Iterator[Row]:
    """Yield everything a batch says, in wire order: a frame, its samples, its transaction."""
    return rows_of([(protocol, batch)], bus)


def rows_of(parts: Iterable[tuple[BusProtocol, Batch]], bus: str = "bus0") -> Iterator[Row]:
    """Yield everything that several protocols say in one pass, in wire order."""
    found: list[tuple[int, int, Row]] = []
    for protocol, batch in parts:
        found += _found(batch, protocol, bus)
    found.sort(key=lambda e: e[:2])
    for _, _, one in found:
        yield one


def _found(batch: Batch, protocol: BusProtocol, bus: str) -> Iterator[tuple[int, int, Row]]:
    """Yield rows, each with its place in the stream and among those of the same place."""
    edges = value_ranges(batch.values, len(batch.frames))
    starts = (batch.frames.start + batch.base).tolist()
    for i in shown(batch, "frames", len(starts)):
        fields = frame_fields(batch, protocol, i, range(edges[i], edges[i + 1]))
        yield starts[i], OF_FRAMES, frame_row(batch, protocol, bus, i, fields)
    yield from ((at, OF_SAMPLES, s) for at, s in _samples(batch, protocol, bus))
    yield from ((at, OF_TRANSACTIONS, t) for at, t in _transactions(batch, protocol, bus))
    yield from rare_rows(batch, protocol, bus)


def rare_rows(
    batch: Batch, protocol: BusProtocol, bus: str
) -> Iterator[tuple[int, int, GapRow | AnomalyRow]]:
    """Yield gaps and anomalies, each with its place, as above."""
    clock, named = Clock(batch.clock).name.lower(), beside(protocol, batch)
    for g in (batch.gaps[i] for i in shown(batch, "gaps", len(batch.gaps))):
        raw = batch.data[g.start : g.start + g.length].hex()
        at = batch.base + g.start
        detail = dict(g.detail)
        row = GapRow(bus, g.t_ns, at, g.length, raw, g.reason, detail, clock, named)
        yield at, OF_FRAMES, row
    for a in (batch.anomalies[i] for i in shown(batch, "anomalies", len(batch.anomalies))):
        yield a.known_at, OF_ANOMALIES, anomaly_row(a, bus, named)


def shown(batch: Batch, table: str, count: int) -> Sequence[int]:
    """Return the rows of a table that are shown."""
    if batch.chosen is None:
        return range(count)
    chosen: list[int] = np.flatnonzero(batch.chosen(table)).tolist()
    return chosen
