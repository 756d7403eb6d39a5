"""The layout of a recording in the Rerun viewer, and the colours of its servos.

Written for rerun-sdk 0.41. Called by ``sink.py`` beside this file and by
``sniffer.viewers.viewer``; imports rerun lazily as they do.
"""

from __future__ import annotations

import re
import uuid
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

from sniffer.sinks.rerun.plots import (
    BUS_LOAD,
    BY_SECOND,
    FOLLOWING_ERROR,
    MISSING,
    PEAK_TIME,
    POSITION,
    RESPONSE_TIME,
    TOGETHER,
    BusFigures,
    Plots,
    TimeRange,
    Track,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import rerun.blueprint as rrb

    from sniffer.ground.colours import Rgb

TIMELINE: Final = "time"

GLOBAL_VIEW: Final = "5c0dca6a-e63f-9cf7-f657-2602590474cc"
"""The view without a body in whose time axis the viewer keeps the range of all linked axes.
Source: rerun 0.41, re_viewer_context, GLOBAL_VIEW_ID; there is no call for it."""

BESIDE: Final = 3
"""Servos whose rows find room beside the curves of all."""

# How the joints move, and what they draw, as overlays.
_MOTION: Final = ("speed", "load", "current", "operating_rate")
_SUPPLY: Final = ("voltage", "temperature")
_FIRST: Final = (POSITION, FOLLOWING_ERROR, RESPONSE_TIME, *BY_SECOND)


def mixed(colour: Rgb, other: Rgb, share: float) -> Rgb:
    """Return ``colour`` with a share of ``other`` in it."""
    r, g, b = (round(a + (o - a) * share) for a, o in zip(colour, other, strict=True))
    return r, g, b


def application_id(name: str) -> str:
    """Return a name of its own for what is shown: the viewer keeps one layout an application.

    It warns of every sign that it does not allow in one (seen with rerun-sdk 0.41).
    """
    allowed = re.sub(r"[^A-Za-z0-9 _:-]", "-", name)
    return f"sniffer {allowed[:40]} {uuid.uuid4().hex[:6]}"


def blueprint(
    tracks: Sequence[Track],
    logs: Mapping[str, Sequence[str]],
    times: TimeRange,
    *,
    figures: Mapping[str, BusFigures] = MappingProxyType({}),
) -> rrb.Blueprint | None:
    """Lay out what really occurs, one tab a bus, on time axes that move together.

    None where there is nothing to show.

    Args:
        tracks: all plotted entities.
        logs: bus -> paths of its logs of incidents and anomalies, for buses that have some.
        times: which times are shown.
        figures: bus -> what titles and axes tell of it.
    """
    import rerun.blueprint as rrb

    buses = list(dict.fromkeys([*(t.bus for t in tracks), *logs]))
    tabs = []
    for bus in buses:
        own = [t for t in tracks if t.bus == bus]
        tabs += _bus(bus, Plots(own, times, figures.get(bus, BusFigures())), logs.get(bus, ()))
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
        times = (RESPONSE_TIME,) if plots.crowded else ()
        columns += _columns(own.views(_MOTION), own.views((*_SUPPLY, *times)))
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
    crowded = plots.crowded
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
    right = [(1.6, v) for v in plots.views(plots.peaks)]
    right += [(1.3, v) for v in plots.views((MISSING, BUS_LOAD))]
    # of many servos the single times are ink; they stand with their servos
    right += [(1.6, v) for v in plots.views((PEAK_TIME if crowded else RESPONSE_TIME,))]
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


def _rows(plots: Plots, ids: Sequence[int]) -> list[rrb.Vertical]:
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


def _columns(*sides: Sequence[rrb.View]) -> list[rrb.Vertical]:
    import rerun.blueprint as rrb

    return [rrb.Vertical(contents=list(side)) for side in sides if side]


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
