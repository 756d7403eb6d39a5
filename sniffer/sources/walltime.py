"""Dates and times without a zone, and times of the day, as logs of text tools have them, in ns."""

from __future__ import annotations

import calendar
import datetime
from typing import Final

from sniffer.ground.limits import is_time
from sniffer.ground.model import NS
from sniffer.ground.moments import DAY_NS
from sniffer.sources.text import DamagedLine, quoted

ZONELESS: Final = "its times are of a clock whose zone is not said: they are taken for UTC"
"""The note about an input that has such times."""

DATELESS: Final = "its times have no date: they count from the midnight before it began"
"""The note about an input that has times of the day alone."""

YEARLESS: Final = "its dates have no year: its times count from the midnight before it began"
"""The note about an input whose dates are of a month and a day."""

SUMMER_ENDS: Final = "its clock goes back an hour at a full hour, as summer time ends: times go on"
"""The note about an input whose clock does so."""

_HOUR: Final = 3600
_PAUSE_MOST: Final = 600
"""Seconds that may pass meanwhile: a clock that goes back by less than the rest was set."""

_NANO: Final = 9  # digits of a fraction that are kept


def zone_ns(zone: str) -> int:
    """Return by how much a zone is ahead of UTC: ``+01:00``, ``-0330``, ``Z`` or nothing."""
    if zone in ("", "Z"):
        return 0
    minutes = int(zone[1:3]) * 60 + int(zone[-2:])
    return (-minutes if zone[0] == "-" else minutes) * 60 * NS


class WallClock:
    """Reads dates and times; lines of one second, as most are, cost one division less.

    Args:
        local: the clock may go back, where summer time ends; lines come in order.
    """

    def __init__(self, *, local: bool = False) -> None:
        self._known = b""
        self._seconds = 0
        self._local = local
        self._ahead = 0  # seconds of summer time that are over
        self._last: int | None = None  # seconds as they were told last

    @property
    def went_back(self) -> bool:
        """Whether summer time ended."""
        return self._ahead > 0

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
            if self._local:
                seconds = self._going_on(seconds)
            self._known, self._seconds = known, seconds
        return self._seconds * NS + int(fraction[:_NANO].ljust(_NANO, b"0"))

    def _going_on(self, seconds: int) -> int:
        """Return a time of local clocks as one that does not go back where summer time ends."""
        last, self._last = self._last, seconds
        if last is not None and 0 <= seconds + _HOUR - last <= _PAUSE_MOST:
            # it goes back at a full hour, so one lies between
            self._ahead += _HOUR * ((seconds + _HOUR) // _HOUR > last // _HOUR)
        return seconds + self._ahead


class DayClock:
    """Reads times of the day; one that lies far before the last one is of the next day."""

    def __init__(self) -> None:
        self._day_ns = 0
        self._last_ns = 0

    def ns(self, hour: bytes, minute: bytes, second: bytes, fraction: bytes, line: int) -> int:
        """Return a time of the day in ns since the midnight before the first one.

        Raises:
            DamagedLine: there is no such time.
        """
        h, m, s = int(hour), int(minute), int(second)
        if h > 23 or m > 59 or s > 60:  # a minute may have a leap second
            shown = quoted(b":".join((hour, minute, second)))
            raise DamagedLine(line, f"there is no time {shown}")
        t_ns = (h * 3600 + m * 60 + s) * NS + int(fraction[:_NANO].ljust(_NANO, b"0"))
        if t_ns + self._day_ns < self._last_ns - DAY_NS // 2:
            self._day_ns += DAY_NS
        self._last_ns = t_ns + self._day_ns
        return self._last_ns
