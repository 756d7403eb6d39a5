r"""What known programs put in front of lines, in the form that lines of one's own have it.

    Nov 20 22:55:06.000112 pi robot[812]: TX: FF A0        journalctl -o short-precise
    11-20 22:55:06.000  1234  1250 D ServoBus: TX: FF A0   logcat
    [Fri Nov 20 22:55:06.000 2026] FF A0                   Tera Term
    "0.004","TX","FF A0"                                   a table without a head, all in quotes

Dates without a year become ``--11-20``, as ISO 8601 has them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.ground.patterns import later
from sniffer.sources.logstamps import STAMP

if TYPE_CHECKING:
    import re

_MONTHS: Final = b"Jan Feb Mar Apr May Jun Jul Aug Sep Oct Nov Dec".split()
_MONTH: Final = rb"(?P<month>" + b"|".join(_MONTHS) + rb")"
_DAY: Final = rb"(?:Mon|Tue|Wed|Thu|Fri|Sat|Sun),? "

_PREFIX: Final = later(
    _MONTH + rb" (?P<date>[ \d]\d) (?P<time>\d\d:\d\d:\d\d\.\d{3,9}) "
    rb"\S{1,64} (?P<name>[^\s:\[]{1,64})(?:\[\d{1,10}\])?: "
    rb"|(?P<number>\d\d)-(?P<dated>\d\d) (?P<clock>\d\d:\d\d:\d\d\.\d{3,9}) {1,6}"
    rb"\d{1,8} {1,6}\d{1,8} [VDIWEF] (?P<tag>[^:]{1,64}): "
)
"""Times of a second are none of them: of many lines nobody knew which came when."""

_DATED: Final = later(
    rb"(?P<open>[\[(]?)(?:"
    + _DAY
    + rb")?"
    + _MONTH
    + rb" {1,2}(?P<date>\d{1,2}) (?P<time>\d\d:\d\d:\d\d(?:\.\d{1,9})?) (?P<year>\d{4})(?!\w)"
)
_CELLS: Final = later(rb'(?:"[^"]*"[,;\t] ?){1,3}"[^"]*"')


def prefix_of(line: bytes) -> tuple[bytes, bytes, int] | None:
    """Return the time, the name and the end of what a log of a system has in front; None: none."""
    found = _PREFIX.match(line)
    if found is None:
        return None
    month = found["number"] or b"%02d" % _number(found)
    date, time = found["dated"] or found["date"], found["clock"] or found["time"]
    day = b"--%s-%02d %s" % (month, int(date), time)
    return day, (found["name"] or found["tag"]).strip(), found.end()


def in_numbers(line: bytes) -> bytes:
    """Return a line with a date in front that has its month in letters as one in numbers."""
    found = _DATED.match(line)
    if found is None:
        return line
    told = (found["open"], found["year"], _number(found), int(found["date"]), found["time"])
    return b"%s%s-%02d-%02d %s" % told + line[found.end() :]


def unquoted(line: bytes) -> bytes:
    """Return cells in quotes without these, where the first one is a time or the like."""
    text = line.strip()
    if text[:1] != b'"' or not _CELLS.fullmatch(text):
        return line
    cells = text.split(b'"')[1::2]
    return b"; ".join(cells) if STAMP.fullmatch(cells[0]) else line


def _number(found: re.Match[bytes]) -> int:
    return _MONTHS.index(found["month"]) + 1
