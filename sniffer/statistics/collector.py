"""What a report and the rules of a check need of a capture, in bounded memory: figures and curves.

A sink. Figures are a servo's own: extremes with the bytes that state them, what became of requests,
goals and who acknowledged them. Curves are for the eye (``grid.py``). Nothing is judged here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.anomalies.found import SEVERITY, Anomalies
from sniffer.decoding.narrowing import selected
from sniffer.decoding.pairing import unasked
from sniffer.decoding.sink import bus_of
from sniffer.ground.codes import NEVER, NO_RESPONSE, OK, OUTCOMES, RESPONSE, UNSOLICITED, WHOLE
from sniffer.ground.distinct import distinct
from sniffer.ground.gaps import Gaps
from sniffer.ground.model import ECHO, MS, MarkKind, Severity
from sniffer.protocols.ids import shared_ids
from sniffer.statistics.figures import (
    BYTES,
    DRAWN,
    ERROR,
    LONGEST,
    MISSING,
    SHORTEST,
    TROUBLE,
    UNCLAIMED,
    AnswerColumns,
    Extreme,
    Range,
    ServoFigures,
    WireFigures,
)
from sniffer.statistics.goals import GoalBook
from sniffer.statistics.grid import Grid
from sniffer.statistics.motion import Motion

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from sniffer.decoding.pacing import Pace
    from sniffer.ground.model import I64, Batch, Chunk
    from sniffer.protocols.base import BusProtocol

_SEVERITY: Final = np.array(SEVERITY, np.int64)


class LaneFigures:
    """What one protocol says on one bus; ``bus`` is the wire's name."""

    def __init__(self, bus: str, protocol: BusProtocol) -> None:
        self.bus = bus
        self.protocol = protocol
        self.servos: dict[int, ServoFigures] = {}
        told = [(r.quantity, r.unit) for r in protocol.registers]
        kinds = list(dict.fromkeys(t for t in told if t[0]))
        self._kinds = kinds
        self._column = np.array([kinds.index(t) if t[0] else -1 for t in told], np.int64)
        self._nobody = np.array([-1, *protocol.everyone])
        self._shared = shared_ids(protocol)
        self.motion = Motion(protocol)
        self._book = GoalBook(protocol)

    def add(self, batch: Batch, mine: Batch, grid: Grid) -> None:
        """Count in what the servos said, of a selection ``mine``, which is selected of it.

        It is judged by all that was said: by the goals that hold, by what became of requests.
        """
        self._meet(mine)
        self._count_answers(mine, grid)
        self._count_values(mine, grid)
        self._count_errors(batch, grid)
        self._book.add(batch, self.servos)

    def _meet(self, batch: Batch) -> None:
        f = batch.frames
        said = f.kind == RESPONSE
        asked = (f.reply != NEVER) & ~np.isin(f.servo_id, self._nobody)
        for servo in distinct(f.servo_id[said | asked])[0].tolist():
            if servo not in self._shared:
                self.servos.setdefault(servo, ServoFigures())
        rows = np.flatnonzero(said & (f.flags & ECHO == 0))
        for servo in distinct(f.servo_id[rows])[0].tolist():
            if servo in self.servos:
                own = rows[f.servo_id[rows] == servo]
                told = AnswerColumns(f.t_end[own], f.uncertainty[own], batch.base + f.start[own])
                self.servos[servo].hear(told)

    def _count_answers(self, batch: Batch, grid: Grid) -> None:
        f, t = batch.frames, batch.transactions
        who = np.full(len(t), -1, np.int64)
        asked = t.request != -1
        who[asked] = batch.asked(t.request[asked]).servo_id
        # what is said to all is answered under the servo's own id, if at all
        bare = np.isin(who, self._nobody) & (t.response >= 0)
        who[bare] = f.servo_id[t.response[bare]]
        many = len(OUTCOMES)
        told = (t.outcome != UNSOLICITED) | unasked(batch)
        keys, _, counts = distinct((who[told] + 1) * many + t.outcome[told])
        for key, n in zip(keys.tolist(), counts.tolist(), strict=True):
            mine = self.servos.get(key // many - 1)
            if mine is not None:
                mine.outcomes[OUTCOMES[key % many]] += n
        known = (t.outcome == OK) & (t.response_time_ns >= 0)
        who, ns = who[known], t.response_time_ns[known]
        spread = np.maximum(t.uncertainty_ns[known], 0)
        at = f.t_end[t.response[known]]
        for servo in distinct(who)[0].tolist():
            mine, rows = self.servos.get(servo), who == servo
            for name, bound in ((SHORTEST, ns - spread), (LONGEST, ns + spread)):
                if mine is not None:
                    curve = _own(mine, name, "ms", grid)
                    grid.add(curve, at[rows], np.maximum(bound[rows], 0) / MS)

    def _count_values(self, batch: Batch, grid: Grid) -> None:
        v = batch.samples
        told = (self._column[v.register] >= 0) & (v.part == WHOLE) & ~np.isnan(v.value)
        rows = np.flatnonzero(told)
        many = len(self._kinds)
        key = (v.servo_id[rows].astype(np.int64) + 1) * many + self._column[v.register[rows]]
        keys, which, _ = distinct(key)
        order = np.argsort(which, kind="stable")
        edges = np.searchsorted(which[order], np.arange(len(keys) + 1))
        for k, one in enumerate(keys.tolist()):
            servo, (quantity, unit) = one // many - 1, self._kinds[one % many]
            mine = rows[order[edges[k] : edges[k + 1]]]
            if servo in self.servos:
                _count_range(self.servos[servo], quantity, unit, batch, mine, grid)

    def _count_errors(self, batch: Batch, grid: Grid) -> None:
        for course in self.motion.add(batch):
            known = np.flatnonzero(~np.isnan(course.goal - course.position) & course.shown)
            figures = self.servos.get(course.servo_id)
            if figures is not None and len(known):
                curve = _own(figures, ERROR, course.unit, grid)
                error = course.goal[known] - course.position[known]
                grid.add(curve, course.t_ns[known], error)


class Collector:
    """A sink that keeps what a report shows."""

    def __init__(self) -> None:
        self.grid = Grid()
        self.lanes: dict[str, LaneFigures] = {}
        self.wires: dict[str, WireFigures] = {}

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing: batches hold every byte."""

    def pace(self, bus: str, told: Pace) -> None:
        """Take what a bus is timed by."""
        self._wire(bus).pace = told

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Count a batch in."""
        name = bus_of(bus, protocol, batch)
        if name not in self.lanes:
            self.lanes[name] = LaneFigures(bus, protocol)
        if batch.chosen is not None and len(batch.frames):
            ends = batch.frames.t_end[[0, -1]]  # the time of a curve is that of all frames
            self.grid.add(self._wire(bus).curves[BYTES], ends, np.zeros(2))
        mine = selected(batch)
        self._count_wire(self._wire(bus), mine)
        self.lanes[name].add(batch, mine, self.grid)

    def close(self) -> None:
        """Do nothing: what was collected is asked for afterwards."""

    def servos(self) -> Iterator[tuple[str, int, ServoFigures]]:
        """Yield lane by lane, each servo in the order of its id."""
        for name, lane in self.lanes.items():
            for servo, figures in sorted(lane.servos.items()):
                yield name, servo, figures

    def lanes_of(self, bus: str) -> Mapping[str, LaneFigures]:
        """Return the lanes of a wire."""
        return {name: lane for name, lane in self.lanes.items() if lane.bus == bus}

    def _wire(self, bus: str) -> WireFigures:
        if bus not in self.wires:
            names = (BYTES, UNCLAIMED, MISSING, TROUBLE)
            self.wires[bus] = WireFigures({name: self.grid.curve() for name in names})
        return self.wires[bus]

    def _count_wire(self, wire: WireFigures, batch: Batch) -> None:
        f, gaps, grid = batch.frames, Gaps.of(batch.gaps), self.grid
        wire.clock = max(wire.clock, batch.clock)
        wire.remarks.update(MarkKind(r.kind).name.lower() for r in batch.remarks)
        if len(f):
            wire.doubt_ns = max(wire.doubt_ns, int(f.uncertainty.max()))
        order = np.argsort(np.concatenate([f.start, gaps.start]), kind="stable")
        at, length = np.concatenate([f.t_end, gaps.t_ns]), np.concatenate([f.length, gaps.length])
        grid.add(wire.curves[BYTES], at[order], length[order])
        grid.add(wire.curves[UNCLAIMED], gaps.t_ns, gaps.length)
        t = batch.transactions
        lost = batch.asked(t.request[t.outcome == NO_RESPONSE]).t_end
        grid.add(wire.curves[MISSING], lost, np.ones(len(lost)))
        found = Anomalies.of(batch.anomalies)
        bad = found.t_ns[_SEVERITY[found.code] > Severity.NOTE]
        grid.add(wire.curves[TROUBLE], bad, np.ones(len(bad)))


def _own(mine: ServoFigures, name: str, unit: str, grid: Grid) -> int:
    """Return a servo's curve of a name."""
    if (name, unit) not in mine.curves:
        mine.curves[name, unit] = grid.curve()
    return mine.curves[name, unit]


def _count_range(
    mine: ServoFigures, quantity: str, unit: str, batch: Batch, rows: I64, grid: Grid
) -> None:
    """Widen the range of a servo's quantity by rows of a batch's samples."""
    v = batch.samples
    value = v.value[rows]

    def told(i: int) -> Extreme:
        offset = batch.base + int(batch.frames.start[v.row[rows[i]]])
        return Extreme(float(value[i]), int(v.t_ns[rows[i]]), offset)

    new = Range(len(rows), told(int(value.argmin())), told(int(value.argmax())))
    known = mine.values.get((quantity, unit))
    if known is None:
        new.curve = grid.curve() if quantity in DRAWN else -1
        known = mine.values[quantity, unit] = new
    else:
        known.widen(new)
    grid.add(known.curve, v.t_ns[rows], value)
