"""Rules of the user's own, over the values of a bus: what is beyond a limit, and for how long.

A rule is judged by the values that were heard and by nothing else: it is met once a value shows
that it still is so after the time asked for, also where the stamps are as late as they can be, and
it is over with the first value that is otherwise. So a servo that falls silent changes nothing, and
what is found does not depend on how the stream was cut.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.anomalies.alarms import OPERATORS, meant
from sniffer.anomalies.rules import anomaly
from sniffer.anomalies.zero import ZeroId
from sniffer.ground.codes import WHOLE
from sniffer.ground.distinct import distinct
from sniffer.ground.memory import Remembering
from sniffer.ground.model import NS
from sniffer.protocols.ids import shared_ids

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.anomalies.alarms import Alarm, Meant
    from sniffer.ground.model import F64, I64, Anomaly, Batch, Mask
    from sniffer.protocols.base import BusProtocol

Span = tuple[int, int]

_FALLING: Final = ("<", "<=")
"""Rules whose worst value is the least."""


@dataclass(slots=True)
class _Held:
    """A rule that is met by a servo: since when, by which bytes, how far it went."""

    since_ns: int
    span: Span
    worst: float
    is_told: bool = False


@dataclass(slots=True)
class JudgedValues:
    """What a rule is judged by, a row a value, in the order of the wire."""

    servo: I64
    t_ns: I64
    least_ns: I64
    """When the value can have been on the wire at the soonest."""
    value: F64
    row: I64


class ThresholdWatch(Remembering):
    """What a rule is judged by, batch after batch; goals are carried along."""

    LASTING = ("_goal", "_goal_of_all")
    PARTS = ("_zero",)

    def __init__(self, alarm: Alarm, what: Meant, protocol: BusProtocol) -> None:
        self._servo = alarm.servo_id
        self._measured = _rows(what.measured, protocol)
        self._goals = _rows(what.goals, protocol)
        self._others = _rows(what.others, protocol)
        self._is_distance = bool(what.goals)
        self._shared = shared_ids(protocol)
        self._zero = ZeroId(protocol)
        self._goal: dict[int, float] = {}
        self._goal_of_all = np.nan

    def judged(self, batch: Batch, usable: Mask) -> JudgedValues:
        """Return the values, or distances from goals, that the rule asks for."""
        found = self._distances(batch, usable) if self._is_distance else self._plain(batch, usable)
        return found if self._servo is None else taken(found, found.servo == self._servo)

    def _plain(self, batch: Batch, usable: Mask) -> JudgedValues:
        v = batch.values
        rows = np.flatnonzero(usable & self._measured[v.register])
        return _values(batch, rows, v.value[rows])

    def _distances(self, batch: Batch, usable: Mask) -> JudgedValues:
        """Return how far what is measured is from the goal before it; goals are carried along."""
        v = batch.values
        about = self._measured | self._goals | self._others
        rows = np.flatnonzero(usable & about[v.register])
        kept: list[int] = []
        apart: list[float] = []
        columns = (v.register[rows], v.servo_id[rows], v.value[rows], v.row[rows])
        zero_until = self._zero.until(batch.frames)
        for row, register, who, value, frame in zip(
            rows.tolist(), *(column.tolist() for column in columns), strict=True
        ):
            if not self._measured[register]:
                goal = value if self._goals[register] else np.nan
                if who in self._shared or (who == 0 and frame < zero_until):
                    self._goal.clear()
                    self._goal_of_all = goal
                else:
                    self._goal[who] = goal
                continue
            distance = abs(value - self._goal.get(who, self._goal_of_all))
            if distance == distance:  # nobody knows how far without a goal
                kept.append(row)
                apart.append(distance)
        return _values(batch, np.array(kept, np.int64), np.array(apart, np.float64))


class _Threshold(Remembering):
    """One rule, for all servos of a bus."""

    LASTING = ("_held",)
    PARTS = ("_watch",)

    def __init__(self, alarm: Alarm, what: Meant, protocol: BusProtocol) -> None:
        self._alarm = alarm
        self._unit = what.unit
        self._is_met: Any = OPERATORS[alarm.op]
        self._watch = ThresholdWatch(alarm, what, protocol)
        self._held: dict[int, _Held] = {}

    def judge(self, batch: Batch, usable: Mask) -> Iterator[Anomaly]:
        """Report where the rule begins to be met, and where it no longer is."""
        found = self._watch.judged(batch, usable)
        if not len(found.servo):
            return
        flag: Mask = self._is_met(found.value, self._alarm.limit)
        if not flag.any() and not self._held:
            return
        for who in distinct(found.servo)[0].tolist():
            mine = found.servo == who
            yield from self._of(who, taken(found, mine), flag[mine], batch)

    def _of(self, who: int, found: JudgedValues, flag: Mask, batch: Batch) -> Iterator[Anomaly]:
        edges = [0, *(np.flatnonzero(np.diff(flag)) + 1).tolist(), len(flag)]
        for first, behind in itertools.pairwise(edges):
            if flag[first]:
                yield from self._met(who, found, first, behind, batch)
            elif (held := self._held.pop(who, None)) is not None and held.is_told:
                yield self._over(who, found, first, held, batch)

    def _met(
        self, who: int, found: JudgedValues, first: int, behind: int, batch: Batch
    ) -> Iterator[Anomaly]:
        """Take a run of values that meet the rule; tell of the first that proves it."""
        held = self._held.get(who)
        if held is None:
            span = _span(batch, int(found.row[first]))
            since_ns, worst = int(found.t_ns[first]), float(found.value[first])
            held = self._held[who] = _Held(since_ns, span, worst)
        if not held.is_told:
            long = found.least_ns[first:behind] - held.since_ns >= self._alarm.for_ns
            if not self._alarm.for_ns:
                long[:] = True
            if long.any():
                k = first + int(np.argmax(long))
                held.is_told = True
                yield self._begun(who, found, k, held, batch)
        run = found.value[first:behind]
        now = float(run.min() if self._alarm.op in _FALLING else run.max())
        held.worst = min(held.worst, now) if self._alarm.op in _FALLING else max(held.worst, now)

    def _begun(self, who: int, found: JudgedValues, k: int, held: _Held, batch: Batch) -> Anomaly:
        t_ns = int(found.t_ns[k])
        text = f"{self._alarm}: servo {who} has {self._told(float(found.value[k]))}"
        if self._alarm.for_ns:
            text += f", for {_seconds(t_ns - held.since_ns)} now"
        spans = dict.fromkeys((held.span, _span(batch, int(found.row[k]))))
        return anomaly("alarm", t_ns, who, text, *spans)

    def _over(self, who: int, found: JudgedValues, k: int, held: _Held, batch: Batch) -> Anomaly:
        t_ns = int(found.t_ns[k])
        text = (
            f"{self._alarm}: over after {_seconds(t_ns - held.since_ns)}, servo {who} has "
            f"{self._told(float(found.value[k]))}"
        )
        if self._alarm.op not in ("==", "!="):
            side = "least" if self._alarm.op in _FALLING else "most"
            text += f"; at {side} it was {self._told(held.worst)}"
        return anomaly("alarm-over", t_ns, who, text, _span(batch, int(found.row[k])))

    def _told(self, value: float) -> str:
        return f"{value:.6g} {self._unit}".rstrip()


class AlarmRules(Remembering):
    """Runs the user's rules over batch after batch of one bus."""

    PARTS = ("_rules",)

    def __init__(self, protocol: BusProtocol, alarms: Sequence[Alarm] = ()) -> None:
        told = [(alarm, meant(alarm, protocol.registers)) for alarm in dict.fromkeys(alarms)]
        self._rules = [_Threshold(alarm, what, protocol) for alarm, what in told if what]

    def judge(self, batch: Batch) -> Iterator[Anomaly]:
        """Report which rules begin to be met, and which no longer are."""
        if not self._rules:
            return
        told = usable(batch)
        for rule in self._rules:
            yield from rule.judge(batch, told)


