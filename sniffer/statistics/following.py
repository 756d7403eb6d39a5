"""Goals and positions of each servo in the order of the wire: what was to be reached, what was.

A goal holds until the next one, in whatever unit, or until a command ends it (``base.ends_goal``):
where nobody knows where a servo is to be, nothing is said of how far it is from there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.anomalies.zero import ZeroId
from sniffer.ground.codes import REQUEST, WHOLE
from sniffer.ground.model import ECHO, RESETS
from sniffer.protocols.base import ends_goal
from sniffer.protocols.ids import shared_ids
from sniffer.statistics.figures import GOAL, POSITION

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.ground.model import F64, I64, Batch, Mask
    from sniffer.protocols.base import BusProtocol

_MEASURED: Final = 0
_AIMED: Final = 1
_ENDED: Final = 2


@dataclass(frozen=True, slots=True)
class Course:
    """One servo's positions in one unit, and what became of its goal, a row each.

    ``goal`` is the one that holds at the row and after it, NaN where none is known; ``position`` is
    NaN in rows that are none. ``spread`` is the uncertainty of the time (-1: there is no clock),
    ``at`` the offset of the frame in the stream.
    """

    servo_id: int
    unit: str
    t_ns: I64
    spread: I64
    at: I64
    position: F64
    goal: F64
    before: float
    """The goal before the first row."""
    shown: Mask
    """Which rows are counted: of a selection those whose value is selected."""

    @property
    def measured(self) -> Mask:
        """Which rows are positions."""
        return ~np.isnan(self.position)

    @property
    def changes(self) -> I64:
        """The rows from which on another goal holds, or none any more."""
        goal = np.concatenate([[self.before], self.goal])
        none = np.isnan(goal)  # NaN differs from itself: a goal that ends is a change once
        return np.flatnonzero((goal[1:] != goal[:-1]) & ~(none[1:] & none[:-1]))


class Follower:
    """Carries the goals of all servos of one protocol from batch to batch."""

    def __init__(self, protocol: BusProtocol) -> None:
        told = [(r.quantity, r.unit) for r in protocol.registers]
        self.units = tuple(dict.fromkeys(unit for quantity, unit in told if quantity == POSITION))
        self._kind = np.full(len(told), -1, np.int64)
        self._unit = np.full(len(told), -1, np.int64)
        for i, (quantity, unit) in enumerate(told):
            if quantity in (POSITION, GOAL):
                self._kind[i] = _MEASURED if quantity == POSITION else _AIMED
                self._unit[i] = self.units.index(unit) if unit in self.units else len(self.units)
        self._ends = np.array(sorted(ends_goal(protocol)), np.int64)
        self._shared = np.array(shared_ids(protocol))
        self._zero = ZeroId(protocol)
        self._goal: dict[tuple[int, int], float] = {}
        self._of_all: dict[int, float] = {}

    def add(self, batch: Batch) -> Iterator[Course]:
        """Yield what a batch tells of each servo that states positions or is given goals."""
        taken = batch.values.accepted
        v, f = batch.values.take(taken), batch.frames
        kind = self._kind[v.register]
        rows = np.flatnonzero((kind >= 0) & (v.part == WHOLE) & ~np.isnan(v.value))
        ended, zero_until = self._ended(batch), self._zero.until(f)
        frame = np.concatenate([v.row[rows], ended])
        if not len(frame):
            return
        order = np.argsort(frame, kind="stable")
        frame = frame[order]
        none = np.full(len(ended), np.nan)
        what = np.concatenate([kind[rows], np.full(len(ended), _ENDED)])[order]
        unit = np.concatenate([self._unit[v.register[rows]], np.full(len(ended), -1)])[order]
        value = np.concatenate([v.value[rows], none])[order]
        servo = np.concatenate([v.servo_id[rows], f.servo_id[ended]])[order]
        t_ns = np.concatenate([v.t_ns[rows], f.t_end[ended]])[order]
        chosen = batch.shows("samples", len(taken))[taken][rows]
        shown = np.concatenate([chosen, np.ones(len(ended), bool)])[order]
        of_all = np.isin(servo, self._shared)
        of_all |= (servo == 0) & (f.servo_id[frame] == 0) & (frame < zero_until)
        known = {who for who, _ in self._goal}
        met = set(servo[~of_all].tolist())
        for who in sorted(met | (known if of_all.any() else set())):
            # what is said to all is an order; a position under such an id is of no servo we know
            mine = (of_all & (what != _MEASURED)) | (servo == who)
            for number, name in enumerate(self.units):
                # a position in another unit is another row; a goal in another unit ends this one
                take = np.flatnonzero(mine & ((what != _MEASURED) | (unit == number)))
                if not len(take):
                    continue
                fits = (what[take] == _AIMED) & (unit[take] == number)
                before = self._goal.get((who, number), self._of_all.get(number, np.nan))
                goal = _held(np.where(fits, value[take], np.nan), what[take] != _MEASURED, before)
                self._goal[who, number] = float(goal[-1])
                yield Course(
                    who,
                    name,
                    t_ns[take],
                    f.uncertainty[frame[take]],
                    batch.base + f.start[frame[take]],
                    np.where(what[take] == _MEASURED, value[take], np.nan),
                    goal,
                    before,
                    shown[take],
                )
        for number in range(len(self.units)):
            aims = np.flatnonzero(of_all & (what != _MEASURED))
            if len(aims):
                fits = what[aims[-1]] == _AIMED and unit[aims[-1]] == number
                self._of_all[number] = float(value[aims[-1]]) if fits else np.nan

    def _ended(self, batch: Batch) -> I64:
        """Return the rows of commands that end a goal without another."""
        f = batch.frames
        ends = (f.flags & RESETS) != 0
        for op in self._ends.tolist():
            ends |= f.op == op
        if not ends.any():
            return np.empty(0, np.int64)
        return np.flatnonzero(ends & (f.kind == REQUEST) & (f.flags & ECHO == 0))


def _held(value: F64, changes: Mask, before: float) -> F64:
    """Return the value of the last change at or before each row."""
    last = np.maximum.accumulate(np.where(changes, np.arange(len(value)), -1))
    return np.where(last >= 0, value[np.maximum(last, 0)], before)
