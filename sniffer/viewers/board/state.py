"""What the live board remembers: columns by servo, rings of moments, the last anomalies.

Constant memory: a bus has at most 256 servos, a ring holds seconds, anomalies of one kind are one
entry. All times are those of the recording's clock, in ns.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.decoding.durations import Bounds
from sniffer.decoding.summary import accounted
from sniffer.ground.codes import (
    DAMAGED,
    MISMATCHED,
    NEVER,
    NO_RESPONSE,
    OK,
    REQUEST,
    RESPONSE,
    WHOLE,
)
from sniffer.ground.model import F64, I16, I64, NS, RESETS, Batch, Mask, Severity
from sniffer.protocols.base import ends_goal
from sniffer.protocols.ids import shared_ids
from sniffer.viewers.board.registers import RegisterMemory

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.model import Chunk
    from sniffer.protocols.base import BusProtocol

QUANTITIES: Final = (
    "goal_position",
    "position",
    "load",
    "current",
    "voltage",
    "temperature",
)
"""What is remembered of each servo; see ``Register.quantity``."""

RECENT_NS: Final = 10 * NS
"""For so long a missing reply or an anomaly keeps its servo in front."""

RATE_NS: Final = 3 * NS
LOAD_NS: Final = 2 * NS
TIMES_NS: Final = 10 * NS
"""Over how much of the past rates, the bus load and reply times are taken."""

PER_OCTAVE: Final = 16
BINS: Final = 24 * PER_OCTAVE
FIRST_OCTAVE: Final = 10
"""Reply times from 1 us (2 ** 10 ns) to 17 s in a histogram of logarithms, to 2 %."""

IDS: Final = 256
STATUS_BYTE: Final = 0xFF
"""A status above a byte carries a protocol's own bits and says nothing about faults."""


class Sliding:
    """Sums by key over the last moments: a ring of slices of time."""

    def __init__(
        self, slice_ns: int, span_ns: int, keys: int = 1, dtype: type[np.signedinteger] = np.int64
    ) -> None:
        self._slice_ns = slice_ns
        self._span = span_ns // slice_ns
        self._sums = np.zeros((self._span + 2, keys), dtype)
        self._head = 0
        self._first_ns: int | None = None

    def grow(self, keys: int) -> None:
        """Make room for more keys."""
        more = np.zeros((len(self._sums), keys - self._sums.shape[1]), self._sums.dtype)
        self._sums = np.concatenate([self._sums, more], axis=1)

    def add(self, t_ns: I64, key: I64 | int = 0, amount: I64 | int = 1) -> None:
        """Add amounts at their times; what is older than the ring is left out."""
        if not len(t_ns):
            return
        number = t_ns // self._slice_ns
        newest = int(number.max())
        slices = len(self._sums)
        if self._first_ns is None:
            self._first_ns, self._head = int(t_ns.min()), newest
        if newest > self._head:
            stale = np.arange(max(self._head, newest - slices) + 1, newest + 1)
            self._sums[stale % slices] = 0
            self._head = newest
        held = number > self._head - slices
        keys = np.broadcast_to(np.asarray(key), number.shape)[held]
        amounts = np.broadcast_to(np.asarray(amount), number.shape)[held]
        np.add.at(self._sums, (number[held] % slices, keys), amounts)

    def until(self, end_ns: int) -> tuple[I64, float]:
        """Return the sums of the span that ends there, and how many seconds it really has.

        One at least: what has only just begun has no rate yet.
        """
        if self._first_ns is None:
            return np.zeros(self._sums.shape[1], np.int64), 1.0
        last = end_ns // self._slice_ns
        first = last - self._span
        slices = len(self._sums)
        wanted = np.arange(max(first, self._head - slices + 1), min(last, self._head) + 1)
        since = max(first * self._slice_ns, self._first_ns)
        seconds = max(end_ns - since, NS) / NS
        return self._sums[wanted % slices].sum(axis=0, dtype=np.int64), seconds


