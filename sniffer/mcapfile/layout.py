"""A layout for Foxglove (and Lichtblick): panels for what the topics of a recording have.

Classic layout files, as the apps export and import them: panels by id, and how they share the
window. Keys of the panels are those of Foxglove's own generator of layouts (foxglove-sdk 0.30,
``foxglove.layouts``); how paths are written: https://docs.foxglove.dev/docs/visualization/message-path-syntax
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from sniffer.decoding.called import ServoNames
from sniffer.ground.colours import Colours
from sniffer.ground.units import word_of
from sniffer.mcapfile.fields import UNITS, quantity_of, unit_of
from sniffer.mcapfile.states import RESPONSE_TIME

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

    from sniffer.decoding.called import Named

LEGEND: Final = 170
"""How wide the names of curves are beside a plot, in pixels."""

ATTACHED: Final = "foxglove-layout.json"
"""The attachment of a recording that holds its layout."""

GROUPS: Final[Mapping[str, str]] = {
    "position": "Position",
    "speed": "Speed",
    "load": "Load",
    "force_limit": "Load",
    "torque_limit": "Load",
    "current": "Current",
    "voltage": "Voltage",
    "temperature": "Temperature",
}
"""What is plotted together, by quantity, in the order of the plots; goals beside what they did."""

STATES: Final = ("torque_enable", "moving", "status")
"""Quantities that are shown as states."""

_SERVO: Final = re.compile(r"(.*)/servo/(\d+|unknown)/([^/]+)")
_PLAIN: Final = re.compile(r"[A-Za-z0-9_/-]+")


@dataclass(frozen=True, slots=True, order=True)
class _Series:
    """A number of a servo over time, and the path that leads to it."""

    bus: str
    servo: int
    field: str
    path: str

    @property
    def quantity(self) -> str:
        """What is commanded or measured, without a unit."""
        return quantity_of(self.field)


def layout(
    topics: Collection[str], fields: Mapping[str, Collection[str]], names: Mapping[Named, str]
) -> dict[str, Any] | None:
    """Return the layout, None where there is nothing to show.

    Args:
        topics: that viewers can look up.
        fields: which fields the states of each of their topics have somewhere.
        names: of servos.
    """
    series = sorted(_series(topics, fields))
    many = len({s.bus for s in series}) > 1
    colours, called = Colours(), ServoNames(names)

    def path(s: _Series) -> dict[str, Any]:
        who = called.of(s.bus.strip("/"), s.servo)
        who = who or (f"servo {s.servo}" if s.servo >= 0 else "unknown servo")
        is_limit = s.quantity.endswith("_limit")
        what = "goal" if s.quantity.startswith("goal_") else ""
        what = s.quantity.replace("_", " ") if is_limit or s.quantity in STATES else what
        red, green, blue = colours.of(s.servo)
        return {
            "value": s.path,
            "label": " ".join(filter(None, (s.bus.strip("/") if many else "", who, what))),
            "enabled": True,
            "timestampMethod": "receiveTime",
            "color": f"#{red:02x}{green:02x}{blue:02x}",
            "showLine": True,
            "lineSize": 1 if what else 2,
        }

    left: dict[str, Any] = {}
    for title, group in _plots(series):
        left[f"Plot!{_slug(title)}"] = _plot(title, [path(s) for s in group])
    right: dict[str, Any] = {}
    states = [path(s) for s in series if s.quantity in STATES]
    if states:
        kept = ("value", "label", "enabled", "timestampMethod")
        lanes = [{key: one[key] for key in kept} for one in states]
        right["StateTransitions!states"] = _panel("States", {"paths": lanes, "isSynced": True})
    took = [path(s) for s in series if s.field == RESPONSE_TIME]
    if took:
        right["Plot!response_time"] = _plot("Response time [ms]", took)
    load = [(t, t.rpartition("/")[0].strip("/")) for t in sorted(topics) if t.endswith("/stats")]
    if load:
        paths = [
            {"value": f"{_quoted(t)}.bus_load_percent", "label": bus, "enabled": True}
            | {"timestampMethod": "receiveTime", "showLine": True}
            for t, bus in load
        ]
        right["Plot!bus_load"] = _plot("Bus load [%]", paths)
    for topic in sorted(t for t in topics if t.endswith("/log")):
        bus = topic.rpartition("/")[0].strip("/")
        told = {"topicToRender": topic, "minLogLevel": 1, "searchTerms": []}
        right[f"RosOut!{_slug(bus)}"] = _panel(f"Anomalies of {bus}", told)
    for topic, title in _tables(topics):
        right[f"Table!{_slug(title)}"] = _panel(title, {"topicPath": _quoted(topic)})
    if not left and not right:
        return None
    columns = [_stack([*column], "column") for column in (left, right) if column]
    return {
        "configById": left | right,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": _stack(columns, "row"),
    }


def _series(topics: Collection[str], fields: Mapping[str, Collection[str]]) -> Iterator[_Series]:
    """Yield what there is to be plotted of servos; a value alone before the same in a state."""
    seen = set()
    for topic in sorted(topics):
        found = _SERVO.fullmatch(topic)
        if found is not None and found[3] != "state":
            place = found[1], -1 if found[2] == "unknown" else int(found[2])
            seen.add((*place, found[3]))
            yield _Series(*place, found[3], f"{_quoted(topic)}.value")
    for topic in sorted(topics):
        found = _SERVO.fullmatch(topic)
        if found is not None and found[3] == "state":
            place = found[1], -1 if found[2] == "unknown" else int(found[2])
            for field in sorted(fields.get(topic, ())):
                if (*place, field) not in seen:
                    yield _Series(*place, field, f"{_quoted(topic)}.{field}")


def _plots(series: Sequence[_Series]) -> Iterator[tuple[str, list[_Series]]]:
    """Yield what is plotted together: a title, and the series that have its quantity and unit."""
    groups = list(dict.fromkeys(GROUPS.values()))
    found: dict[tuple[int, str], list[_Series]] = {}
    for s in series:
        group = GROUPS.get(s.quantity.removeprefix("goal_"))
        if group is not None:
            found.setdefault((groups.index(group), unit_of(s.field)), []).append(s)
    spelled = {end: unit for unit, end in UNITS.items()}
    for (nth, unit), mine in sorted(found.items()):
        yield groups[nth] + (f" [{word_of(spelled[unit])}]" if unit else ""), mine


def _tables(topics: Collection[str]) -> Iterator[tuple[str, str]]:
    """Yield which topics are listed, with a title: exchanges, where they can be looked up."""
    for name in ("transactions", "anomalies"):
        mine = sorted(t for t in topics if t.endswith(f"/{name}"))
        if mine:
            for topic in mine:
                yield topic, f"{name.capitalize()} of {topic.rpartition('/')[0].strip('/')}"
            return


def _plot(title: str, paths: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    shown = {
        "paths": [*paths],
        "xAxisVal": "timestamp",
        "isSynced": True,
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "showLegend": True,
        "legendDisplay": "left",  # a floating one covers half of a plot of this height
        "sidebarDimension": LEGEND,
        "showPlotValuesInLegend": False,
    }
    return _panel(title, shown)


def _panel(title: str, shown: Mapping[str, Any]) -> dict[str, Any]:
    """Return a panel with its title, as either app has it."""
    return {**shown, "foxglovePanelTitle": title, "lichtblickPanelTitle": title}


def _stack(parts: Sequence[Any], direction: str) -> Any:
    """Return parts of equal size below or beside each other: a split has two, so they nest."""
    if len(parts) == 1:
        return parts[0]
    return {
        "direction": direction,
        "first": parts[0],
        "second": _stack(parts[1:], direction),
        "splitPercentage": round(100 / len(parts), 1),
    }


def _quoted(topic: str) -> str:
    """Return a topic as it begins a path: in quotes where there are other signs than usual."""
    if _PLAIN.fullmatch(topic):
        return topic
    return '"' + re.sub(r'([\\"])', r"\\\1", topic) + '"'


def _slug(title: str) -> str:
    """Return what tells a panel from others of its type."""
    return re.sub(r"\W+", "_", title.lower()).strip("_") or "_"
