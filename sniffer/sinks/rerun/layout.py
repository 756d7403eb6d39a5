"""The layout of a recording in the Rerun viewer, and the colours of its servos.

Written for rerun-sdk 0.41. Called by ``sink.py`` beside this file and by
``sniffer.viewers.viewer``; imports rerun lazily as they do.
"""

from __future__ import annotations

import re
import uuid
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

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

RESPONSE_TIME: Final = "response_time"
ALARMS: Final = "alarms"
EVERYONE: Final = -1
"""In place of a servo id: told to all servos at once."""

GLOBAL_VIEW: Final = "5c0dca6a-e63f-9cf7-f657-2602590474cc"
"""The view without a body in whose time axis the viewer keeps the range of all linked axes.
Source: rerun 0.41, re_viewer_context, GLOBAL_VIEW_ID; there is no call for it."""

TOGETHER: Final = 6
"""Servos in one tab: more curves cannot be told apart, and their legend would be cut off."""

# The motion stands on the left, at greater width; how the bus and the supply fare on the right.
# Other quantities have a tab of their own.
_LEFT: Final = ("position", "speed", "load", "current", "operating_rate")
_RIGHT: Final = (RESPONSE_TIME, "voltage", "temperature")
_UNITS: Final = {"": "raw", "degC": "°C", "deg": "°", "deg/s": "°/s"}


@dataclass(frozen=True, slots=True)
class Track:
    """One entity that a view may show; ``quantity`` says which, empty for none."""

    path: str
    bus: str
    servo_id: int
    quantity: str
    unit: str = ""
    is_state: bool = False


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


def blueprint(
    tracks: Sequence[Track],
    logs: Mapping[str, Sequence[str]],
    *,
    span_ns: tuple[int, int] | None = None,
    window_s: float | None = None,
    doubt_ns: Mapping[str, int] | None = None,
) -> rrb.Blueprint | None:
    """Lay out what really occurs, one tab a bus, on time axes that move together.

    None where there is nothing to show.

    Args:
        tracks: all plotted entities.
        logs: bus -> paths of its logs of incidents and anomalies, for buses that have some.
        span_ns: first and last time, shown whole.
        window_s: instead, follow the newest time with this much before it.
        doubt_ns: bus -> how far its response times may be off, 99 of 100 of them.
    """
    import rerun.blueprint as rrb

    buses = list(dict.fromkeys([*(t.bus for t in tracks), *logs]))
    tabs = []
    for bus in buses:
        own = [t for t in tracks if t.bus == bus]
        tabs += _bus(bus, own, logs.get(bus, ()), (doubt_ns or {}).get(bus, 0))
    if not tabs:
        return None
    view_range = _view_range(span_ns, window_s)

    class LinkedTime(rrb.TimePanel):
        """The time panel, and with it the range of all linked axes."""

        def _log_to_stream(self, stream: Any) -> None:
            super()._log_to_stream(stream)
            if view_range is not None:
                stream.log(f"view/{GLOBAL_VIEW}/TimeAxis", rrb.TimeAxis(view_range=view_range))

    follow = window_s is not None
    return rrb.Blueprint(
        tabs[0] if len(tabs) == 1 else rrb.Tabs(contents=tabs),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        LinkedTime(
            timeline=TIMELINE, state="collapsed", play_state="following" if follow else "paused"
        ),
        auto_layout=False,
        auto_views=False,
    )


def _view_range(span_ns: tuple[int, int] | None, window_s: float | None) -> Any:
    import rerun as rr
    import rerun.blueprint as rrb

    edge = rrb.TimeRangeBoundary
    if window_s is not None:
        start, end = edge.cursor_relative(seconds=-window_s), edge.cursor_relative()
    elif span_ns is not None:
        first, last = span_ns
        length = max(last - first, 1_000_000)
        # Legends stand on the left, on free ground.
        start = edge.absolute(nanos=first - length // 8)
        end = edge.absolute(nanos=last + length // 100)
    else:
        return None
    return rr.encodings.TimeRange(start=start, end=end)


def _bus(
    bus: str, tracks: Sequence[Track], log: Sequence[str], doubt_ns: int
) -> list[rrb.Container]:
    """Lay out one bus, if it has anything to show: one tab, or some where its servos are many."""
    import rerun.blueprint as rrb

    servos = sorted({t.servo_id for t in tracks} - {EVERYONE})
    crowded = len(servos) > TOGETHER
    pages = [("all servos" if crowded else "servos", tracks)]
    if crowded:
        for ids in _parted(servos):
            own = [t for t in tracks if t.servo_id in (*ids, EVERYONE)]
            pages.append((f"servos {ids[0]} to {ids[-1]}", own))
    tabs = [_page(name, of, log, doubt_ns, crowded=crowded and of is tracks) for name, of in pages]
    rest = _plots(t for t in tracks if _group(t) not in (*_LEFT, *_RIGHT))
    if rest:
        tabs.append(rrb.Grid(contents=list(rest.values()), name="more"))
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


def _page(
    name: str, tracks: Sequence[Track], log: Sequence[str], doubt_ns: int, *, crowded: bool
) -> rrb.Container:
    """Lay out some servos: plots on the left and the right, states and anomalies below them."""
    import rerun.blueprint as rrb

    plots = _plots(tracks, doubt_ns=doubt_ns, legend=not crowded)
    left: list[tuple[float, rrb.View]] = []
    right: list[tuple[float, rrb.View]] = []
    for side, groups in ((left, _LEFT), (right, _RIGHT)):
        for group in groups:
            share = 3.6 if group == "position" else 2.0
            side += [(share, view) for key, view in plots.items() if key[0] == group]
    lanes = [
        t for t in tracks if t.is_state and t.quantity and (t.quantity == ALARMS or not crowded)
    ]
    if lanes:
        view = rrb.StateTimelineView(
            name="States",
            origin="/",
            contents=[t.path for t in lanes],
            time_view=rrb.TimeAxis(link="LinkToGlobal"),
        )
        left.append((min(max(0.5 * len(lanes), 1.0), 4.0), view))
    if log:
        right.append((2.5, _log(log)))
    columns = [
        rrb.Vertical(contents=[v for _, v in side], row_shares=[share for share, _ in side])
        for side in (left, right)
        if side
    ]
    return rrb.Horizontal(contents=columns, column_shares=[3, 2][: len(columns)], name=name)


def _group(track: Track) -> str:
    """Return what is plotted together: a goal with what it is the goal of."""
    return track.quantity.removeprefix("goal_")


def _plots(
    tracks: Iterable[Track], *, doubt_ns: int = 0, legend: bool = True
) -> dict[tuple[str, str], rrb.View]:
    """Return a plot for each quantity and unit that occur."""
    import rerun.blueprint as rrb

    together: dict[tuple[str, str], list[str]] = {}
    for t in tracks:
        if t.quantity and not t.is_state:
            together.setdefault((_group(t), t.unit), []).append(t.path)
    out: dict[tuple[str, str], rrb.View] = {}
    for (group, unit), paths in together.items():
        name = f"{group.replace('_', ' ').capitalize()} [{_UNITS.get(unit, unit)}]"
        if group == RESPONSE_TIME and doubt_ns >= 100_000:
            name += f", 99 % known to ±{doubt_ns / 1e6:.1f}"
        out[group, unit] = rrb.TimeSeriesView(
            name=name,
            origin="/",
            contents=paths,
            axis_x=rrb.TimeAxis(link="LinkToGlobal"),
            plot_legend=rrb.PlotLegend(corner="LeftTop", visible=legend or group == "position"),
        )
    return out


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
