"""Cells that tables of figures have in common: whose a row is, when something was, how long."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sniffer.decoding.called import SERVO_NAME
from sniffer.decoding.durations import Bounds
from sniffer.ground.model import NS
from sniffer.sinks.consoles import glued
from sniffer.sinks.tabulated import ServoCell, number
from sniffer.statistics.told import OF_SERVOS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


def who_of(row: Mapping[str, Any], *, many: bool = False) -> str | ServoCell:
    """Return whose a row is; ``many``: the bus has several protocols."""
    who = "-" if row["servo_id"] is None else str(row["servo_id"])
    who = f"{row['protocol']} {who}" if many else who
    return ServoCell(who, glued(f"{who} {row[SERVO_NAME]}")) if SERVO_NAME in row else who


def left_of(bus: Mapping[str, Any], *columns: str) -> tuple[str, ...]:
    """Return the columns of words; servos are such where they have names."""
    named = any(SERVO_NAME in row for key in OF_SERVOS for row in bus[key])
    return ("servo", *columns) if named else columns


def seconds_of(t_ns: int, first: int, bus: Mapping[str, Any]) -> str:
    """Return a time since the first frame; nothing where there is no clock."""
    return "" if bus["load"] is None else f"{(t_ns - first) / NS:.3f}"


def ms_of(q: Mapping[str, Any] | None, name: str) -> str:
    """Return a figure in ms; nothing where it is not known."""
    return "" if q is None else Bounds(*q[name]).ms()


def middle_of(bounds: Sequence[float]) -> str:
    """Return a number that is known to 2 %; what is no more than a thousandth is nothing."""
    return number(sum(bounds) / 2 if bounds[1] > 1e-3 else 0.0)
