"""The layout of a recording in the Rerun viewer, and the colours of its servos.

Written for rerun-sdk 0.41. Called by ``sink.py`` beside this file and by
``sniffer.viewers.viewer``; imports rerun lazily as they do.
"""

from __future__ import annotations

import re
import uuid
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import rerun.blueprint as rrb

Rgb = tuple[int, int, int]

TIMELINE: Final = "time"

PALETTE: Final[Sequence[Rgb]] = tuple(
    (code >> 16, code >> 8 & 255, code & 255)
    for code in (
        *(0x4C9BE8, 0xFF9F40, 0x58C472, 0xF0556B, 0xB48CF2, 0x3FD0D4, 0xF2D64B, 0xE87BC8),
        *(0xA6D854, 0xC49A6C, 0x9CCBFF, 0xFFA79C, 0x2FA58E, 0x7F6BFF, 0xB3A83B, 0xC75B8A),
        *(0x9CF0C5, 0xC8692E, 0xD9C6FF, 0x3E8F4A, 0x6E93B5, 0xD9A400, 0xFF4FA3, 0xD0D0D0),
    )
)
"""One colour a servo, told apart on the viewer's dark ground; servo 1 has the first."""

POSITION: Final = "position"
RESPONSE_TIME: Final = "response_time"
FOLLOWING_ERROR: Final = "following_error"
PEAK_ERROR: Final = "largest_following_error"
BUS_LOAD: Final = "bus_load"
MISSING: Final = "missing_answers"
ALARMS: Final = "alarms"
EVERYONE: Final = -1
"""In place of a servo id: told to all servos at once."""

GLOBAL_VIEW: Final = "5c0dca6a-e63f-9cf7-f657-2602590474cc"
"""The view without a body in whose time axis the viewer keeps the range of all linked axes.
Source: rerun 0.41, re_viewer_context, GLOBAL_VIEW_ID; there is no call for it."""

TOGETHER: Final = 6
"""Servos in one tab: more curves cannot be told apart, and their legend would be cut off."""

BESIDE: Final = 3
"""Servos whose rows find room beside the curves of all."""

BEFORE: Final = 0.25
"""How much of the window lies before what it opens at."""

WHOLE: Final = 1.5
"""Recordings up to so many windows long are shown whole."""

PAST_S: Final = 600.0
"""How much of the past the curves by the second show live."""

# How the joints move, and what they draw, as overlays.
_MOTION: Final = ("speed", "load", "current", "operating_rate")
_SUPPLY: Final = ("voltage", "temperature")
_BY_SECOND: Final = (PEAK_ERROR, MISSING, BUS_LOAD)
_FIRST: Final = (POSITION, FOLLOWING_ERROR, RESPONSE_TIME, *_BY_SECOND)
_TITLES: Final = {
    PEAK_ERROR: "Largest following error in each second",
    MISSING: "Missing answers",
    BUS_LOAD: "Bus load",
}
_UNITS: Final = {"": "raw", "degC": "°C", "deg": "°", "deg/s": "°/s"}


@dataclass(frozen=True, slots=True)
class Track:
    """One entity that a view may show; ``quantity`` says which, empty for none.

    ``is_mark``: points on the curves of the quantity; ``who`` is what legends call the servo.
    """

    path: str
    bus: str
    servo_id: int
    quantity: str
    unit: str = ""
    is_state: bool = False
    is_mark: bool = False
    who: str = ""


def mixed(colour: Rgb, other: Rgb, share: float) -> Rgb:
    """Return ``colour`` with a share of ``other`` in it."""
    r, g, b = (round(a + (o - a) * share) for a, o in zip(colour, other, strict=True))
    return r, g, b


