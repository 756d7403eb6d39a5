"""Batches -> a Rerun recording: a .rrd that opens with its own layout, or a live viewer.

Values become ``Scalars`` at ``/<bus>/servo/<id>/<register>``, whole columns at a time; enumerated
registers and alarms become ``StateChange``, only where they change; anomalies become ``TextLog`` at
``/<bus>/anomalies``. A packet without a value adds nothing, so no line drops to zero. rerun is
imported when a sink is made, not before. Written for rerun-sdk 0.41.
"""

from __future__ import annotations

import dataclasses
import itertools
import uuid
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.model import (
    F64,
    I64,
    OK,
    RESPONSE,
    WHOLE,
    Clock,
    Severity,
)
from sniffer.sinks.files import open_binary
from sniffer.sinks.rerun_layout import (
    ALARMS,
    EVERYONE,
    RESPONSE_TIME,
    TIMELINE,
    Colours,
    Rgb,
    Track,
    blueprint,
    mixed,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    import rerun as rr

    from sniffer.model import Anomaly, Batch, Chunk
    from sniffer.protocols.base import BusProtocol

ROWS: Final = 5000
"""Rows an entity gathers before they are sent: from 1000 on a call costs less than its rows."""

DATED_NS: Final = 946_684_800_000_000_000
"""2000-01-01: earlier times count from the start of a capture and are shown as a duration."""

LEVELS: Final = {Severity.NOTE: "INFO", Severity.WARN: "WARN", Severity.ERROR: "ERROR"}
WHITE: Final[Rgb] = (255, 255, 255)
BLACK: Final[Rgb] = (0, 0, 0)
REST: Final[Rgb] = (58, 62, 70)
ALARM: Final[Rgb] = (205, 58, 58)


class _Entity:
    """One entity of the recording, with the rows that wait to be sent to it."""

    def __init__(self, track: Track) -> None:
        self.track = track
        self.rows = 0
        self._times: list[I64] = []

    def columns(self) -> Any:
        """Return the waiting rows as Rerun takes them."""
        raise NotImplementedError

    def style(self) -> Any:
        """Return what is static about the entity, once it is new or has changed; else None."""
        raise NotImplementedError

    def times(self) -> I64:
        """Return the waiting rows' times."""
        return self._times[0] if len(self._times) == 1 else np.concatenate(self._times)

    def sent(self) -> None:
        """Forget the rows."""
        self.rows = 0
        self._times = []


class _Line(_Entity):
    """Numbers over time."""

    def __init__(self, track: Track, name: str, colour: Rgb) -> None:
        super().__init__(track)
        self._name, self._colour = name, colour
        self._values: list[F64] = []
        self._styled = False
        self.last: tuple[int, float] | None = None

    @property
    def is_goal(self) -> bool:
        """Tell whether the values hold until the next one."""
        return self.track.quantity.startswith("goal_")

    def add(self, times: I64, values: F64) -> None:
        """Take rows; those without a value are left out."""
        known = ~np.isnan(values)
        if not known.all():
            times, values = times[known], values[known]
        if len(times):
            self._times.append(times)
            self._values.append(values)
            self.rows += len(times)
            self.last = int(times[-1]), float(values[-1])

    def held(self, end: int) -> _Line:
        """Return a line beside this one, that goes on with its last value."""
        assert self.last is not None
        track = dataclasses.replace(self.track, path=f"{self.track.path}/held")
        line = _Line(track, self._name, self._colour)
        time, value = self.last
        line.add(np.array([time, end]), np.array([value, value]))
        return line

    def columns(self) -> Any:
        import rerun as rr

        values = self._values[0] if len(self._values) == 1 else np.concatenate(self._values)
        return rr.Scalars.columns(scalars=values)

    def style(self) -> Any:
        import rerun as rr

        if self._styled:
            return None
        self._styled = True
        if self.is_goal:
            return rr.SeriesLines(
                names=f"{self._name} goal",
                colors=mixed(self._colour, WHITE, 0.5),
                widths=0.8,
                interpolation_mode="StepAfter",
            )
        return rr.SeriesLines(names=self._name, colors=self._colour, widths=1.6)

    def sent(self) -> None:
        super().sent()
        self._values = []


class _Lane(_Entity):
    """States over time; only changes are kept."""

    def __init__(self, track: Track, name: Callable[[int], str], colour: Rgb) -> None:
        super().__init__(track)
        self._name, self._colour = name, colour
        self._states: list[str] = []
        self._last: int | None = None
        self._colours: dict[str, Rgb] = {}
        self._styled = 0

    @property
    def is_plain(self) -> bool:
        """Tell whether nothing but rest was ever seen."""
        return all(colour == REST for colour in self._colours.values())

    def add(self, times: I64, raw: I64) -> None:
        """Take rows; those that repeat the state before them are left out."""
        changed = np.empty(len(raw), bool)
        changed[0] = raw[0] != self._last
        np.not_equal(raw[1:], raw[:-1], out=changed[1:])
        at = np.flatnonzero(changed)
        if not len(at):
            return
        self._times.append(times[at])
        for state in raw[at].tolist():
            name = self._name(state)
            self._states.append(name)
            if name not in self._colours:
                shade = 0.2 * sum(c != REST for c in self._colours.values()) % 1.0
                self._colours[name] = mixed(self._colour, BLACK, 0.2 + shade) if state else REST
        self._last = int(raw[-1])
        self.rows += len(at)

    def columns(self) -> Any:
        import rerun as rr

        return rr.StateChange.columns(state=self._states)

    def style(self) -> Any:
        import rerun as rr

        if len(self._colours) == self._styled:
            return None
        self._styled = len(self._colours)
        return rr.StateConfiguration(
            values=list(self._colours), colors=list(self._colours.values())
        )

    def sent(self) -> None:
        super().sent()
        self._states = []


class _Log(_Entity):
    """A bus's anomalies."""

    def __init__(self, track: Track) -> None:
        super().__init__(track)
        self._anomalies: list[Anomaly] = []

    def add(self, anomalies: Sequence[Anomaly]) -> None:
        """Take anomalies."""
        self._anomalies += anomalies
        self._times.append(np.array([a.t_ns for a in anomalies], np.int64))
        self.rows += len(anomalies)

    def columns(self) -> Any:
        import rerun as rr

        return rr.TextLog.columns(
            text=[_text(a) for a in self._anomalies],
            level=[LEVELS[a.severity] for a in self._anomalies],
        )

    def style(self) -> Any:
        return None

    def sent(self) -> None:
        super().sent()
        self._anomalies = []


def _text(anomaly: Anomaly) -> str:
    """Return time of day or seconds, code and detail: the viewer's own time column is cut short."""
    t = anomaly.t_ns
    if t >= DATED_NS:
        time = str(np.datetime64(t, "ns").astype("datetime64[ms]"))[11:]
    else:
        time = f"+{t / 1e9:.3f} s"
    return f"{time}  {anomaly.code}: {anomaly.detail}"


class RerunSink:
    """Writes what it is given to a .rrd file, or to a recording that somebody else has connected.

    Args:
        path: the file; its layout is written by ``close``, when all servos are known.
        recording: instead, a connected recording. Every batch is sent at once, the layout anew when
            something appears; ``close`` does not disconnect it.
        window_s: how much of the past a live recording shows.

    Raises:
        OutputError: the file cannot be written.
    """

    def __init__(
        self,
        path: Path | None = None,
        *,
        recording: rr.RecordingStream | None = None,
        window_s: float = 20.0,
    ) -> None:
        import rerun as rr

        if path is not None:
            open_binary(path).close()
            # The viewer keeps one layout an application, so each file is one.
            self._rec = rr.RecordingStream(f"sniffer {path.stem} {uuid.uuid4().hex[:6]}")
            self._rec.save(path)
            self._rec.send_recording_name(path.stem)
        elif recording is not None:
            self._rec = recording
        else:
            raise TypeError("RerunSink needs a path or a recording")
        self._live = path is None
        self._window_s = window_s
        self._lines: dict[tuple[str, int, int], _Line] = {}
        self._lanes: dict[tuple[str, int, int], _Lane] = {}
        self._logs: dict[str, _Log] = {}
        self._colours = Colours()
        self._dated: bool | None = None
        self._span: tuple[int, int] | None = None
        self._doubt_ns: dict[str, int] = {}
        self._laid_out = 0  # entities in the layout last sent

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take chunks; Rerun has no use for them."""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Take what one pass decided."""
        self._clock(batch)
        self._samples(bus, protocol, batch)
        self._alarms(bus, protocol, batch)
        self._response_times(bus, protocol, batch)
        if batch.anomalies:
            if bus not in self._logs:
                self._logs[bus] = _Log(Track(_path(bus, "anomalies"), bus, EVERYONE, ""))
            self._logs[bus].add(batch.anomalies)
        self._send(1 if self._live else ROWS)
        if self._live:
            self._layout()

    def close(self) -> None:
        """Send what waits; finish the file with its layout."""
        if self._live:
            self._send(1)
            self._rec.flush()
            return
        self._hold()
        self._send(1)
        self._layout()
        self._rec.disconnect()

    def _clock(self, batch: Batch) -> None:
        """Learn the span of time, and from the first time whether it is a date."""
        f = batch.frames
        edges = [a.t_ns for a in batch.anomalies]
        if len(f):
            edges += [int(f.t_start.min()), int(f.t_end.max())]
        if not edges:
            return
        first, last = min(edges), max(edges)
        if self._span is None:
            self._dated = batch.clock != Clock.NONE and first >= DATED_NS
            if self._dated and not self._live:
                self._rec.send_recording_start_time_nanos(first)
        else:
            first, last = min(first, self._span[0]), max(last, self._span[1])
        self._span = first, last

    def _samples(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        s = batch.samples
        whole = (s.part == WHOLE) & (s.servo_id >= 0)
        if not whole.all():
            s = s.take(whole)
        width = len(protocol.registers)
        for key, rows in _groups(s.servo_id.astype(np.int64) * width + s.register):
            servo, number = divmod(key, width)
            register = protocol.registers[number]
            if register.values or register.bits:
                self._lane(bus, protocol, servo, number).add(s.t_ns[rows], s.raw[rows])
            else:
                self._line(bus, protocol, servo, number).add(s.t_ns[rows], s.value[rows])

    def _alarms(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        f = batch.frames
        told = np.flatnonzero((f.kind == RESPONSE) & (f.status >= 0) & (f.servo_id >= 0))
        for servo, rows in _groups(f.servo_id[told].astype(np.int64)):
            at = told[rows]
            status = f.status[at].astype(np.int64)
            self._lane(bus, protocol, servo, -1).add(f.t_end[at], status)

    def _response_times(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        f, t = batch.frames, batch.transactions
        timed = np.flatnonzero((t.outcome == OK) & (t.response_time_ns >= 0))
        response = t.response[timed]
        servo = f.servo_id[response].astype(np.int64)
        servo = np.where(servo >= 0, servo, f.servo_id[t.request[timed]])
        if len(timed):
            doubt = int(t.uncertainty_ns[timed].max())
            self._doubt_ns[bus] = max(doubt, self._doubt_ns.get(bus, 0))
        for key, rows in _groups(servo):
            took = t.response_time_ns[timed[rows]] / 1e6
            self._line(bus, protocol, key, -1).add(f.t_end[response[rows]], took)

    def _line(self, bus: str, protocol: BusProtocol, servo: int, number: int) -> _Line:
        """Return the line of a register, or of the response times (-1)."""
        line = self._lines.get((bus, servo, number))
        if line is None:
            who, name, colour = self._who(protocol, servo)
            if number < 0:
                path = _path(bus, "servo", servo, RESPONSE_TIME)
                track = Track(path, bus, who, RESPONSE_TIME, "ms")
            else:
                r = protocol.registers[number]
                path = _path(bus, "servo", servo, r.name)
                track = Track(path, bus, who, r.quantity, r.unit)
            line = self._lines[bus, servo, number] = _Line(track, name, colour)
        return line

    def _lane(self, bus: str, protocol: BusProtocol, servo: int, number: int) -> _Lane:
        """Return the lane of an enumerated register, or of the alarms (-1)."""
        lane = self._lanes.get((bus, servo, number))
        if lane is None:
            who, _, colour = self._who(protocol, servo)
            name: Callable[[int], str]
            if number < 0:
                track = Track(_path(bus, "servo", servo, ALARMS), bus, who, ALARMS, is_state=True)
                colour, name = ALARM, lambda raw: _words(protocol.status_names(raw))
            else:
                r = protocol.registers[number]
                path = _path(bus, "servo", servo, r.name)
                track = Track(path, bus, who, r.quantity, is_state=True)
                name = lambda raw: _words(r.names(raw), raw)  # noqa: E731
            lane = self._lanes[bus, servo, number] = _Lane(track, name, colour)
        return lane

    def _who(self, protocol: BusProtocol, servo: int) -> tuple[int, str, Rgb]:
        """Return whose a track is, what legends call it, and its colour."""
        # The id 0 of some protocols is both: a servo's own, and heard by all.
        if servo in protocol.everyone and servo:
            return EVERYONE, "all servos", WHITE
        return servo, f"servo {servo}", self._colours.of(servo)

    def _entities(self) -> Iterator[_Entity]:
        for entities in (self._lines, self._lanes, self._logs):
            yield from entities.values()

    def _send(self, least: int) -> None:
        """Send the entities that have at least so many rows waiting."""
        import rerun as rr

        for entity in self._entities():
            if entity.rows < least:
                continue
            path = entity.track.path
            if (style := entity.style()) is not None:
                self._rec.log(path, style, static=True)
            times = entity.times()
            column = (
                rr.TimeColumn(TIMELINE, timestamp=times.view("datetime64[ns]"))
                if self._dated
                else rr.TimeColumn(TIMELINE, duration=times.view("timedelta64[ns]"))
            )
            self._rec.send_columns(path, [column], entity.columns(), strict=True)
            entity.sent()

    def _tracks(self) -> list[Track]:
        """Return what the layout shows; a servo without any alarm needs no lane for them."""
        lines = [line.track for line in self._lines.values()]
        alarms = [k for k in self._lanes if k[2] < 0 and self._lanes[k].is_plain]
        lanes = [lane.track for k, lane in self._lanes.items() if k not in alarms]
        return lines + lanes

    def _layout(self) -> None:
        """Send the layout, if it is another than the one last sent."""
        logs = {bus: log.track.path for bus, log in self._logs.items()}
        tracks = self._tracks()
        if len(tracks) + len(logs) == self._laid_out:
            return
        self._laid_out = len(tracks) + len(logs)
        plan = blueprint(
            tracks,
            logs,
            span_ns=None if self._live else self._span,
            window_s=self._window_s if self._live else None,
            doubt_ns=self._doubt_ns,
        )
        self._rec.send_blueprint(plan)

    def _hold(self) -> None:
        """Draw each goal on to the end: it still holds, and a single point would not be seen."""
        end = self._span[1] if self._span else 0
        for (bus, servo, number), line in list(self._lines.items()):
            if line.is_goal and line.last is not None and line.last[0] < end:
                self._lines[bus, servo, -2 - number] = line.held(end)


def _path(*parts: object) -> str:
    import rerun as rr

    return rr.new_entity_path([str(p) for p in parts])


def _words(names: str | Sequence[str] | None, raw: int = 0) -> str:
    """Return a state's name as people read it."""
    if names == "unknown":
        return f"unknown ({raw})"
    if isinstance(names, str):
        return names.replace("_", " ")
    return ", ".join(names or ()).replace("_", " ") or "none"


def _groups(keys: I64) -> Iterator[tuple[int, I64]]:
    """Yield each key with its rows, in order."""
    if not len(keys):
        return
    # Sorting 16-bit numbers is a radix sort, ten times faster.
    narrow = keys.astype(np.uint16) if int(keys.max()) < 1 << 16 else keys
    order = np.argsort(narrow, kind="stable")
    ordered = narrow[order]
    edges = [0, *(np.flatnonzero(ordered[1:] != ordered[:-1]) + 1).tolist(), len(keys)]
    for a, b in itertools.pairwise(edges):
        yield int(ordered[a]), order[a:b]
