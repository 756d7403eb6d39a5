"""Charts over time: the curves of a servo, the load of a bus, and the incidents above them.

All charts of a report have one time axis. What is essential is drawn; the script of the page only
adds a read-out and a closer look.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.ground.amounts import number
from sniffer.ground.model import NS, Clock
from sniffer.ground.units import sign_of
from sniffer.reports import svg
from sniffer.reports.markup import Markup, tag
from sniffer.reports.shapes import shape
from sniffer.statistics.figures import (
    BYTES,
    ERROR,
    GOAL,
    LONGEST,
    MISSING,
    POSITION,
    SHORTEST,
    TROUBLE,
    UNCLAIMED,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from sniffer.diagnosis.model import Incident
    from sniffer.ground.model import F64
    from sniffer.statistics.collector import Collector
    from sniffer.statistics.figures import ServoFigures, WireFigures
    from sniffer.statistics.grid import Trace

BITS: Final = 10
"""Bits of a byte on the line: start, eight, stop."""

CROWD: Final = 8
"""Servos that have curves in full resolution; twice as many have half of it, and so on."""

LOAD_NS: Final = 100_000_000
"""The load of a bus is told for no shorter time: within less it is none or all."""

LOAD_TOPS: Final = (1.0, 10.0, 100.0)
"""The load is drawn up to one of these, in percent: of a line that is idle for hours 100 shows
nothing."""

LOAD_BARS: Final = 24
"""The load is told for so many stretches at least, however short the capture."""

BARS: Final = 256
"""Bars of a chart at most: each is some pixels wide."""

MARKS: Final = 8
"""Incidents above the curves of a servo, the first ones."""

LATE: Final = 70.0
"""Behind this share of the axis a mark's text stands before it, in percent."""

LAST: Final = 95.0
"""A label behind this share of the axis stands before its place, so that it has room."""

SPAN: Final[Mapping[str, float]] = {"V": 1.0, "degC": 5.0, "%": 5.0, "deg": 2.0, "mm": 0.5}
"""A value axis is no shorter than this, so that noise is not drawn as motion."""

STEPS_S: Final = (
    *(0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300),
    *(600, 900, 1800, 3600, 7200, 10800, 21600, 43200, 86400, 7 * 86400, 30 * 86400, 365 * 86400),
)
"""Steps of a time axis, in seconds."""

TICKS: Final = 8


class Ink(NamedTuple):
    """One line of a chart: how it is drawn (a class of the style sheet) and what it is."""

    style: str
    name: str
    path: str


@dataclass(frozen=True, slots=True)
class Time:
    """The time axis: ``size`` buckets of ``width_ns`` from ``first_ns`` on, ``factor`` in one."""

    first_ns: int
    width_ns: int
    size: int
    factor: int = 1
    clock: Clock = Clock.FILE

    def share(self, t_ns: int) -> float:
        """Return where a time stands, in percent."""
        at = 100 * (t_ns - self.first_ns) / (self.width_ns * max(self.size, 1))
        return round(min(max(at, 0.0), 100.0), 2)

    def ticks(self) -> list[tuple[float, str]]:
        """Return places in percent and labels, counted from the beginning."""
        seconds = self.width_ns * self.size / NS
        step = next((s for s in STEPS_S if seconds / s <= TICKS), STEPS_S[-1])
        count = int(seconds / step)
        return [(round(100 * k * step / seconds, 2), label(k * step)) for k in range(count + 1)]


def label(seconds: float) -> str:
    """Return a time since the beginning: seconds, then minutes, then hours."""
    if seconds < 120:
        return f"{seconds:g} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 120:
        return f"{minutes}:{rest:02d} min" if rest else f"{minutes} min"
    return f"{minutes // 60}:{minutes % 60:02d} h"


