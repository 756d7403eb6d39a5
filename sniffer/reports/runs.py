"""What a run is compared by: times, values, counts by servo and command, in bounded memory."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from sniffer.anomalies.found import CODES, SEVERITY, Anomalies
from sniffer.decoding.narrowing import selected
from sniffer.decoding.sink import bus_of
from sniffer.ground.codes import COMMANDED, CONFIG, MEASURED, OK, OUTCOMES, REQUEST
from sniffer.ground.heard import HeardSpan, span_of
from sniffer.ground.model import MS, NS, Clock, Severity
from sniffer.mcapfile.fields import field_name, state_field
from sniffer.statistics.firstmotion import FirstMotions
from sniffer.statistics.following import Follower
from sniffer.statistics.lags import LagSeries
from sniffer.statistics.thinned import Thinned

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from sniffer.diagnosis.model import Incident
    from sniffer.ground.model import I16, I64, Batch, Chunk
    from sniffer.protocols.base import BusProtocol

KEPT: Final = 1 << 14
"""Numbers that are kept of a series: beyond, every second, fourth ... one."""

FOLLOWING: Final = "following_error"
"""What how far positions are from their goals is called, without sign."""

FIRST_MOTION, LAG = "first_motion", "lag"
"""How late a servo is: from a goal to its first motion, and behind goals that move."""

SETTINGS: Final = 8
"""Values of a setting that are told apart."""

_EXPECTED: Final = [OUTCOMES.index(o) for o in ("ok", "no_response", "damaged", "mismatched")]

_TOLD_ELSEWHERE: Final = frozenset({"no-response", "damaged-response"})
"""Codes that say the same as the share of missing answers."""


class Who(NamedTuple):
    """Whose a number is: a servo of a bus, None for the bus itself."""

    bus: str
    servo_id: int | None


class RunFigures:
    """A sink that keeps what a run is compared by, of a selection what is selected."""

    def __init__(self) -> None:
        self.frames: Counter[str] = Counter()
        """Frames that are compared, by bus."""
        self.heard: Counter[str] = Counter()
        """All frames, also those that are not selected: how often something is told is of them."""
        self.rows: Counter[str] = Counter()
        """Frames, anomalies and gaps that are compared."""
        self.requests: Counter[Who] = Counter()
        self.commands: Counter[tuple[Who, str]] = Counter()
        self.expected: Counter[Who] = Counter()
        self.missing: Counter[Who] = Counter()
        self.errors: Counter[tuple[Who, str]] = Counter()
        self.response_ms: dict[tuple[Who, str], Thinned] = {}
        self.doubt_ms: dict[tuple[Who, str], Thinned] = {}
        self.motion_ms: dict[tuple[Who, str], Thinned] = {}
        self.motion_doubt_ms: dict[tuple[Who, str], Thinned] = {}
        """How late servos are, by ``FIRST_MOTION`` and ``LAG``, and how sure that is."""
        self.period_ms: dict[tuple[Who, str], Thinned] = {}
        self.measured: dict[tuple[Who, str], Thinned] = {}
        self.commanded: dict[tuple[Who, str], Thinned] = {}
        self.settings: dict[tuple[Who, str], set[int]] = {}
        self.spans: dict[str, HeardSpan] = {}
        self.protocols: dict[str, str] = {}
        self.incidents: tuple[Incident, ...] = ()
        """What a diagnosis says of the run, where all of it is compared."""
        self._tables: frozenset[str] = frozenset(("anomalies", "transactions"))
        self._last: dict[tuple[Who, str], int] = {}
        self._followers: dict[str, Follower] = {}
        self._starts: dict[str, FirstMotions] = {}
        self._lags: dict[tuple[Who, str], LagSeries] = {}

    def narrow(self, told: Mapping[str, Any]) -> None:
        """Take which tables have rows that are selected."""
        self._tables = frozenset(told.get("tables", self._tables))

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing."""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Take what a pass decided."""
        bus = bus_of(bus, protocol, batch)
        f = batch.frames
        self.heard[bus] += len(f)
        self.protocols[bus] = protocol.name
        if len(f) and batch.clock != Clock.NONE:  # what happens so often does so in all the time
            self.spans.setdefault(bus, HeardSpan()).take(protocol.name, f)
        self._motion(bus, protocol, batch)
        batch = selected(batch)
        f = batch.frames
        self.frames[bus] += len(f)
        self.rows[bus] += len(f) + len(batch.anomalies) + len(batch.gaps)
        if len(batch.anomalies):
            self._errors(bus, Anomalies.of(batch.anomalies))
        if "anomalies" not in self._tables:  # which say the same of most gaps
            self.errors.update((Who(bus, None), gap.reason) for gap in batch.gaps)
        if not len(f):
            return
        self._commands(bus, protocol, batch)
        self._answers(bus, protocol, batch)
        self._values(bus, protocol, batch)

    def close(self) -> None:
        """Do nothing."""

    @property
    def seconds(self) -> float | None:
        """How long the run was; None where its frames have no time."""
        if self.heard.total() and not self.spans:
            return None
        return span_of(self.spans.values()) / NS

    def keep(self, bus: str) -> None:
        """Forget the other buses, of which nothing was selected."""
        self.frames = Counter({bus: self.frames[bus]})
        self.heard, self.rows = Counter({bus: self.heard[bus]}), Counter({bus: self.rows[bus]})
        self.spans = {name: span for name, span in self.spans.items() if name == bus}
        self.protocols = {bus: self.protocols[bus]}

    def rename(self, bus: str, name: str) -> None:
        """Give the only bus another name."""

        def own(who: Who) -> Who:
            return who._replace(bus=name)

        self.frames = Counter({name: self.frames[bus]})
        self.heard, self.rows = Counter({name: self.heard[bus]}), Counter({name: self.rows[bus]})
        self.spans = dict(zip([name], self.spans.values(), strict=False))
        self.protocols = {name: self.protocols[bus]}
        self.incidents = tuple(replace(i, bus=name) for i in self.incidents)
        self.requests = Counter({own(w): n for w, n in self.requests.items()})
        self.expected = Counter({own(w): n for w, n in self.expected.items()})
        self.missing = Counter({own(w): n for w, n in self.missing.items()})
        self.commands = Counter({(own(w), c): n for (w, c), n in self.commands.items()})
        self.errors = Counter({(own(w), c): n for (w, c), n in self.errors.items()})
        self.settings = {(own(w), c): n for (w, c), n in self.settings.items()}
        for of in (
            *("response_ms", "doubt_ms", "motion_ms", "motion_doubt_ms"),
            *("period_ms", "measured", "commanded"),
        ):
            series: dict[tuple[Who, str], Thinned] = getattr(self, of)
            setattr(self, of, {(own(w), c): s for (w, c), s in series.items()})

    def _errors(self, bus: str, found: Anomalies) -> None:
        told = "transactions" in self._tables
        for code, servo in zip(found.code.tolist(), found.servo_id.tolist(), strict=True):
            # who selects anomalies alone means all that are selected
            if not told or (SEVERITY[code] > Severity.NOTE and CODES[code] not in _TOLD_ELSEWHERE):
                self.errors[Who(bus, servo if servo >= 0 else None), CODES[code]] += 1

    def _motion(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Take how far positions are from their goals, and how late.

        Goals may lie outside a selection.
        """
        follower = self._followers.setdefault(bus, Follower(protocol))
        starts = self._starts.setdefault(bus, FirstMotions(protocol.registers))
        for course in follower.add(batch):
            who = Who(bus, course.servo_id)
            begun = [((b.low + b.high) / 2, (b.high - b.low) / 2) for b in starts.add(course)]
            self._late(who, FIRST_MOTION, begun)
            lags = self._lags.setdefault((who, course.unit), LagSeries())
            self._late(who, LAG, lags.add(course))
            error = np.abs(course.goal - course.position)
            error = error[course.shown & ~np.isnan(error)]
            if len(error):
                key = Who(bus, course.servo_id), field_name(FOLLOWING, course.unit)
                self.measured.setdefault(key, Thinned(KEPT)).add(error)

    def _late(self, who: Who, name: str, times: Sequence[tuple[float, float]]) -> None:
        """Take times in ns, each with its uncertainty."""
        for series, k in ((self.motion_ms, 0), (self.motion_doubt_ms, 1)):
            if times:
                told = np.array([time[k] / MS for time in times])
                series.setdefault((who, name), Thinned(KEPT)).add(told)

    def _commands(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        f = batch.frames
        asks = np.flatnonzero(f.kind == REQUEST)
        timed = batch.clock != Clock.NONE
        for who, op, rows in _by(bus, f.servo_id[asks], f.op[asks], asks):
            name = protocol.op_name(op)
            self.requests[who] += len(rows)
            self.commands[who, name] += len(rows)
            if timed:
                times = f.t_end[rows]
                last = self._last.get((who, name))
                steps = np.diff(times) if last is None else np.diff(times, prepend=last)
                self.period_ms.setdefault((who, name), Thinned(KEPT)).add(steps / 1e6)
                self._last[who, name] = int(times[-1])

    def _answers(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        t = batch.transactions
        asked = np.flatnonzero((t.request != -1) & np.isin(t.outcome, _EXPECTED))
        if not len(asked):
            return
        frames, rows = batch.asking(t.request[asked])
        for who, op, mine in _by(bus, frames.servo_id[rows], frames.op[rows], asked):
            name = protocol.op_name(op)
            ok = t.outcome[mine] == OK
            self.expected[who] += len(mine)
            self.missing[who] += int((~ok).sum())
            known = mine[ok & (t.response_time_ns[mine] >= 0)]
            took = t.response_time_ns[known] / 1e6
            self.response_ms.setdefault((who, name), Thinned(KEPT)).add(took)
            doubt = np.maximum(t.uncertainty_ns[known], 0) / 1e6
            self.doubt_ms.setdefault((who, name), Thinned(KEPT)).add(doubt)

    def _values(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        v = batch.samples
        for who, number, rows in _by(bus, v.servo_id, v.register.astype(np.int64), None):
            register = protocol.registers[number]
            for role in np.unique(v.role[rows]).tolist():
                mine = rows[v.role[rows] == role]
                if role == CONFIG:
                    known = self.settings.setdefault((who, register.name), set())
                    for raw in np.unique(v.raw[mine]).tolist():
                        if len(known) < SETTINGS:
                            known.add(raw)
                    continue
                field = state_field(register)
                value = v.value[mine]
                value = value[~np.isnan(value)]
                if field is None or not len(value) or register.values or register.bits:
                    continue
                series = {MEASURED: self.measured, COMMANDED: self.commanded}.get(role)
                if series is not None:
                    series.setdefault((who, field), Thinned(KEPT)).add(value)


def _by(
    bus: str, servo: I64 | I16, number: I64, rows: I64 | None
) -> Iterator[tuple[Who, int, I64]]:
    """Yield each servo and number with its rows, in order."""
    keys = np.stack([servo.astype(np.int64), number.astype(np.int64)], 1)
    found, which = np.unique(keys, axis=0, return_inverse=True)
    which = which.reshape(-1)
    order = np.argsort(which, kind="stable")
    edges = np.searchsorted(which[order], np.arange(len(found) + 1))
    for k, (who, what) in enumerate(found.tolist()):
        mine = order[edges[k] : edges[k + 1]]
        yield Who(bus, who if who >= 0 else None), what, mine if rows is None else rows[mine]
