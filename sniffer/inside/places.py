"""Where to go in a capture: a time, a byte, a line, as people write them."""

from __future__ import annotations

import datetime
import re
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.model import NS, InputError, Severity

if TYPE_CHECKING:
    from sniffer.inside.index import CaptureIndex

_UNITS: Final = {"": 1.0, "ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0}
_AFTER: Final = re.compile(r"\+?(\d+(?:\.\d+)?)\s*(ns|us|ms|s|min|h|)")
_CLOCK: Final = re.compile(r"(\d{1,2}):(\d{2})(?::(\d{2})(\.\d+)?)?")
_DAY_NS: Final = 86_400 * NS

FORMS: Final = (
    "12.5 (seconds since the beginning), 10min, 20:35:20.5, an ISO time, @byte:12175 or @12175, "
    "#300 (a line), @first-error"
)
"""What ``line_of`` reads."""


def line_of(text: str, index: CaptureIndex, bus: int = 0) -> int:
    """Return the line that a place means, the one behind it where none is exactly there.

    Args:
        text: as ``FORMS`` says.
        index: the capture.
        bus: whose bytes an offset counts.

    Raises:
        InputError: it is no place, or lies outside of the capture.
    """
    text = text.strip()
    lines = index.lines
    if not len(lines):
        raise InputError("there is nothing yet")
    if text == "@first-error":
        return _first_error(index)
    if found := re.fullmatch(r"#(\d+)", text):
        return _within(int(found[1]) - 1, index, text)
    if found := re.fullmatch(r"@(?:byte:)?(\d+)", text):
        return _at_byte(int(found[1]), index, bus)
    return _within(int(np.searchsorted(lines["t"], _time(text, index), "left")), index, text)


def _time(text: str, index: CaptureIndex) -> int:
    """Return the time that a text means, in ns.

    Raises:
        InputError: it is none.
    """
    first = int(index.lines["t"][0])
    if found := _AFTER.fullmatch(text):
        return first + round(float(found[1]) * _UNITS[found[2]] * NS)
    if found := _CLOCK.fullmatch(text):
        hours, minutes, seconds = (int(part or 0) for part in found.groups()[:3])
        moment = ((hours * 60 + minutes) * 60 + seconds) * NS + round(float(found[4] or 0) * NS)
        day = first - first % _DAY_NS
        return day + moment + (_DAY_NS if day + moment < first - _DAY_NS // 2 else 0)
    try:
        when = datetime.datetime.fromisoformat(text)
    except ValueError:
        raise InputError(f"{text!r} is no place: write {FORMS}") from None
    told = when if when.tzinfo else when.replace(tzinfo=datetime.UTC)
    since = told - datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)
    return (since.days * 86_400 + since.seconds) * NS + since.microseconds * 1000


def _at_byte(offset: int, index: CaptureIndex, bus: int) -> int:
    lines = index.lines
    mine = np.flatnonzero(lines["bus"] == bus)
    at = lines["at"][mine]
    k = int(np.searchsorted(at, offset, "right")) - 1
    if k < 0 or offset >= int(at[k]) + int(lines["length"][mine[k]]):
        last = int(at[-1] + lines["length"][mine[-1]]) if len(mine) else 0
        raise InputError(f"byte {offset} is not there: {index.buses[bus]} has {last} so far")
    return int(mine[k])


def _first_error(index: CaptureIndex) -> int:
    wrong = index.lines["severity"] == Severity.ERROR + 1
    at = int(wrong.argmax()) if len(wrong) else 0
    if not wrong[at]:
        raise InputError("no error was found so far")
    return at


def _within(line: int, index: CaptureIndex, text: str) -> int:
    if not 0 <= line < len(index.lines):
        raise InputError(f"{text} is behind the end: there are {len(index.lines)} lines so far")
    return line


def like_before(index: CaptureIndex, line: int) -> int:
    """Return the last line before one that is of the same servo, command, kind and length; or -1.

    Only as far back as ``LIKE_MOST`` lines.
    """
    lines = index.lines
    one = lines[line]
    end = line
    first = max(line - LIKE_MOST, 0)
    while end > first:
        begin = max(end - _STEP, first)
        some = lines[begin:end]
        alike = np.ones(len(some), bool)
        for name in ("servo", "op", "kind", "length", "bus", "address"):
            alike &= some[name] == one[name]
        found = np.flatnonzero(alike)
        if len(found):
            return begin + int(found[-1])
        end = begin
    return -1


LIKE_MOST: Final = 1 << 17
"""How far back a like frame is looked for, in lines."""

_STEP: Final = 1 << 12