@dataclass(slots=True)
class Servos:
    """The servos of a bus, a row each in the order in which they appeared."""

    servo_id: I16
    asked: I64
    """Requests whose answer is expected and their fate known."""
    missing: I64
    damaged: I64
    """Answers that came torn, or do not fit."""
    heard_ns: I64
    trouble_ns: I64
    status: I64

    @classmethod
    def none(cls) -> Servos:
        """Return no rows."""
        counts = [np.zeros(0, np.int64) for _ in fields(cls)[1:]]
        return cls(np.zeros(0, np.int16), *counts)

    def __len__(self) -> int:
        return len(self.servo_id)

    def append(self, ids: I16) -> None:
        """Add rows for new servos."""
        for f in fields(self):
            column = getattr(self, f.name)
            more = ids if f.name == "servo_id" else np.zeros(len(ids), np.int64)
            setattr(self, f.name, np.concatenate([column, more]))


class BusTally:
    """What is known of one bus."""

    def __init__(self, protocol: BusProtocol) -> None:
        self.protocol = protocol
        self.end = 0
        """Offset up to which bytes were decided; they are in frames, in gaps, or were left out."""
        self.in_frames = self.in_gaps = self.left_out = 0
        self.frames = self.gaps = 0
        self.frame_rate = Sliding(NS // 4, RATE_NS)
        self.servos = Servos.none()
        self.answers = Sliding(NS // 4, RATE_NS, 0)
        self._times = Sliding(2 * NS, TIMES_NS, 0, np.int32)
        self._most = Sliding(2 * NS, TIMES_NS, 0, np.int32)
        self._row = np.full(IDS, -1, np.int64)
        registers = protocol.registers
        self._quantity = np.array(
            [QUANTITIES.index(r.quantity) if r.quantity in QUANTITIES else -1 for r in registers]
        )
        self._units = [r.unit for r in registers]
        shape = (0, len(QUANTITIES))
        self.value = np.zeros(shape)
        self.raw = np.zeros(shape, np.int64)
        self.register = np.zeros(shape, np.int64)
        self.seen_ns = np.zeros(shape, np.int64)
        self.memory = RegisterMemory(len(registers))
        self._ends = np.array(sorted(ends_goal(protocol)), np.int64)
        self._aimless_ns = np.zeros(0, np.int64)
        """When a servo was let go last: a goal from before holds no more."""
        self._alarm_registers = [i for i, r in enumerate(registers) if r.alarms]
        self._alarm_raw = np.zeros((0, len(self._alarm_registers)), np.int64)
        bits = np.array([1 << bit for bit in range(8)], np.int16)
        self._states = STATUS_BYTE & ~int(bits[protocol.refused(bits)].sum())
        self._nobody = np.zeros(IDS, bool)
        self._nobody[[i for i in shared_ids(protocol) if 0 <= i < IDS]] = True

    def add(self, batch: Batch) -> None:
        """Count a batch in."""
        if batch.base > self.end:
            self.left_out += batch.base - self.end
        self.end = batch.base + len(batch.data)
        in_gaps = sum(g.length for g in batch.gaps)
        self.in_gaps += in_gaps
        self.in_frames += accounted(batch) - in_gaps
        self.gaps += len(batch.gaps)
        f = batch.frames
        if len(f):
            self.frames += len(f)
            self.frame_rate.add(f.t_end)
            self._meet(f.servo_id[(f.kind == RESPONSE) | (f.reply != NEVER)])
            self._count(batch)
            self._read_status(batch)
            self._let_go(batch)
            self._read_values(batch)
        for a in batch.anomalies:
            if a.servo_id is not None and a.severity > Severity.NOTE:
                row = self._row[a.servo_id & 255]
                if row >= 0:
                    self.servos.trouble_ns[row] = max(int(self.servos.trouble_ns[row]), a.t_ns)

    @property
    def size(self) -> int:
        """Bytes that are accounted for."""
        return self.in_frames + self.in_gaps + self.left_out

    def times(self, end_ns: int) -> tuple[list[Bounds | None], list[Bounds | None]]:
        """Return each servo's reply times lately, p50 and p99; None: there are none."""
        n = len(self.servos)
        edges = []
        for k, histogram in enumerate((self._times, self._most)):
            counts = histogram.until(end_ns)[0].reshape(n, BINS)
            summed = counts.cumsum(axis=1)
            total = summed[:, -1] if n else np.zeros(0, np.int64)
            for share in (0.5, 0.99):
                at = (summed < np.maximum(share * total, 1)[:, None]).sum(axis=1)
                ns = 2 ** ((at + k) / PER_OCTAVE + FIRST_OCTAVE)
                edges.append(np.where(total > 0, np.where(at + k > 0, ns, 0), -1).astype(np.int64))
        out = []
        for low, high in ((edges[0], edges[2]), (edges[1], edges[3])):
            pairs = zip(low.tolist(), high.tolist(), strict=True)
            out.append([Bounds(a, b) if b >= 0 else None for a, b in pairs])
        return out[0], out[1]

    def alarms(self, row: int) -> list[str]:
        """Return the faults that a servo reported last."""
        names: list[str] = []
        status = int(self.servos.status[row])
        if status:
            names += self.protocol.status_names(status) or (f"status {status:02X}",)
        for k, index in enumerate(self._alarm_registers):
            register, raw = self.protocol.registers[index], int(self._alarm_raw[row, k])
            if raw in register.alarms:
                names.append(register.values.get(raw, f"{register.name} {raw}"))
        return [name.replace("_", " ") for name in names]

    def alarmed(self) -> Mask:
        """Tell which servos report a fault."""
        out: Mask = self.servos.status != 0
        for k, index in enumerate(self._alarm_registers):
            alarms = self.protocol.registers[index].alarms
            out = out | np.isin(self._alarm_raw[:, k], alarms)
        return out

    def _meet(self, ids: I16) -> None:
        """Give rows to servos that were not met before."""
        known = (ids >= 0) & (ids < IDS)
        key = ids[known].astype(np.int64)
        new = np.unique(key[(self._row[key] < 0) & ~self._nobody[key]])
        if not len(new):
            return
        n = len(self.servos) + len(new)
        self._row[new] = np.arange(len(self.servos), n)
        self.servos.append(new.astype(np.int16))
        self.answers.grow(n)
        self.memory.grow(n)
        self._aimless_ns = np.append(self._aimless_ns, np.zeros(len(new), np.int64))
        self._times.grow(n * BINS)
        self._most.grow(n * BINS)
        for name in ("value", "raw", "register", "seen_ns", "_alarm_raw"):
            column = getattr(self, name)
            more = np.full((len(new), column.shape[1]), -1, column.dtype)
            setattr(self, name, np.concatenate([column, more]))

    def _rows(self, ids: I16) -> I64:
        """Return the rows of servos; -1 for nobody."""
        key = ids.astype(np.int64)
        return np.where((key >= 0) & (key < IDS), self._row[key & 255], -1)

    def _count(self, batch: Batch) -> None:
        """Count answers, and those that did not come."""
        f, t, s = batch.frames, batch.transactions, self.servos
        rows = self._rows(f.servo_id)
        answer = np.flatnonzero((f.kind == RESPONSE) & (rows >= 0))
        s.heard_ns[rows[answer]] = f.t_end[answer]
        self.answers.add(f.t_end[answer], rows[answer])
        torn = (t.outcome == DAMAGED) | (t.outcome == MISMATCHED)
        gone = t.outcome == NO_RESPONSE
        kept = np.flatnonzero((t.request != -1) & (torn | gone | (t.outcome == OK)))
        if not len(kept):
            return
        asked = batch.asked(t.request[kept])
        who = self._rows(asked.servo_id)
        # One asks them all, each answers for itself.
        who = np.where((who < 0) & (t.response[kept] >= 0), rows[t.response[kept]], who)
        asked_ns = asked.t_end[who >= 0]
        kept, who = kept[who >= 0], who[who >= 0]
        n = len(s)
        s.asked += np.bincount(who, minlength=n)
        bad = torn[kept] | gone[kept]
        if bad.any():
            s.missing += np.bincount(who[gone[kept]], minlength=n)
            s.damaged += np.bincount(who[torn[kept]], minlength=n)
            s.trouble_ns[who[bad]] = asked_ns[bad]
        took = t.response_time_ns[kept]
        known = np.flatnonzero(~bad & (took >= 0))
        if len(known):
            kept, who, took = kept[known], who[known], took[known]
            spread = np.maximum(t.uncertainty_ns[kept], 0)
            at = f.t_end[t.response[kept]]
            self._times.add(at, who * BINS + _bins(took - spread))
            self._most.add(at, who * BINS + _bins(took + spread))

    def _read_status(self, batch: Batch) -> None:
        """Take the faults that servos report; a refusal is an event, not a state."""
        f = batch.frames
        rows = np.flatnonzero((f.kind == RESPONSE) & (f.status >= 0) & (f.status <= STATUS_BYTE))
        if not len(rows):
            return
        who = self._rows(f.servo_id[rows])
        rows, who = rows[who >= 0], who[who >= 0]
        # Of rows that repeat the last one stays: it is the latest.
        self.servos.status[who] = f.status[rows] & self._states

    def _let_go(self, batch: Batch) -> None:
        """Take commands that end a goal without another."""
        f = batch.frames
        ends = (f.flags & RESETS) != 0
        for op in self._ends.tolist():
            ends |= f.op == op
        rows = np.flatnonzero(ends & (f.kind == REQUEST)) if ends.any() else ()
        for row in rows:
            who = int(self._rows(f.servo_id[row : row + 1])[0])
            self._aimless_ns[slice(None) if who < 0 else who] = f.t_end[row]

    def errors(self) -> F64:
        """Return how far each servo's last position is off its goal, NaN where nobody knows.

        In the unit of both: where they have two units, it is not known either.
        """
        goal, here = QUANTITIES.index("goal_position"), QUANTITIES.index("position")
        seen, unit = self.seen_ns, np.array([*self._units, ""])[self.register]
        known = (seen[:, goal] > self._aimless_ns) & (seen[:, here] > 0)
        known &= unit[:, goal] == unit[:, here]
        return np.where(known, self.value[:, goal] - self.value[:, here], np.nan)

    def _read_values(self, batch: Batch) -> None:
        v = batch.values
        if not len(v):
            return
        self._meet(v.servo_id)
        who = self._rows(v.servo_id)
        true = (who >= 0) & v.accepted & (v.part == WHOLE)
        mine = np.flatnonzero(true)
        self.memory.add(who[mine], v.register[mine], v.raw[mine], v.value[mine], v.t_ns[mine])
        quantity = self._quantity[v.register]
        rows = np.flatnonzero(true & (quantity >= 0))
        at = who[rows], quantity[rows]
        self.value[at] = v.value[rows]
        self.raw[at] = v.raw[rows]
        self.register[at] = v.register[rows]
        self.seen_ns[at] = v.t_ns[rows]
        for k, index in enumerate(self._alarm_registers):
            mine = np.flatnonzero(true & (v.register == index))
            self._alarm_raw[who[mine], k] = v.raw[mine]


def _bins(ns: I64) -> I64:
    """Return where durations stand in a histogram of their logarithms."""
    k = (np.log2(np.maximum(ns, 1)) - FIRST_OCTAVE) * PER_OCTAVE
    return np.clip(k.astype(np.int64), 0, BINS - 1)


def stamps(chunks: Sequence[Chunk]) -> tuple[I64, I64]:
    """Return when chunks came and how long they are; those without a time are left out."""
    told = [(k.t_ns, len(k.data)) for k in chunks if k.t_ns is not None and k.data]
    both = np.array(told, np.int64).reshape(-1, 2)
    return both[:, 0], both[:, 1]
