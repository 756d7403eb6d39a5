"""Times as people read them."""

from __future__ import annotations

import datetime
from typing import Final

from sniffer.ground.limits import DATED_NS
from sniffer.ground.model import NS

DAY_NS: Final = 86400 * NS
"""A day of UTC, which has no leap seconds where times are counted from 1970."""


def of_day(t_ns: int, digits: int = 3) -> str:
    """Return a time as a clock shows it (UTC), with so many digits behind the second.

    One that tells no day counts from something else: its hours go on behind 24.
    """
    ns = abs(t_ns)
    minutes, second = divmod(ns // NS, 60)
    hour, minute = divmod(minutes, 60)
    if t_ns >= DATED_NS:
        hour %= 24
    part = f".{ns % NS // 10 ** (9 - digits):0{digits}}" if digits else ""
    return f"{'-' if t_ns < 0 else ''}{hour:02}:{minute:02}:{second:02}{part}"


def date_of(t_ns: int) -> str:
    """Return the day of a time (UTC), nothing of one that tells no day."""
    if t_ns < DATED_NS:
        return ""
    return datetime.datetime.fromtimestamp(t_ns // NS, datetime.UTC).date().isoformat()


def with_day(t_ns: int, first_ns: int, digits: int = 3) -> str:
    """Return a time as a clock shows it, with its day where that is not the day of a first time."""
    date = date_of(t_ns)
    told = of_day(t_ns, digits)
    return told if date == date_of(first_ns) else f"{date} {told}"
