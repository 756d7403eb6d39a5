"""The entities of a Rerun recording: lines, lanes and logs that gather rows until they are sent.

Used by ``sniffer.sinks.rerun.sink``; imports rerun lazily as it does. Written for rerun-sdk 0.41.
"""

from __future__ import annotations

import abc
import dataclasses
import itertools
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

import numpy as np

from sniffer.ground.limits import DATED_NS
from sniffer.ground.model import F64, I64, Severity
from sniffer.sinks.rerun.layout import mixed

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sniffer.ground.colours import Rgb
    from sniffer.ground.model import Anomaly
    from sniffer.sinks.rerun.plots import Track

LEVELS: Final = {Severity.NOTE: "INFO", Severity.WARN: "WARN", Severity.ERROR: "ERROR"}
Shape = Literal["Cross", "Down"]

WHITE: Final[Rgb] = (255, 255, 255)
BLACK: Final[Rgb] = (0, 0, 0)
REST: Final[Rgb] = (58, 62, 70)
"""A state of rest: it recedes."""

ALARM: Final[Rgb] = (205, 58, 58)

SLOW_NS: Final = 500_000_000
"""Samples that are mostly further apart than this are shown one by one, in steps."""

LEARNED: Final = 512
FEW: Final = 4
"""Intervals from which the rhythm of a curve is learned: at most, and before anything is said."""

HOLE: Final = 5
LEAST_HOLE_NS: Final = 100_000_000
"""A line breaks where nothing comes for so many usual intervals, and for this long: nine of ten
intervals are no longer than a usual one, so a poll that has lost a few answers is no hole."""


class Entity(abc.ABC):
    """One entity of the recording, with the rows that wait to be sent to it."""

    def __init__(self, track: Track) -> None:
        self.track = track
        self.rows = 0
        self._times: list[I64] = []
        self._values: list[Any] = []

    def _add(self, times: I64, values: Any) -> None:
        if len(times):
            self._times.append(times)
            self._values.append(values)
            self.rows += len(times)

    def drain(self) -> tuple[I64, Any]:
        """Return the waiting rows, their times and what Rerun takes as columns, and forget them."""
        times, columns = np.concatenate(self._times), self._columns(self._values)
        self.rows, self._times, self._values = 0, [], []
        return times, columns

    def style(self) -> Any:
        """Return what is static about the entity where that is new or has changed, else None."""
        return None

    @abc.abstractmethod
    def _columns(self, values: list[Any]) -> Any: ...


class Curve(Entity):
    """Numbers over time.

    Where the samples are far apart it goes in steps: between them nobody knows. Where they stop for
    much longer than they use to, the line breaks.

    ``is_second`` marks a register that states what another one of the servo states more often: it
    is drawn as points, for a line through the few would contradict the other.
    """

    def __init__(self, track: Track, name: str, colour: Rgb) -> None:
        super().__init__(track)
        self._name, self._colour = name, colour
        self.total = 0
        self.last_ns = 0
        self.is_second = False
        self._last_value = 0.0
        self._rhythm = Rhythm()
        self._styled: tuple[bool, bool] | None = None

    @property
    def name(self) -> str:
        """What legends call it."""
        return self._name

    @property
    def colour(self) -> Rgb:
        """Its colour."""
        return self._colour

    @property
    def is_goal(self) -> bool:
        """Tell whether a value holds until the next one."""
        return self.track.quantity.startswith("goal_")

    def add(self, times: I64, values: F64) -> None:
        """Take rows; those without a value are left out."""
        known = ~np.isnan(values)
        if not known.all():
            times, values = times[known], values[known]
        if not len(times):
            return
        before = self.last_ns if self.total else int(times[0])
        self.last_ns, self._last_value = int(times[-1]), float(values[-1])
        self.total += len(times)
        if not self.is_goal:
            holes, ends = self._rhythm.holes(np.append(before, times))
            times, values = np.insert(times, holes, ends), np.insert(values, holes, np.nan)
        self._add(times, values)

    def held(self, end_ns: int) -> Curve:
        """Return a line beside this one that goes on with its last value."""
        track = dataclasses.replace(self.track, path=f"{self.track.path}/held")
        line = Curve(track, self._name, self._colour)
        line.add(np.array([self.last_ns, end_ns]), np.full(2, self._last_value))
        return line

    def style(self) -> Any:  # noqa: D102
        if not self.total or self._styled == (now := (self.is_second, self._rhythm.is_slow)):
            return None
        self._styled = now
        return self._drawn()

    def _drawn(self) -> Any:
        import rerun as rr

        # Legends join what has one name: a second register needs no line of its own there.
        name = f"{self._name} goal" if self.is_goal else self._name
        colour = mixed(self._colour, WHITE, 0.5) if self.is_goal else self._colour
        if self.is_second:
            return rr.SeriesPoints(names=name, colors=colour, markers="Diamond", marker_sizes=3)
        if self.is_goal:
            return rr.SeriesLines(
                names=name, colors=colour, widths=0.8, interpolation_mode="StepAfter"
            )
        if self._rhythm.is_slow:
            return rr.SeriesLines(
                names=name, colors=colour, widths=1.2, interpolation_mode="StepAfter"
            )
        return rr.SeriesLines(names=name, colors=colour, widths=1.6, interpolation_mode="Linear")

    def _columns(self, values: list[Any]) -> Any:
        import rerun as rr

        return rr.Scalars.columns(scalars=np.concatenate(values))


