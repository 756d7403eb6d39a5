"""Times in front of the lines of a log: what they look like, and which moments they are.

    22:55:06.001   [2026-11-20 22:55:06,001]   2026-11-20T22:55:06.001Z   of the day, or with a date
    1795215306.001216   [ 4917.001216]   +0.004                           seconds
    12 ms   [12ms]   1216 us                                              with a unit

A whole number without a unit is none: it may be of milliseconds, of microseconds, or no time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.ground.limits import is_time
from sniffer.ground.patterns import later
from sniffer.sources.text import DamagedLine, quoted
from sniffer.sources.walltime import DATELESS, YEARLESS, ZONELESS, DayClock, WallClock, zone_ns

if TYPE_CHECKING:
    import re

_NANO: Final = 9
"""Decimal places of a second that are kept."""

_UNITS: Final = {b"s": 0, b"ms": 3, b"us": 6, b"\xc2\xb5s": 6, b"\xce\xbcs": 6, b"ns": 9}
"""Decimal places by which a unit is smaller than a second."""

_UNIT: Final = rb"(?:[mun]?s|\xc2\xb5s|\xce\xbcs)"
STAMP: Final = later(
    rb"[ \t]{0,8}[\[(@]?[ \t]{0,8}"
    rb"(?:(?:(?P<day>\d{4}[-/]\d\d[-/]\d\d|--\d\d-\d\d|\d\d\.\d\d\.\d{4})[ T])?"
    rb"(?P<time>\d\d:\d\d:\d\d)(?:[.,](?P<part>\d{1,9}))?(?P<zone>Z|[+-]\d\d:?\d\d)?"
    rb"|\+?(?=\d{1,10}\.\d{3,9}(?![\d.])|\d+(?:\.\d+)?[ \t]?" + _UNIT + rb"\b)"
    rb"(?P<whole>\d{1,19})(?:\.(?P<fraction>\d{1,9}))?(?:[ \t]?(?P<unit>" + _UNIT + rb")\b)?)"
    rb"[ \t]{0,8}(?P<closed>[\])])?(?P<arrow>[ \t]{0,8}->)?[ \t]{0,8}"
    rb"(?:[:|;-]|,(?=[ \t]|-{0,3}>|<|[\[(]?[A-Fa-f]{0,8}[G-Zg-z]))?[ \t]{0,8}(?![\d:,])"
)
"""A time and what stands between it and what follows."""


def is_sure(stamp: re.Match[bytes]) -> bool:
    """Tell whether this is a time even where no direction follows: else it may be bytes."""
    return bool(stamp["arrow"] or stamp["closed"] or is_no_byte(stamp))


def is_no_byte(stamp: re.Match[bytes]) -> bool:
    """Tell whether this is a time wherever it stands: bytes have no fractions, dates or units."""
    return any(stamp[group] for group in ("part", "fraction", "day", "unit"))


def places(stamp: re.Match[bytes]) -> int:
    """Return to how many decimal places of a second a time is written."""
    return len(stamp["part"] or stamp["fraction"] or b"") + _UNITS[stamp["unit"] or b"s"]


class LogClock:
    """Which moments the times of a log are, line after line.

    ``zoneless``, ``yearless`` and ``dateless`` tell what some of them lacked.
    """

    def __init__(self) -> None:
        self._wall, self._day = WallClock(), DayClock()
        self.zoneless = self.yearless = self.dateless = False

    @property
    def remark(self) -> str:
        """What is to be said of its times, nothing where they are whole."""
        lacked = ((self.zoneless, ZONELESS), (self.yearless, YEARLESS), (self.dateless, DATELESS))
        return next((remark for lacks, remark in lacked if lacks), "")

    def ns(self, stamp: re.Match[bytes], number: int) -> int:
        """Return the moment in ns, of the line that has this number.

        Raises:
            DamagedLine: there is no such time.
        """
        if stamp["time"] is None:
            more = _NANO - _UNITS[stamp["unit"] or b"s"]
            t_ns = int(stamp["whole"] + (stamp["fraction"] or b"")[:more].ljust(more, b"0"))
        elif stamp["day"] is not None and not stamp["day"].startswith(b"--"):
            zone = (stamp["zone"] or b"").decode("ascii")
            self.zoneless |= not zone
            day = b"-".join(reversed(stamp["day"].split(b".")))  # 20.11.2026 has the day first
            t_ns = self._wall.ns(day, stamp["time"], stamp["part"] or b"", number)
            t_ns -= zone_ns(zone)
        else:
            self.yearless |= stamp["day"] is not None
            self.dateless |= stamp["day"] is None
            hour, minute, second = stamp["time"].split(b":")
            t_ns = self._day.ns(hour, minute, second, stamp["part"] or b"", number)
        if not is_time(t_ns):
            raise DamagedLine(number, f"there is no time {quoted(stamp[0].strip())}")
        return t_ns
