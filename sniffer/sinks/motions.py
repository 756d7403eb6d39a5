"""Tables of how servos move: how far off their goals, how late, which goals they never reach."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from sniffer.ground.model import NS
from sniffer.ground.units import word_of
from sniffer.sinks.cells import left_of, middle_of, ms_of, seconds_of, who_of
from sniffer.sinks.tabulated import Tabulated, number
from sniffer.statistics.lags import whole_ms

if TYPE_CHECKING:
    from collections.abc import Mapping

Row = tuple[Any, ...]

_ENDED: Final = {"next_goal": "next goal", "let_go": "let go", "capture_end": "end of capture"}


def error_table(bus: Mapping[str, Any], first: int) -> Tabulated | None:
    """Return how far servos are from their goals, the furthest first."""
    rows: list[Row] = [(s, e) for s in bus["servos"] for e in s["following_error"]]
    if not rows:
        return None
    table = Tabulated(
        "servo", "unit", "values", "p50", "p95", "max", "at s", "at byte", left=left_of(bus)
    )
    for s, e in sorted(rows, key=lambda r: -r[1]["size"]["max"][1]):
        size, worst = e["size"], e["worst"]
        half = [middle_of(size[name]) for name in ("p50", "p95")]
        place = seconds_of(worst["t_ns"], first, bus), str(worst["offset"])
        values = str(size["count"]), *half, number(worst["value"])
        table.add_row(who_of(s), word_of(e["unit"]), *values, *place)
    return table


def lag_table(bus: Mapping[str, Any]) -> Tabulated | None:
    """Return how far servos are behind goals that move, the last first."""
    rows: list[Row] = [(s, e) for s in bus["servos"] for e in s["following_error"] if e["lag"]]
    if not rows:
        return None
    columns = ("servo", "unit", "values", "lag ms", "error (rms)", "without lag")
    table = Tabulated(*columns, left=left_of(bus))
    for s, e in sorted(rows, key=lambda r: -r[1]["lag"]["ns"][1]):
        lag = e["lag"]
        left = number(lag["rms_unshifted"]), number(lag["rms"])
        table.add_row(who_of(s), word_of(e["unit"]), str(lag["count"]), whole_ms(*lag["ns"]), *left)
    return table


def step_table(bus: Mapping[str, Any]) -> Tabulated | None:
    """Return how servos take new goals, the slowest to settle first."""
    rows: list[Row] = [(s, e) for s in bus["servos"] for e in s["steps"] if e["count"]]
    if not rows:
        return None
    columns = ("servo", "steps", "settled", "in ms p50", "max", "overshoot p50", "max", "not")
    table = Tabulated(*columns, left=left_of(bus, "not"))

    def rank(row: Row) -> tuple[float, ...]:
        settled = row[1]["fates"].get("settled", 0) / row[1]["count"]
        return settled, -(row[1]["settle_ns"] or {"max": [0, 0]})["max"][1]

    for s, e in sorted(rows, key=rank):
        past = e["overshoot_percent"]
        beyond = [f"{middle_of(past[n])} %" if past else "" for n in ("p50", "max")]
        others = [f"{n} {k.replace('_', ' ')}" for k, n in e["fates"].items() if k != "settled"]
        settled = str(e["fates"].get("settled", 0))
        times = [ms_of(e["settle_ns"], n) for n in ("p50", "max")]
        table.add_row(who_of(s), str(e["count"]), settled, *times, *beyond, ", ".join(others))
    return table


def start_table(bus: Mapping[str, Any], first: int) -> Tabulated | None:
    """Return how soon servos begin to move, the slowest first."""
    rows: list[Row] = [(s, m) for s in bus["servos"] for m in s["first_motion"]]
    if not rows:
        return None
    columns = ("servo", "goals", "moved", "in ms min", "p50", "max", "at s", "not")
    table = Tabulated(*columns, left=left_of(bus, "not"))

    def rank(row: Row) -> tuple[float, ...]:
        mine = row[1]
        return mine["moved"] / mine["told"], -(mine["ns"] or {"max": [0, 0]})["max"][1]

    for s, m in sorted(rows, key=rank):
        times = [ms_of(m["ns"], name) for name in ("min", "p50", "max")]
        at = seconds_of(m["slowest"]["t_ns"], first, bus) if m["slowest"] else ""
        waiting = m["told"] - m["moved"] - m["recalled"]
        others = [(m["recalled"], "recalled"), (waiting, "under way")]
        left = ", ".join(f"{n} {what}" for n, what in others if n)
        table.add_row(who_of(s), str(m["told"]), str(m["moved"]), *times, at, left)
    return table


def unreached_table(bus: Mapping[str, Any], first: int) -> Tabulated | None:
    """Return the goals that were not reached, the one that was left furthest away first."""
    rows: list[Row] = [
        (s, steps["unit"], goal)
        for s in bus["servos"]
        for steps in s["steps"]
        for goal in steps["unreached_goals"]
    ]
    if not rows:
        return None
    columns = ("servo", "at s", "goal", "from", "stayed at", "off by", "unit", "held s", "ended by")
    table = Tabulated(*columns, left=left_of(bus, "unit", "ended by"))

    def off(goal: Mapping[str, Any]) -> float:
        return float(goal["goal"]["value"] - goal["left"]["value"])

    for s, unit, goal in sorted(rows, key=lambda row: (-abs(off(row[2])), row[2]["goal"]["t_ns"])):
        left = number(goal["left"]["value"]) + ("" if goal["stands"] else " (moving)")
        way = number(goal["goal"]["value"]), number(goal["start"]), left, number(off(goal))
        held = f"{goal['held_ns'] / NS:.2f}"
        at = seconds_of(goal["goal"]["t_ns"], first, bus)
        table.add_row(who_of(s), at, *way, word_of(unit), held, _ENDED[goal["ended"]])
    return table