class Charts:
    """Draws the curves of a collector."""

    def __init__(self, collector: Collector, servos: int, clock: Clock) -> None:
        grid = collector.grid
        factor = 1
        while servos > CROWD * factor:
            factor *= 2
        size = -(-grid.size // factor)
        self.time = Time(grid.first_ns, grid.width_ns * factor, size, factor, clock)
        self._curves = grid.curves()

    def of(self, number: int | None) -> Trace | None:
        """Return a curve by its number; None: it is empty, or was not kept."""
        curve = self._curves.get(-1 if number is None else number)
        return svg.coarser(curve, self.time.factor) if curve is not None and len(curve) else None

    def value(self, mine: ServoFigures, quantity: str) -> tuple[Trace | None, str]:
        """Return the curve of a quantity, in the unit it has most often."""
        name = mine.unit_of(quantity)
        known = None if name is None else mine.values[quantity, name].curve
        return self.of(known), name or ""

    def servo(self, mine: ServoFigures, incidents: Sequence[Incident]) -> Markup:
        """Return all charts of a servo, under the marks of the incidents that concern it."""
        tracks = [
            self._position(mine, incidents),
            self._error(mine, incidents),
            *(
                self._plain(mine, quantity, incidents)
                for quantity in ("load", "current", "voltage", "temperature")
            ),
            self._replies(mine, incidents),
        ]
        shown = [track for track in tracks if track is not None]
        if not shown:
            return tag("p", "No value of it was heard.", cls="dim")
        return self._under(self._marks(incidents), shown)

    def bus(self, wire: WireFigures, incidents: Sequence[Incident]) -> Markup:
        """Return the load of a bus, and how often something was wrong, over time."""
        shown = [t for t in (self._load(wire, incidents), self._trouble(wire, incidents)) if t]
        return self._under(self._marks(incidents), shown)

    def _under(self, marks: Markup, tracks: Iterable[Markup]) -> Markup:
        time = self.time
        axis = tag(
            "div",
            *(
                tag("span", told, style=f"left:{at}%", cls="last" if at > LAST else None)
                for at, told in time.ticks()
            ),
            cls="times",
        )
        return tag(
            "div",
            marks,
            *tracks,
            axis,
            cls="tracks",
            data_width=time.width_ns / NS,
            data_size=time.size,
        )

    def _marks(self, incidents: Sequence[Incident]) -> Markup:
        rows = []
        for i in incidents[:MARKS]:
            left, right = self.time.share(i.first_ns), self.time.share(i.last_ns)
            late = left > LATE
            rows.append(
                tag(
                    "div",
                    tag("i", cls="bar", style=f"left:{left}%;width:{round(right - left, 2)}%"),
                    tag(
                        "a",
                        shape(i.severity),
                        tag("span", f"{i.number} {i.cause}"),
                        href=f"#incident-{i.number}",
                        style=f"right:{round(100 - left, 2)}%" if late else f"left:{left}%",
                        cls="late" if late else None,
                    ),
                    cls="mark",
                )
            )
        return tag("div", *rows, cls="marks")

    def _position(self, mine: ServoFigures, incidents: Sequence[Incident]) -> Markup | None:
        curve, name = self.value(mine, POSITION)
        goal, title = None, "position"
        if curve is None:
            goal, name = self.value(mine, GOAL)
            title = "goal position"
        elif (told := mine.values.get((GOAL, name))) is not None:
            goal = self.of(told.curve)
        return self._chart(
            title,
            name,
            [("goal", "goal", goal), ("position", "position", curve)],
            incidents,
            tall=True,
        )

    def _error(self, mine: ServoFigures, incidents: Sequence[Incident]) -> Markup | None:
        _, name = self.value(mine, POSITION)
        curve = self.of(mine.curves.get((ERROR, name)))
        return self._chart("goal - position", name, [("error", "error", curve)], incidents)

    def _plain(
        self, mine: ServoFigures, quantity: str, incidents: Sequence[Incident]
    ) -> Markup | None:
        curve, name = self.value(mine, quantity)
        return self._chart(quantity, name, [(quantity, quantity, curve)], incidents)

    def _replies(self, mine: ServoFigures, incidents: Sequence[Incident]) -> Markup | None:
        """Draw within what bounds the longest response time of each stretch of time lies."""
        least = self.of(mine.curves.get((SHORTEST, "ms")))
        most = self.of(mine.curves.get((LONGEST, "ms")))
        if least is None or most is None:
            return None
        per = max(1, self.time.size // BARS)
        low, top = svg.coarser(least, per), svg.coarser(most, per)
        axis = svg.axis(0.0, float(top.high.max()))
        path = svg.intervals(top.at * per, axis.y(top.high), axis.y(low.high), per)
        inks = [Ink("area replies", "", path)]
        title = "longest response time, at least to at most"
        return self._track(title, "ms", axis, inks, incidents)

    def _load(self, wire: WireFigures, incidents: Sequence[Incident]) -> Markup | None:
        """Draw which share of its time a line was busy; nobody knows it without a clock."""
        if wire.pace is None or wire.clock == Clock.NONE:
            return None
        share = BITS * NS / wire.pace.baud / self.time.width_ns
        per = max(1, min(-(-LOAD_NS // self.time.width_ns), self.time.size // LOAD_BARS))
        told: list[tuple[str, str, Trace, F64]] = []
        for style, name in ((BYTES, "all bytes"), (UNCLAIMED, "bytes in no frame")):
            curve = self.of(wire.curves[style])
            if curve is None:
                continue
            joint = svg.coarser(curve, per)
            told.append((style, name, joint, 100 * share * joint.mean * joint.n / per))
        most = max((float(busy.max()) for *_, busy in told), default=0.0)
        top = next((top for top in LOAD_TOPS if most <= top), 100.0)
        axis = svg.Axis(0.0, top, (0.0, top / 2, top))
        inks = [
            Ink(f"area {style}", name, svg.bars(joint.at * per, axis.y(busy), per))
            for style, name, joint, busy in told
        ]
        return self._track("busy share of the line", "%", axis, inks, incidents)

    def _trouble(self, wire: WireFigures, incidents: Sequence[Incident]) -> Markup | None:
        curves = {name: self.of(wire.curves[name]) for name in (TROUBLE, MISSING)}
        per = max(1, self.time.size // BARS)
        joint = {n: svg.coarser(c, per) for n, c in curves.items() if c is not None}
        if not joint:
            return None
        axis = svg.axis(0.0, max(float(c.n.max()) for c in joint.values()), least=1)
        names = {TROUBLE: "warnings and errors", MISSING: "answers that did not come"}
        inks = [
            Ink(f"area {n}", names[n], svg.bars(c.at * per, axis.y(c.n.astype(float)), per))
            for n, c in joint.items()
        ]
        return self._track("what went wrong", "count", axis, inks, incidents)

    def _chart(
        self,
        title: str,
        unit: str,
        lines: Sequence[tuple[str, str, Trace | None]],
        incidents: Sequence[Incident],
        *,
        tall: bool = False,
    ) -> Markup | None:
        known = [(style, name, curve) for style, name, curve in lines if curve is not None]
        if not known:
            return None
        low = min(float(c.low.min()) for _, _, c in known)
        high = max(float(c.high.max()) for _, _, c in known)
        axis = svg.axis(low, high, least=SPAN.get(unit, 0.0))
        inks = []
        for style, name, c in known:
            if style == "goal" and np.median(c.n) <= 1:  # each goal has a bucket of its own
                path = svg.stairs(c.at, axis.y(c.last), self.time.size)
            else:
                path = svg.line(c.at, axis.y(c.mean))
                inks.append(Ink(f"area {style}", "", svg.band(c.at, axis.y(c.high), axis.y(c.low))))
            inks.append(Ink(f"line {style}", name, path))
        return self._track(title, unit, axis, inks, incidents, tall=tall)

    def _track(
        self,
        title: str,
        unit: str,
        axis: svg.Axis,
        inks: Sequence[Ink],
        incidents: Sequence[Incident],
        *,
        tall: bool = False,
    ) -> Markup:
        size = max(self.time.size, 1)
        shown = unit if unit == "count" else sign_of(unit)
        caption = [tag("b", title), f" {shown}" if shown else "", *keys(inks)]
        labels = []
        for tick in axis.ticks:
            top = round(100 * (axis.high - tick) / (axis.high - axis.low), 1)
            labels.append(tag("span", number(tick), style=f"top:{top}%"))
        drawing = tag(
            "svg",
            *(_level(axis, tick, size) for tick in axis.ticks),
            *(self._when(i) for i in incidents[:MARKS]),
            *(tag("path", d=ink.path, cls=ink.style) for ink in inks if ink.path),
            view_box=f"0 0 {size} {svg.HEIGHT}",
            preserve_aspect_ratio="none",
            role="img",
            aria_label=f"{title} over time",
            data_low=axis.low,
            data_high=axis.high,
        )
        return tag(
            "figure",
            tag("figcaption", *caption, tag("output")),
            tag("div", tag("div", *labels, cls="levels"), drawing, cls="plot"),
            cls="track tall" if tall else "track",
        )

    def _when(self, incident: Incident) -> Markup:
        at = round(self.time.share(incident.first_ns) / 100 * self.time.size, 2)
        return tag("line", x1=at, x2=at, y1=0, y2=svg.HEIGHT, cls="when")


def keys(inks: Iterable[Ink]) -> Iterator[Markup]:
    """Yield what the lines of a chart are, each with a sample of it, where there are several."""
    named = [ink for ink in inks if ink.name]
    if len(named) < 2:
        return
    for ink in named:
        sample = "M0 5h22" if ink.style.startswith("line") else "M0 1h22v8h-22z"
        drawn = tag("svg", tag("path", d=sample, cls=ink.style), view_box="0 0 22 10", cls="sample")
        yield tag("span", drawn, ink.name, cls="key")


def _level(axis: svg.Axis, tick: float, size: int) -> Markup:
    y = int(axis.y(np.array([tick]))[0])
    zero = tick == 0 and axis.low < 0
    return tag("line", x1=0, x2=size, y1=y, y2=y, cls="level zero" if zero else "level")
