"""The plots of a layout, and the times that they show.

Written for rerun-sdk 0.41. Called by ``layout.py`` beside this file; imports rerun lazily as it
does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from sniffer.ground.model import NS
from sniffer.ground.units import sign_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    import rerun.blueprint as rrb

POSITION: Final = "position"
RESPONSE_TIME: Final = "response_time"
FOLLOWING_ERROR: Final = "following_error"
PEAK_ERROR: Final = "largest_following_error"
PEAK_OVERVIEW: Final = "largest_following_error_overview"
"""The largest of several seconds, of a recording for which those of each second are too many."""

PEAK_TIME: Final = "largest_response_time"
BUS_LOAD: Final = "bus_load"
MISSING: Final = "missing_answers"
ALARMS: Final = "alarms"
EVERYONE: Final = -1
"""In place of a servo id: told to all servos at once."""

TOGETHER: Final = 6
"""Servos in one tab: more curves cannot be told apart, and their legend would be cut off."""

BEFORE: Final = 0.25
"""How much of the window lies before what it opens at."""

WHOLE: Final = 1.5
"""Recordings up to so many windows long are shown whole."""

PAST_S: Final = 120.0
"""How much of the past the curves by the second show live."""

PERCENT: Final = (-8.0, 116.0)
"""An axis of percents: a small plot has room for two numbers, which are 0 and 100, off the edge."""

BY_SECOND: Final = (PEAK_OVERVIEW, PEAK_ERROR, PEAK_TIME, MISSING, BUS_LOAD)
_SMALL: Final = (PEAK_OVERVIEW, PEAK_ERROR, PEAK_TIME)
_TIMES: Final = (RESPONSE_TIME, PEAK_TIME)
_TITLES: Final = {
    PEAK_ERROR: "Largest following error in each second",
    PEAK_OVERVIEW: "Largest following error in every {} s",
    PEAK_TIME: "Largest response time in each second",
    MISSING: "Missing answers",
    BUS_LOAD: "Bus load",
}


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


@dataclass(frozen=True, slots=True)
class TimeRange:
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


class BusFigures(NamedTuple):
    """What titles and axes tell of a bus.

    ``doubt_ns`` is how far its response times may be off, 99 of 100 of them; ``astray`` names the
    servos that are much further off their goals than the others; ``load`` is the largest in
    percent; ``step_s`` is of how many seconds an overview has the largest.
    """

    doubt_ns: int = 0
    astray: str = ""
    load: float = math.inf
    step_s: int = 1


class Plots:
    """Makes the plots of some servos of a bus."""

    def __init__(self, tracks: Sequence[Track], times: TimeRange, figures: BusFigures) -> None:
        self.times = times
        self._tracks, self._figures = tracks, figures

    @property
    def servos(self) -> list[int]:
        """The servos that have anything."""
        return sorted({t.servo_id for t in self._tracks} - {EVERYONE})

    @property
    def crowded(self) -> bool:
        """Tell whether the servos are too many for one tab."""
        return len(self.servos) > TOGETHER

    @property
    def peaks(self) -> tuple[str, ...]:
        """The quantity by which errors of a long recording are overlooked."""
        if not self.times.is_long:
            return ()
        there = {t.quantity for t in self._tracks}
        return (PEAK_OVERVIEW if PEAK_OVERVIEW in there else PEAK_ERROR,)

    def of(self, ids: Sequence[int]) -> Plots:
        """Return what is of some servos, or of all at once."""
        own = [t for t in self._tracks if t.servo_id in (*ids, EVERYONE)]
        return Plots(own, self.times, self._figures)

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
        words = words.format(self._figures.step_s)
        if title:
            words = f"{tracks[0].who}: {words.lower()}"
        name = f"{words} [{sign_of(unit) or 'raw'}]"
        figures = self._figures
        if quantity in _TIMES and figures.doubt_ns >= 100_000:
            name += f", 99 % known to ±{figures.doubt_ns / 1e6:.1f}"
        if quantity in (PEAK_ERROR, PEAK_OVERVIEW) and figures.astray:
            name += f", most: {figures.astray}"
        # of a wrong rate there may be more than all
        is_share = quantity == BUS_LOAD and figures.load <= PERCENT[1]
        apart = quantity in BY_SECOND and self.times.is_long
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
            axis_y=rrb.ScalarAxis(range=PERCENT) if is_share else None,
            # a small plot of many would cut the legend off; the large one beside it has the colours
            plot_legend=rrb.PlotLegend(
                corner="LeftTop", visible=not title and (quantity not in _SMALL or not self.crowded)
            ),
        )


def _group(track: Track) -> str:
    """Return what is plotted together: a goal with what it is the goal of."""
    return track.quantity.removeprefix("goal_")