def _rows(registers: Sequence[int], protocol: BusProtocol) -> Mask:
    out = np.zeros(len(protocol.registers), bool)
    out[list(registers)] = True
    return out


def _values(batch: Batch, rows: I64, value: F64) -> JudgedValues:
    v, f = batch.values, batch.frames
    row = v.row[rows]
    spread = np.maximum(f.uncertainty[row], 0)
    t_ns = v.t_ns[rows]
    # 78 times 0.1 V is a little more than the 7.8 V that somebody writes
    value = np.round(value, 9)
    return JudgedValues(v.servo_id[rows].astype(np.int64), t_ns, t_ns - spread, value, row)


def usable(batch: Batch) -> Mask:
    """Return which values rules are judged by: whole ones, in units, that became true."""
    v = batch.values
    out: Mask = v.accepted & (v.part == WHOLE) & (v.servo_id >= 0) & ~np.isnan(v.value)
    return out


def taken(found: JudgedValues, mine: Mask) -> JudgedValues:
    """Return some rows of what a rule is judged by."""
    f = found
    return JudgedValues(f.servo[mine], f.t_ns[mine], f.least_ns[mine], f.value[mine], f.row[mine])


def _span(batch: Batch, row: int) -> Span:
    return batch.base + int(batch.frames.start[row]), int(batch.frames.length[row])


def _seconds(ns: int) -> str:
    return f"{ns / NS:.1f} s" if ns >= NS else f"{ns / 1e6:.0f} ms"
