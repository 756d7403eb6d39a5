"""Batches -> a Rerun recording: a .rrd that opens with its own layout, or a live viewer.

Values become ``Scalars`` at ``/<bus>/servo/<id>/<register>``, whole columns at a time; enumerated
registers and alarms become ``StateChange``, only where they change; anomalies become ``TextLog`` at
``/<bus>/anomalies``, incidents at ``/<bus>/incidents`` and at their servos. A packet without a
value adds nothing, so no line drops to zero. rerun (0.41) is imported when a sink is made.
"""

from __future__ import annotations

import functools
import itertools
import math
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.decoding.called import ServoNames
from sniffer.decoding.durations import FIGURES, Quantiles
from sniffer.decoding.sink import bus_of
from sniffer.ground.codes import OK, RESPONSE, WHOLE
from sniffer.ground.colours import GREY, Colours
from sniffer.ground.files import open_binary
from sniffer.ground.limits import DATED_NS
from sniffer.ground.model import Clock, OutputError, Severity
from sniffer.sinks.rerun.derived import groups
from sniffer.sinks.rerun.entities import ALARM, WHITE, Curve, Entity, Log, LogLine, Strip
from sniffer.sinks.rerun.gauges import Gauges
from sniffer.sinks.rerun.labels import ALL, entity_path, named, words
from sniffer.sinks.rerun.layout import TIMELINE, application_id, blueprint
from sniffer.sinks.rerun.plots import (
    ALARMS,
    EVERYONE,
    POSITION,
    RESPONSE_TIME,
    BusFigures,
    TimeRange,
    Track,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    import rerun as rr

    from sniffer.ground.model import Batch, Chunk
    from sniffer.protocols.base import BusProtocol
    from sniffer.sinks.rerun.gauges import Whose

FLUSH_S: Final = 60.0
"""How long a slow disk or viewer may take for what is still to be written."""

INCIDENTS: Final = "incidents"
"""What entities are called that tell of incidents."""

ROWS: Final = 5000
"""Rows an entity gathers before they are sent: from 1000 on a call costs less than its rows."""


class RerunSink:
    """Writes what it is given to a .rrd file, or to a recording that somebody else has connected.

    Args:
        path: the file; its layout is written by ``close``, when all servos are known.
        recording: instead, a connected recording. Every batch is sent at once, the layout anew when
            something appears; ``close`` does not disconnect it.
        window_s: how much of the time is shown at once.

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
            if path.exists() and not path.is_file() and not path.is_char_device():
                # the SDK would wait for a reader where no signal reaches it
                raise OutputError(f"{path} is no file: the Rerun SDK writes to files only")
            if not _is_utf8(path):
                raise OutputError(f"{path}: the Rerun SDK takes names in UTF-8 only")
            open_binary(path).close()
            self._rec = rr.RecordingStream(application_id(path.stem))
            try:
                self._rec.save(path)
            except RuntimeError as error:
                raise OutputError(f"{path}: cannot be written ({error})") from None
            self._rec.send_recording_name(path.stem)
        elif recording is not None:
            self._rec = recording
        else:
            raise TypeError("RerunSink needs a path or a recording")
        self._path, self._live = path, path is None
        self._window_s = window_s
        self._lines: dict[tuple[str, int, int], Curve] = {}
        self._lanes: dict[tuple[str, int, int], Strip] = {}
        self._logs: dict[str, Log] = {}
        self._stories: dict[str, Log] = {}
        self._marks: dict[tuple[str, int], Log] = {}
        self._colours = Colours()
        self._names = ServoNames()
        self._gauges = Gauges(self._who, self._line_itself, self._entity)
        self._first_error: int | None = None
        self._dated: bool | None = None
        self._span: tuple[int, int] | None = None
        self._doubt: dict[str, Quantiles] = {}
        self._laid_out = 0  # entities in the layout last sent

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take chunks; Rerun has no use for them."""

    def call(self, names: ServoNames) -> None:
        """Take what servos are called, in paths and legends."""
        self._names = names

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Take what one pass decided; a protocol that shares its wire has entities of its own."""
        bus = bus_of(bus, protocol, batch)
        self._clock(batch)
        self._samples(bus, protocol, batch)
        self._alarms(bus, protocol, batch)
        self._response_times(bus, protocol, batch)
        self._gauges.write(bus, protocol, batch)
        if batch.anomalies:
            if bus not in self._logs:
                import rerun as rr

                path = rr.new_entity_path([bus, "anomalies"])
                self._logs[bus] = Log(Track(path, bus, EVERYONE, ""))
            shown = batch.shows("anomalies", len(batch.anomalies)).tolist()
            found = itertools.compress(batch.anomalies, shown)
            self._logs[bus].add([self._names.on(bus, anomaly) for anomaly in found])
        self._send(1 if self._live else ROWS)
        if self._live:
            self._style()
            self._layout()

    def incident(self, bus: str, servo_ids: Sequence[int], line: LogLine) -> None:
        """Take what has become of an incident: it stands at the bus and at each of its servos."""
        import rerun as rr

        if self._dated is None:  # whoever decodes live may be behind what is told of incidents
            self._dated = line.t_ns >= DATED_NS
        line = line._replace(text=self._names.sentence(bus, line.text))
        path = rr.new_entity_path([bus, INCIDENTS])
        if bus not in self._stories:
            self._stories[bus] = Log(Track(path, bus, EVERYONE, ""))
        self._stories[bus].tell([line])
        for servo in servo_ids:
            mark = self._marks.get((bus, servo))
            if mark is None:
                track = Track(self._entity(bus, servo, INCIDENTS), bus, servo, "")
                mark = self._marks[bus, servo] = Log(track)
            mark.tell([line])
            self._gauges.mark(bus, servo, line.t_ns, "incident")
        self._send(1 if self._live else ROWS)
        if self._live:
            self._layout()

    def shows(self, bus: str, servo: int) -> bool:
        """Tell whether anything of a servo is drawn."""
        return any(key[:2] == (bus, servo) for lines in (self._lines, self._lanes) for key in lines)

    def close(self) -> None:
        """Send what waits; finish the file with its layout."""
        self._gauges.close(is_whole=not self._live)
        if not self._live:
            self._rank()
        self._send(1)
        self._style()
        self._layout()
        try:
            self._rec.flush(timeout_sec=FLUSH_S)
        except RuntimeError as error:
            where = self._path or "the Rerun viewer"
            raise OutputError(f"{where}: cannot be written ({error})") from error
        finally:
            if not self._live:
                self._rec.disconnect()

    def _clock(self, batch: Batch) -> None:
        """Learn the span of time, and from the first time whether it is a date."""
        f = batch.frames
        edges = [a.t_ns for a in batch.anomalies]
        if self._first_error is None:
            shown = batch.shows("anomalies", len(batch.anomalies)).tolist()
            found = itertools.compress(batch.anomalies, shown)
            errors = [a.t_ns for a in found if a.severity >= Severity.ERROR]
            self._first_error = min(errors, default=None)
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
        whole = (s.part == WHOLE) & ((s.servo_id >= 0) | (ALL in protocol.everyone))
        if not whole.all():
            s = s.take(whole)
        width = len(protocol.registers)
        measured = []
        for key, rows in groups((s.servo_id.astype(np.int64) - ALL) * width + s.register):
            servo, number = key // width + ALL, key % width
            register = protocol.registers[number]
            if register.values or register.bits:
                self._lane(bus, protocol, servo, number).add(s.t_ns[rows], s.raw[rows])
                continue
            times, values = s.t_ns[rows], s.value[rows]
            self._line(bus, protocol, servo, number).add(times, values)
            if register.quantity == f"goal_{POSITION}":
                is_all = servo in protocol.everyone and servo
                self._gauges.aim(bus, ALL if is_all else servo, register.unit, times, values)
            elif register.quantity == POSITION:
                measured.append((servo, register.unit, (times, values)))
        for servo, unit, position in measured:
            self._gauges.measure(bus, protocol, servo, unit, position)

    def _alarms(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        f = batch.frames
        told = (f.kind == RESPONSE) & (f.status >= 0) & (f.servo_id >= 0)
        told = np.flatnonzero(told & batch.shows("frames", len(f)))
        for servo, rows in groups(f.servo_id[told].astype(np.int64)):
            at = told[rows]
            status = f.status[at].astype(np.int64)
            self._lane(bus, protocol, servo, -1).add(f.t_end[at], status)

    def _response_times(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        f, t = batch.frames, batch.transactions
        timed = (t.outcome == OK) & (t.response_time_ns >= 0)
        timed = np.flatnonzero(timed & batch.shows("transactions", len(t)))
        response = t.response[timed]
        servo = f.servo_id[response].astype(np.int64)
        servo = np.where(servo >= 0, servo, f.servo_id[t.request[timed]])
        if len(timed):
            spread = t.uncertainty_ns[timed]
            self._doubt.setdefault(bus, Quantiles()).add(spread, np.zeros_like(spread))
        for key, rows in groups(servo):
            took = t.response_time_ns[timed[rows]] / 1e6
            times = f.t_end[response[rows]]
            self._line(bus, protocol, key, -1).add(times, took)
            self._gauges.time(bus, protocol, key, (times, took))

    def _line(self, bus: str, protocol: BusProtocol, servo: int, number: int) -> Curve:
        """Return the line of a register, or of the response times (-1)."""
        line = self._lines.get((bus, servo, number))
        if line is None:
            who, name, colour = self._who(bus, protocol, servo)
            if number < 0:
                path = self._entity(bus, servo, RESPONSE_TIME)
                track = Track(path, bus, who, RESPONSE_TIME, "ms", who=name)
            else:
                r = protocol.registers[number]
                path = self._entity(bus, servo, r.name)
                track = Track(path, bus, who, r.quantity, r.unit, who=name)
            line = Curve(track, name, colour)
            line.is_second = self._live and any(
                (t.track.quantity, t.track.unit) == (track.quantity, track.unit)
                for key, t in self._lines.items()
                if key[:2] == (bus, servo) and track.quantity
            )
            self._lines[bus, servo, number] = line
        return line

    def _lane(self, bus: str, protocol: BusProtocol, servo: int, number: int) -> Strip:
        """Return the lane of an enumerated register, or of the alarms (-1)."""
        lane = self._lanes.get((bus, servo, number))
        if lane is None:
            who, _, colour = self._who(bus, protocol, servo)
            name: Callable[[int], str]
            if number < 0:
                track = Track(self._entity(bus, servo, ALARMS), bus, who, ALARMS, is_state=True)
                colour, name = ALARM, lambda raw: words(protocol.status_names(raw))
            else:
                r = protocol.registers[number]
                path = self._entity(bus, servo, r.name)
                track = Track(path, bus, who, r.quantity, is_state=True)
                name = functools.partial(named, r)
            lane = self._lanes[bus, servo, number] = Strip(track, name, colour)
        return lane

    def _who(self, bus: str, protocol: BusProtocol, servo: int) -> Whose:
        """Return whose a track is, what legends call it, and its colour."""
        # The id 0 of some protocols is both: a servo's own, and heard by all.
        if servo in protocol.everyone and servo:
            return EVERYONE, "all servos", WHITE
        return servo, self._names.legend(bus, servo), self._colours.of(servo)

    def _line_itself(self) -> Whose:
        """Return the same of a track that is nobody's: how much is said on the line."""
        return EVERYONE, "bus", GREY

    def _entity(self, bus: str, servo: int, name: str) -> str:
        """Return the path of an entity of a servo, or of all."""
        return entity_path(bus, servo, name, self._names.of(bus, servo))

    def _entities(self) -> Iterator[Entity]:
        for entities in (self._lines, self._lanes, self._logs, self._stories, self._marks):
            yield from entities.values()
        yield from self._gauges.curves()

    def _send(self, least: int) -> None:
        """Send the entities that have at least so many rows waiting."""
        import rerun as rr

        for entity in self._entities():
            if entity.rows < least:
                continue
            times, columns = entity.drain()
            column = (
                rr.TimeColumn(TIMELINE, timestamp=times.view("datetime64[ns]"))
                if self._dated
                else rr.TimeColumn(TIMELINE, duration=times.view("timedelta64[ns]"))
            )
            self._rec.send_columns(entity.track.path, [column], columns, strict=True)

    def _style(self) -> None:
        for entity in self._entities():
            if (style := entity.style()) is not None:
                self._rec.log(entity.track.path, style, static=True)

    def _tracks(self) -> list[Track]:
        """Return what the layout shows; a servo without any alarm needs no lane for them."""
        lines = [line.track for line in self._lines.values() if line.total]
        lines += self._gauges.tracks()
        return lines + [
            lane.track
            for lane in self._lanes.values()
            if not (lane.track.quantity == ALARMS and lane.rests)
        ]

    def _layout(self) -> None:
        """Send the layout, if it is another than the one last sent."""
        logs: dict[str, list[str]] = {}
        for entities in (self._stories, self._logs):
            for bus, log in entities.items():
                logs.setdefault(bus, []).append(log.track.path)
        tracks = self._tracks()
        shown = len(tracks) + sum(map(len, logs.values()))
        if shown == self._laid_out:
            return
        self._laid_out = shown
        plan = blueprint(
            tracks,
            logs,
            TimeRange(self._span, self._window_s, self._first_error, is_live=self._live),
            figures={bus: self._figures(bus) for bus in {t.bus for t in tracks}},
        )
        if plan is not None:
            self._rec.send_blueprint(plan)

    def _figures(self, bus: str) -> BusFigures:
        doubt = self._doubt[bus].at(FIGURES["p99"]) if bus in self._doubt else None
        # live, who is far off may be another one a moment later
        astray = "" if self._live else self._gauges.astray().get(bus, "")
        doubt_ns = 0 if doubt is None else doubt.high
        load = self._gauges.loads.get(bus, math.inf)
        return BusFigures(doubt_ns, astray, load, self._gauges.step_s)

    def _rank(self) -> None:
        """Tell first registers from second ones, and draw each goal on to the end.

        A goal still holds there, and a single one would not be seen.
        """
        alike: dict[tuple[str, int, str, str], list[tuple[int, Curve]]] = {}
        for (bus, servo, number), line in self._lines.items():
            if line.track.quantity:
                key = bus, servo, line.track.quantity, line.track.unit
                alike.setdefault(key, []).append((number, line))
        end = self._span[1] if self._span else 0
        for (bus, servo, *_), lines in alike.items():
            number, first = max(lines, key=lambda each: each[1].total)
            for _, line in lines:
                line.is_second = line is not first
            latest = max(line.last_ns for _, line in lines)
            if first.is_goal and first.total and first.last_ns == latest < end:
                self._lines[bus, servo, -2 - number] = first.held(end)


def _is_utf8(path: Path) -> bool:
    """Tell whether a file's name, which may be any bytes, is text."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True
