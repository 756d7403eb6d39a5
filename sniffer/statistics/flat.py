"""The figures of a capture as rows of one table: a row a figure, for ``--format csv``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from sniffer.decoding.called import SERVO_NAME

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

COLUMNS: Final = (
    "source",
    "bus",
    "protocol",
    "about",
    "servo_id",
    "name",
    "unit",
    "figure",
    "value",
    "low",
    "high",
    "t_ns",
    "offset",
)
"""``about`` is bus, load, slice, command, servo, value, error, step, unreached, first_motion,
anomaly or alarm; ``name`` a command, a quantity, a code or a rule, or which of the goals that were
not reached. An interval has ``low`` and ``high``, everything else a ``value``."""

NAMED_COLUMNS: Final = (*COLUMNS, SERVO_NAME)
"""The same of a capture whose servos have names."""

_LISTS: Final[Mapping[str, tuple[str, str]]] = {
    "commands": ("command", "op"),
    "anomalies": ("anomaly", "code"),
    "alarms": ("alarm", "rule"),
}

_OF_SERVOS: Final[Mapping[str, tuple[str, str]]] = {
    "values": ("value", "quantity"),
    "following_error": ("error", ""),
    "steps": ("step", ""),
    "first_motion": ("first_motion", ""),
}

_KEYS: Final = frozenset(
    ("protocol", "servo_id", SERVO_NAME, "op", "code", "rule", "quantity", "unit")
)


def rows(figures: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the rows of what ``stats(...).as_dict()`` returns, each with all ``COLUMNS``."""
    for bus in figures["buses"]:
        fixed = dict.fromkeys(COLUMNS, "") | {"source": figures["source"], "bus": bus["bus"]}
        fixed["protocol"] = "+".join(bus["protocols"])
        apart = ("load", "slices")
        plain = {k: v for k, v in bus.items() if not isinstance(v, list) and k not in apart}
        yield from _told(fixed | {"about": "bus"}, plain)
        if bus["load"] is not None:
            load = bus["load"]
            yield from _told(fixed | {"about": "load"}, {k: load[k] for k in ("mean", "peak")})
            for k, share in enumerate(load["shares"]):
                at = load["first_ns"] + k * load["slice_ns"]
                yield fixed | {"about": "load", "figure": "share", "value": share, "t_ns": at}
        slices = bus.get("slices", {"bytes": []})
        for k in range(len(slices["bytes"])):
            row = fixed | {"about": "slice", "t_ns": slices["first_ns"] + k * slices["slice_ns"]}
            for figure, counts in slices.items():
                if isinstance(counts, list):
                    yield row | {"figure": figure, "value": counts[k]}
            for name, bounds in slices.get("response_time_ns", {}).items():
                yield from _told(row, {name: bounds[k]}, "response_time_ns.")
        for key, (about, name) in _LISTS.items():
            for each in bus[key]:
                yield from _told(_keyed(fixed, about, name, each), each)
        for servo in bus["servos"]:
            yield from _told(_keyed(fixed, "servo", "", servo), servo)
            for key, (about, name) in _OF_SERVOS.items():
                for each in servo[key]:
                    keyed = _keyed(fixed, about, name, {**servo, **each})
                    yield from _told(keyed, each)
                    for nth, goal in enumerate(each.get("unreached_goals", ()), 1):
                        which = {"about": "unreached", "name": str(nth)}
                        yield from _told({**keyed, **which}, goal)


def _keyed(fixed: dict[str, Any], about: str, name: str, each: Mapping[str, Any]) -> dict[str, Any]:
    servo = each["servo_id"]
    return fixed | {
        "about": about,
        "protocol": each.get("protocol", fixed["protocol"]),
        "servo_id": "" if servo is None else servo,
        **({SERVO_NAME: each[SERVO_NAME]} if SERVO_NAME in each else {}),
        "name": each[name] if name else "",
        "unit": each.get("unit", ""),
    }


def _told(fixed: dict[str, Any], figures: Mapping[str, Any], of: str = "") -> Iterator[Any]:
    """Yield a row for each figure; what is not known has none."""
    for name, figure in figures.items():
        row = fixed | {"figure": f"{of}{name}"}
        if name in _KEYS or figure is None:
            continue
        if isinstance(figure, dict):
            if figure.keys() - {"value"} == {"t_ns", "offset"}:
                yield row | figure
            elif {"value_ns", "t_ns"} <= figure.keys():
                low, high = figure["value_ns"]
                place = {k: figure[k] for k in ("t_ns", "offset") if k in figure}
                yield row | {"low": low, "high": high, **place}
            elif name != "over_time":
                yield from _told(fixed, figure, f"{of}{name}.")
        elif isinstance(figure, list):
            if len(figure) == 2 and name not in ("t_ns", "offsets") and _are_numbers(figure):
                yield row | {"low": figure[0], "high": figure[1]}
        elif not isinstance(figure, str) or name in ("clock", "severity", "ended"):
            yield row | {"value": figure}


def _are_numbers(figure: list[Any]) -> bool:
    return all(isinstance(bound, (int, float)) for bound in figure)