class Rhythm:
    """How far apart the samples of a curve are, learned from the first of them."""

    def __init__(self) -> None:
        self._apart = np.empty(0, np.int64)
        self._usual_ns = 0
        self.is_slow = False

    def holes(self, times: I64) -> tuple[I64, I64]:
        """Return before which of ``times[1:]`` a hole is, and when the line ends before it."""
        apart = np.diff(times)
        if len(self._apart) < LEARNED:
            more = apart[apart > 0][: LEARNED - len(self._apart)]
            if len(more):
                self._apart = np.append(self._apart, more)
                half, most = np.quantile(self._apart, (0.5, 0.9), method="lower").tolist()
                self._usual_ns = int(most)
                self.is_slow = half >= SLOW_NS
        if len(self._apart) < FEW or not self._usual_ns:
            return np.empty(0, np.int64), np.empty(0, np.int64)
        holes = np.flatnonzero(apart > max(HOLE * self._usual_ns, LEAST_HOLE_NS))
        return holes, times[holes] + self._usual_ns


class PerSecond(Curve):
    """A number for each second, drawn as steps; NaN where there is none."""

    def add(self, times: I64, values: F64) -> None:
        """Take rows as they are."""
        self.total += int(np.count_nonzero(values > 0))
        self._add(times, values)

    def _drawn(self) -> Any:
        import rerun as rr

        return rr.SeriesLines(
            names=self._name, colors=self._colour, widths=1.4, interpolation_mode="StepAfter"
        )


class Marks(Curve):
    """Points on a curve where something happened."""

    def __init__(self, track: Track, name: str, colour: Rgb, shape: Shape, size: float) -> None:
        super().__init__(track, name, colour)
        self._shape, self._size = shape, size

    def set(self, t_ns: int, value: float) -> None:
        """Set one."""
        self.total += 1
        self._add(np.array([t_ns], np.int64), np.array([value]))

    def _drawn(self) -> Any:
        import rerun as rr

        return rr.SeriesPoints(
            names=self._name, colors=self._colour, markers=self._shape, marker_sizes=self._size
        )


class Strip(Entity):
    """States over time; only changes are kept."""

    def __init__(self, track: Track, name: Callable[[int], str], colour: Rgb) -> None:
        super().__init__(track)
        self._name, self._colour = name, colour
        self._last: int | None = None
        self._colours: dict[str, Rgb] = {}
        self._styled = 0

    @property
    def rests(self) -> bool:
        """Tell whether it never left the state of rest."""
        return all(colour == REST for colour in self._colours.values())

    def add(self, times: I64, raw: I64) -> None:
        """Take rows; those that repeat the state before them are left out."""
        changed = np.empty(len(raw), bool)
        changed[0] = raw[0] != self._last
        np.not_equal(raw[1:], raw[:-1], out=changed[1:])
        self._last = int(raw[-1])
        at = np.flatnonzero(changed)
        self._add(times[at], [self._named(state) for state in raw[at].tolist()])

    def _named(self, raw: int) -> str:
        name = self._name(raw)
        if name not in self._colours:
            # White text must be read on it; each further state is a little darker.
            dark = 0.2 + 0.15 * len(self._colours) % 0.6
            self._colours[name] = mixed(self._colour, BLACK, dark) if raw else REST
        return name

    def style(self) -> Any:  # noqa: D102
        import rerun as rr

        if len(self._colours) == self._styled:
            return None
        self._styled = len(self._colours)
        return rr.StateConfiguration(
            values=list(self._colours), colors=list(self._colours.values())
        )

    def _columns(self, values: list[Any]) -> Any:
        import rerun as rr

        return rr.StateChange.columns(state=list(itertools.chain(*values)))


class LogLine(NamedTuple):
    """A line of a log: when, how much it matters, and what."""

    t_ns: int
    severity: Severity
    text: str


class Log(Entity):
    """Lines of text: a bus's anomalies, or incidents."""

    def add(self, anomalies: Sequence[Anomaly]) -> None:
        """Take anomalies."""
        self.tell([LogLine(a.t_ns, a.severity, f"{a.code}: {a.detail}") for a in anomalies])

    def tell(self, lines: Sequence[LogLine]) -> None:
        """Take lines."""
        self._add(np.array([line.t_ns for line in lines], np.int64), lines)

    def _columns(self, values: list[Any]) -> Any:
        import rerun as rr

        lines = list(itertools.chain(*values))
        return rr.TextLog.columns(
            text=[_dated(line) for line in lines], level=[LEVELS[line.severity] for line in lines]
        )


def _dated(line: LogLine) -> str:
    """Return time of day or seconds, and the text: the viewer's own time column is cut short."""
    t = line.t_ns
    if t >= DATED_NS:
        time = str(np.datetime64(t, "ns").astype("datetime64[ms]"))[11:]
    else:
        time = f"+{t / 1e9:.3f} s"
    return f"{time}  {line.text}"
