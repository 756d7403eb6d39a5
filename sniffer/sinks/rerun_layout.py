"""The layout of a recording in the Rerun viewer, and the colours of its servos.

Written for rerun-sdk 0.41. Called by ``sniffer.sinks.rerun`` only; imports rerun lazily as it does.
"""

from __future__ import annotations

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

GLOBAL_VIEW: Final = "5c0dca6a-e63f-9cf7-f657-2602590474cc"
"""The view without a body in whose time axis the viewer keeps the range of all linked axes.
Source: rerun 0.41, re_viewer_context, GLOBAL_VIEW_ID."""

# What an engineer looks at first stands on the left, at full width; how the bus and the supply
# fare stands on the right. Other quantities have a tab of their own.
_LEFT: Final = ("position", "speed", "load", "current", "operating_rate")
_RIGHT: Final = (RESPONSE_TIME, "voltage", "temperature")


@dataclass(frozen=True, slots=True)
class Track:
    """One entity that a view may show; ``quantity`` says which."""

    path: str
    bus: str
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
            slot = next((k for k in _from(first) if k not in taken), first)
            self._slot[servo_id] = slot
        return PALETTE[slot]


def _from(first: int) -> Iterable[int]:
    return ((first + k) % len(PALETTE) for k in range(len(PALETTE)))


def blueprint(
    tracks: Sequence[Track],
    logs: Mapping[str, str],
    *,
    span_ns: tuple[int, int] | None = None,
    window_s: float | None = None,
) -> rrb.Blueprint:
    """Lay out what really occurs, one tab a bus, on time axes that move together.

    Args:
        tracks: all plotted entities, in the order in which legends shall name them.
        logs: bus -> path of its anomaly log, for buses that have one.
        span_ns: first and last time, shown whole.
        window_s: instead, follow the newest time with this much before it.
    """
    import rerun.blueprint as rrb

    buses = list(dict.fromkeys([*(t.bus for t in tracks), *logs]))
    tabs = [_bus(bus, [t for t in tracks if t.bus == bus], logs.get(bus)) for bus in buses]
    root = tabs[0] if len(tabs) == 1 else rrb.Tabs(contents=tabs)
    view_range = _view_range(span_ns, window_s)

    class LinkedTime(rrb.TimePanel):
        """The time panel, and the range of all linked axes, for which the package has no part."""

        def _log_to_stream(self, stream: Any) -> None:
            super()._log_to_stream(stream)
            if view_range is not None:
                stream.log(f"view/{GLOBAL_VIEW}/TimeAxis", rrb.TimeAxis(view_range=view_range))

    follow = window_s is not None
    return rrb.Blueprint(
        root,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        LinkedTime(
            timeline=TIMELINE,
            state="collapsed",
            play_state="following" if follow else "paused",
        ),
        auto_layout=False,
        auto_views=False,
    )


def _view_range(span_ns: tuple[int, int] | None, window_s: float | None) -> rrb.TimeRange | None:
    import rerun as rr
    import rerun.blueprint as rrb

    edge = rrb.TimeRangeBoundary
    if window_s is not None:
        return rr.encodings.TimeRange(
            start=edge.cursor_relative(seconds=-window_s), end=edge.cursor_relative()
        )
    if span_ns is None:
        return None
    first, last = span_ns
    margin = max((last - first) // 100, 1_000_000)
    return rr.encodings.TimeRange(
        start=edge.absolute(nanos=first - margin), end=edge.absolute(nanos=last + margin)
    )


def _bus(bus: str, tracks: Sequence[Track], log: str | None) -> rrb.Container:
    import rerun.blueprint as rrb

    plots: dict[tuple[str, str], list[Track]] = {}
    lanes: list[Track] = []
    for t in tracks:
        if t.is_state:
            lanes.append(t)
        elif t.quantity:
            plots.setdefault((t.quantity.removeprefix("goal_"), t.unit), []).append(t)
    left = [_plot(*key, plots.pop(key)) for q in _LEFT for key in list(plots) if key[0] == q]
    right = [_plot(*key, plots.pop(key)) for q in _RIGHT for key in list(plots) if key[0] == q]
    left_shares, right_shares = [2.0] * len(left), [2.0] * len(right)
    if left and tracks[0].quantity.endswith("position"):
        left_shares[0] = 3.0
    if lanes:
        axis = rrb.TimeAxis(link="LinkToGlobal")
        view = rrb.StateTimelineView(
            name="States", origin="/", contents=[t.path for t in lanes], time_view=axis
        )
        left.append(view)
        left_shares.append(2.0)
    if log is not None:
        right.append(_log(log))
        right_shares.append(2.0)
    columns = [
        rrb.Vertical(contents=views, row_shares=shares)
        for views, shares in ((left, left_shares), (right, right_shares))
        if views
    ]
    main: rrb.Container
    main = rrb.Horizontal(contents=columns, column_shares=[3, 2][: len(columns)], name=bus)
    if not plots:
        return main
    rest = rrb.Grid(contents=[_plot(*k, v) for k, v in plots.items()], name="more")
    return rrb.Tabs(main, rest, name=bus) if columns else rest


def _plot(quantity: str, unit: str, tracks: Sequence[Track]) -> rrb.View:
    import rerun.blueprint as rrb

    title = quantity.replace("_", " ").capitalize()
    return rrb.TimeSeriesView(
        name=f"{title} [{_UNITS.get(unit, unit)}]",
        origin="/",
        contents=[t.path for t in tracks],
        axis_x=rrb.TimeAxis(link="LinkToGlobal"),
        plot_legend=rrb.PlotLegend(corner="LeftTop"),
    )


_UNITS: Final = {"": "raw", "degC": "°C", "deg": "°", "deg/s": "°/s"}


def _log(path: str) -> rrb.View:
    import rerun.blueprint as rrb

    return rrb.TextLogView(
        name="Anomalies",
        origin="/",
        contents=[path],
        columns=rrb.TextLogColumns(
            timeline_columns=[TIMELINE], text_log_columns=["LogLevel", "Body"]
        ),
    )
