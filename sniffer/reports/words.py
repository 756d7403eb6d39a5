"""Numbers, times and units as reports tell them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sniffer.ground.amounts import number
from sniffer.ground.model import NS, Clock
from sniffer.ground.moments import date_of, of_day, with_day
from sniffer.ground.units import behind

if TYPE_CHECKING:
    from sniffer.statistics.figures import Range


def measured(value: float, name: str) -> str:
    """Return a value with its unit."""
    return f"{number(value)}{behind(name)}"


def spread(values: Range | None, name: str) -> str:
    """Return from where to where values go; empty where there are none."""
    if values is None:
        return ""
    low, high = number(values.least.value), number(values.most.value)
    return f"{low}{behind(name)}" if low == high else f"{low} … {high}{behind(name)}"


def moment(t_ns: int, clock: Clock, digits: int = 3) -> str:
    """Return a time as a clock shows it, UTC; seconds where the input has no clock."""
    return f"{t_ns / NS:.{digits}f} s" if clock == Clock.NONE else of_day(t_ns, digits)


def period(first_ns: int, last_ns: int, clock: Clock) -> tuple[str, str]:
    """Return when something began and when it ended, with the day of the end if it is another."""
    first = moment(first_ns, clock)
    return first, moment(last_ns, clock) if clock == Clock.NONE else with_day(last_ns, first_ns)


def dated(t_ns: int) -> str:
    """Return a time with its day; seconds where it counts from something else than 1970."""
    date = date_of(t_ns)
    return f"{date} {of_day(t_ns)} UTC" if date else f"{t_ns / NS:.3f} s (no date)"


def listed(names: list[str], most: int = 8) -> str:
    """Return names with commas, the last ones counted where there are many."""
    if len(names) <= most:
        return ", ".join(names)
    return f"{', '.join(names[:most])} and {len(names) - most} more"
