"""Times as people read them."""

from __future__ import annotations

from sniffer.ground.limits import DATED_NS
from sniffer.ground.model import NS


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