class Colours:
    """Gives each servo id a colour; the same id has the same colour in every recording.

    Only where two ids of one recording meet on a colour does the later one take the next free.
    """

    def __init__(self) -> None:
        self._slot: dict[int, int] = {}

    def of(self, servo_id: int) -> Rgb:
        """Return the servo's colour."""
        slot = self._slot.get(servo_id)
        if slot is None:
            taken = set(self._slot.values())
            first = (servo_id - 1) % len(PALETTE)
            slots = ((first + k) % len(PALETTE) for k in range(len(PALETTE)))
            slot = next((k for k in slots if k not in taken), first)
            self._slot[servo_id] = slot
        return PALETTE[slot]


def application_id(name: str) -> str:
    """Return a name of its own for what is shown: the viewer keeps one layout an application.

    It warns of every sign that it does not allow in one (seen with rerun-sdk 0.41).
    """
    allowed = re.sub(r"[^A-Za-z0-9 _:-]", "-", name)
    return f"sniffer {allowed[:40]} {uuid.uuid4().hex[:6]}"


@dataclass(frozen=True, slots=True)
class Times:
    """Which times the plots show: all plots move together, those by the second on their own.

    Args:
        span_ns: first and last time of a recording that is whole.
        error_ns: when its first error was.
        window_s: how much of the time is shown.
        is_live: the newest time is followed.
    """

    span_ns: tuple[int, int] | None
    window_s: float
    error_ns: int | None = None
    is_live: bool = False

    @property
    def is_long(self) -> bool:
        """Tell whether the window is a part only, so that an overview is of use."""
        if self.is_live or self.span_ns is None:
            return self.is_live
        return self.span_ns[1] - self.span_ns[0] > WHOLE * self.window_s * NS

    def window(self) -> Any:
        """Return what the linked axes show."""
        if self.is_live or self.span_ns is None or not self.is_long:
            return self.whole(self.window_s)
        first, last = self.span_ns
        length = round(self.window_s * NS)
        at = first if self.error_ns is None else self.error_ns - round(BEFORE * length)
        at = max(min(at, last - length), first)
        return _between(at, at + length)

    def whole(self, past_s: float = PAST_S) -> Any:
        """Return the range of the whole recording, or live so much of the past."""
        import rerun as rr
        import rerun.blueprint as rrb

        edge = rrb.TimeRangeBoundary
        if self.is_live:
            start, end = edge.cursor_relative(seconds=-past_s), edge.cursor_relative()
            return rr.encodings.TimeRange(start=start, end=end)
        if self.span_ns is None:
            return None
        return _between(*self.span_ns)


