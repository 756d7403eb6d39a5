"""Dates and times without a zone, as logs of text tools have them, into nanoseconds."""

from __future__ import annotations

import calendar
import datetime
from typing import Final

from sniffer.ground.limits import is_time
from sniffer.ground.model import NS
from sniffer.sources.text import DamagedLine, quoted

ZONELESS: Final = "its times are of a clock whose zone is not said: they are taken for UTC"
"""The note about an input that has such times."""

_NANO: Final = 9  # digits of a fraction that are kept


def zone_ns(zone: str) -> int:
    """Return by how much a zone is ahead of UTC: ``+01:00``, ``-0330``, ``Z`` or nothing."""
    if zone in ("", "Z"):
        return 0
    minutes = int(zone[1:3]) * 60 + int(zone[-2:])
    return (-minutes if zone[0] == "-" else minutes) * 60 * NS


class WallClock:
    """Reads dates and times; lines of one second, as most are, cost one division less."""

    def __init__(self) -> None:
        self._known = b""
        self._seconds = 0

    def ns(self, day: bytes, time: bytes, fraction: bytes, line: int) -> int:
        """Return ``2026/11/20`` or ``2026-11-20``, ``22:57:27`` and digits of a fraction in ns.

        Raises:
            DamagedLine: there is no such time, or none that can be reckoned with.
        """
        known = day + time
        if known != self._known:
            year, month, date = map(int, day.replace(b"/", b"-").split(b"-"))
            hour, minute, second = map(int, time.split(b":"))
            try:
                datetime.datetime(year, month, date, hour, minute, min(second, 59))
            except ValueError:
                raise DamagedLine(line, f"there is no time {quoted(day + b' ' + time)}") from None
            seconds = calendar.timegm((year, month, date, hour, minute, second))
            if not is_time(seconds * NS):
                raise DamagedLine(line, f"{quoted(day)} is not between 1969 and 2257")
            self._known, self._seconds = known, seconds
        return self._seconds * NS + int(fraction[:_NANO].ljust(_NANO, b"0"))
