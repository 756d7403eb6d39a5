"""The entities of a Rerun recording: lines, lanes and logs that gather rows until they are sent.

Used by ``sniffer.sinks.rerun.sink``; imports rerun lazily as it does. Written for rerun-sdk 0.41.
"""

from __future__ import annotations

import abc
import dataclasses
import itertools
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from sniffer.ground.model import F64, I64, Severity
from sniffer.sinks.rerun.layout import Rgb, Track, mixed

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sniffer.ground.model import Anomaly

DATED_NS: Final = 946_684_800_000_000_000
"""2000-01-01: earlier times count from the start of a capture and are shown as a duration."""

LEVELS: Final = {Severity.NOTE: "INFO", Severity.WARN: "WARN", Severity.ERROR: "ERROR"}
WHITE: Final[Rgb] = (255, 255, 255)
BLACK: Final[Rgb] = (0, 0, 0)
REST: Final[Rgb] = (58, 62, 70)
"""A state of rest: it recedes."""

ALARM: Final[Rgb] = (205, 58, 58)


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
        self._styled = False

    @property
    def is_goal(self) -> bool:
        """Tell whether a value holds until the next one."""
        return self.track.quantity.startswith("goal_")

    def add(self, times: I64, values: F64) -> None:
        """Take rows; those without a value are left out."""
        known = ~np.isnan(values)
        if not known.all():
            times, values = times[known], values[known]
        if len(times):
            self.last_ns, self._last_value = int(times[-1]), float(values[-1])
            self.total += len(times)
        self._add(times, values)

    def held(self, end_ns: int) -> Curve:
        """Return a line beside this one that goes on with its last value."""
        track = dataclasses.replace(self.track, path=f"{self.track.path}/held")
        line = Curve(track, self._name, self._colour)
        line.add(np.array([self.last_ns, end_ns]), np.full(2, self._last_value))
        return line

    def style(self) -> Any:  # noqa: D102
        import rerun as rr

        if self._styled or not self.total:
            return None
        self._styled = True
        # Legends join what has one name: a second register needs no line of its own there.
        name = f"{self._name} goal" if self.is_goal else self._name
        colour = mixed(self._colour, WHITE, 0.5) if self.is_goal else self._colour
        if self.is_second:
            return rr.SeriesPoints(names=name, colors=colour, markers="Diamond", marker_sizes=3)
        if self.is_goal:
            return rr.SeriesLines(
                names=name, colors=colour, widths=0.8, interpolation_mode="StepAfter"
            )
        return rr.SeriesLines(names=name, colors=colour, widths=1.6)

    def _columns(self, values: list[Any]) -> Any:
        import rerun as rr

        return rr.Scalars.columns(scalars=np.concatenate(values))


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