def _between(first: int, last: int) -> Any:
    import rerun as rr
    import rerun.blueprint as rrb

    length = max(last - first, 1_000_000)
    return rr.encodings.TimeRange(
        # Legends stand on the left, on free ground.
        start=rrb.TimeRangeBoundary.absolute(nanos=first - length // 8),
        end=rrb.TimeRangeBoundary.absolute(nanos=last + length // 100),
    )


def blueprint(
    tracks: Sequence[Track],
    logs: Mapping[str, Sequence[str]],
    times: Times,
    *,
    doubt_ns: Mapping[str, int] | None = None,
) -> rrb.Blueprint | None:
    """Lay out what really occurs, one tab a bus, on time axes that move together.

    None where there is nothing to show.

    Args:
        tracks: all plotted entities.
        logs: bus -> paths of its logs of incidents and anomalies, for buses that have some.
        times: which times are shown.
        doubt_ns: bus -> how far its response times may be off, 99 of 100 of them.
    """
    import rerun.blueprint as rrb

    buses = list(dict.fromkeys([*(t.bus for t in tracks), *logs]))
    tabs = []
    for bus in buses:
        own = [t for t in tracks if t.bus == bus]
        tabs += _bus(bus, Plots(own, times, (doubt_ns or {}).get(bus, 0)), logs.get(bus, ()))
    if not tabs:
        return None
    view_range = times.window()

    class LinkedTime(rrb.TimePanel):
        """The time panel, and with it the range of all linked axes."""

        def _log_to_stream(self, stream: Any) -> None:
            super()._log_to_stream(stream)
            if view_range is not None:
                stream.log(f"view/{GLOBAL_VIEW}/TimeAxis", rrb.TimeAxis(view_range=view_range))

    return rrb.Blueprint(
        tabs[0] if len(tabs) == 1 else rrb.Tabs(contents=tabs),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        LinkedTime(
            timeline=TIMELINE,
            state="collapsed",
            play_state="following" if times.is_live else "paused",
        ),
        auto_layout=False,
        auto_views=False,
    )


def _bus(bus: str, plots: Plots, log: Sequence[str]) -> list[rrb.Container]:
    """Lay out one bus: what tells most first, then its servos some at a time, then the rest."""
    import rerun.blueprint as rrb

    tabs = [_overview(plots, log)]
    servos = plots.servos
    rows_beside = 1 < len(servos) <= BESIDE
    for ids in _parted(servos):
        own = plots.of(ids)
        name = "motion and supply" if len(servos) <= TOGETHER else f"servos {ids[0]} to {ids[-1]}"
        columns = [] if rows_beside or len(ids) == 1 else _rows(own, ids)
        columns += _columns(own.views(_MOTION), own.views(_SUPPLY))
        tabs.append(rrb.Horizontal(contents=columns, name=name))
    rest = plots.others((*_FIRST, *_MOTION, *_SUPPLY))
    if rest:
        tabs.append(rrb.Grid(contents=rest, name="more"))
    tabs = [tab for tab in tabs if tab.contents]
    if len(tabs) > 1:
        return [rrb.Tabs(contents=tabs, name=bus)]
    for tab in tabs:
        tab.name = bus
    return tabs


def _parted(servos: Sequence[int]) -> list[Sequence[int]]:
    """Part the servos into as few and as equal groups as may stand together."""
    n = -(-len(servos) // TOGETHER)
    return [servos[k * len(servos) // n : (k + 1) * len(servos) // n] for k in range(n)]


def _overview(plots: Plots, log: Sequence[str]) -> rrb.Container:
    """Lay out the curves of all servos, the rows of few beside them, and how the bus fares."""
    import rerun.blueprint as rrb

    servos = plots.servos
    crowded = len(servos) > TOGETHER
    left = [(3.4, v) for v in plots.views((POSITION,), goals=not crowded)]
    left += [(3.0 if crowded else 2.2, v) for v in plots.views((FOLLOWING_ERROR,))]
    lanes = plots.lanes(alarms_only=crowded)
    if lanes:
        view = rrb.StateTimelineView(
            name="States",
            origin="/",
            contents=[t.path for t in lanes],
            time_view=rrb.TimeAxis(link="LinkToGlobal"),
        )
        left.append((min(max(0.4 * len(lanes), 1.0), 3.0), view))
    right = [(1.6, v) for v in plots.views((PEAK_ERROR,) if plots.times.is_long else ())]
    right += [(1.3, v) for v in plots.views((MISSING, BUS_LOAD))]
    right += [(1.6, v) for v in plots.views((RESPONSE_TIME,))]
    if log:
        right.append((2.2, _log(log)))
    columns, shares = [], []
    for side, share in ((left, 3), (right, 2)):
        if side:
            columns.append(
                rrb.Vertical(contents=[v for _, v in side], row_shares=[x for x, _ in side])
            )
            shares.append(share)
        if side is left and 1 < len(servos) <= BESIDE and (rows := _rows(plots, servos)):
            columns += rows
            shares.append(2)
    name = "all servos" if len(servos) > 1 else "servo"
    return rrb.Horizontal(contents=columns, column_shares=shares, name=name)


def _rows(plots: Plots, ids: Sequence[int]) -> list[rrb.Container]:
    """Return a row a servo, position with goal and the error below it, in one column or two."""
    import rerun.blueprint as rrb

    cells = []
    for servo in ids:
        views = plots.of([servo]).views((POSITION, FOLLOWING_ERROR), title=True)
        if views:
            cells.append(rrb.Vertical(contents=views, row_shares=[3, 2, 2, 2][: len(views)]))
    split = -(-len(cells) // 2) if len(cells) > BESIDE else len(cells)
    columns = (cells[:split], cells[split:])
    return [rrb.Vertical(contents=column) for column in columns if column]


def _columns(*sides: Sequence[rrb.View]) -> list[rrb.Container]:
    import rerun.blueprint as rrb

    return [rrb.Vertical(contents=list(side)) for side in sides if side]


class Plots:
    """Makes the plots of some servos of a bus."""

    def __init__(self, tracks: Sequence[Track], times: Times, doubt_ns: int) -> None:
        self.times = times
        self._tracks, self._doubt_ns = tracks, doubt_ns

    @property
    def servos(self) -> list[int]:
        """The servos that have anything."""
        return sorted({t.servo_id for t in self._tracks} - {EVERYONE})

    def of(self, ids: Sequence[int]) -> Plots:
        """Return what is of some servos, or of all at once."""
        own = [t for t in self._tracks if t.servo_id in (*ids, EVERYONE)]
        return Plots(own, self.times, self._doubt_ns)

    def lanes(self, *, alarms_only: bool) -> list[Track]:
        """Return the states."""
        lanes = [t for t in self._tracks if t.is_state and t.quantity]
        return [t for t in lanes if t.quantity == ALARMS or not alarms_only]

    def others(self, quantities: Sequence[str]) -> list[rrb.View]:
        """Return the plots of all other quantities."""
        rest = dict.fromkeys(_group(t) for t in self._tracks if t.quantity)
        return self.views([group for group in rest if group not in quantities])

    def views(
        self, quantities: Sequence[str], *, goals: bool = True, title: bool = False
    ) -> list[rrb.View]:
        """Return a plot for each quantity and unit that occur; goals with what they are of.

        ``title``: with the servo's name in the title, and no legend.
        """
        together: dict[tuple[str, str], list[Track]] = {}
        for quantity in quantities:
            for t in self._tracks:
                if _group(t) == quantity and not t.is_state and (goals or quantity == t.quantity):
                    together.setdefault((quantity, t.unit), []).append(t)
        return [
            self._view(quantity, unit, tracks, title=title)
            for (quantity, unit), tracks in together.items()
            if not all(t.is_mark or t.servo_id == EVERYONE for t in tracks) or not title
        ]

    def _view(self, quantity: str, unit: str, tracks: Sequence[Track], *, title: bool) -> rrb.View:
        import rerun.blueprint as rrb

        words = _TITLES.get(quantity) or quantity.replace("_", " ").capitalize()
        if title:
            words = f"{tracks[0].who}: {words.lower()}"
        name = f"{words} [{_UNITS.get(unit, unit)}]"
        if quantity == RESPONSE_TIME and self._doubt_ns >= 100_000:
            name += f", 99 % known to ±{self._doubt_ns / 1e6:.1f}"
        apart = quantity in _BY_SECOND and self.times.is_long
        axis = (
            rrb.TimeAxis(link="Independent", view_range=self.times.whole())
            if apart
            else rrb.TimeAxis(link="LinkToGlobal")
        )
        return rrb.TimeSeriesView(
            name=name,
            origin="/",
            contents=[t.path for t in tracks],
            axis_x=axis,
            plot_legend=rrb.PlotLegend(corner="LeftTop", visible=not title),
        )


def _group(track: Track) -> str:
    """Return what is plotted together: a goal with what it is the goal of."""
    return track.quantity.removeprefix("goal_")


def _log(paths: Sequence[str]) -> rrb.View:
    import rerun.blueprint as rrb

    return rrb.TextLogView(
        name="Anomalies" if len(paths) == 1 else "Incidents and anomalies",
        origin="/",
        contents=list(paths),
        # A click on the time, which the viewer cuts short, moves the cursor there.
        columns=rrb.TextLogColumns(
            timeline_columns=[TIMELINE], text_log_columns=["LogLevel", "Body"]
        ),
    )
