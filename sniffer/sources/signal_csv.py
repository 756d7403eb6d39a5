"""Levels as CSV: Saleae's digital export, sigrok's and DSView's.

Saleae says X where it has no data: the level stays. sigrok heads every column ``logic`` (the names
stand in a comment), its first column of time is one sample late, and without one only the rate in
its comments tells the times.
"""

from __future__ import annotations

import itertools
import re
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.ground.limits import is_time
from sniffer.ground.model import NS, InputError
from sniffer.signals.stretch import LogicInput, Stretch
from sniffer.sources.alike import TextLines, UnlikeError, likenesses
from sniffer.sources.locales import blocks_with_points
from sniffer.sources.sigrok import rate_in, unlike
from sniffer.sources.text import DamagedLine, LineBlock, arriving, cells_of, quoted
from sniffer.sources.walltime import zone_ns

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.ground.model import F64, I64, U8
    from sniffer.sources.text import Opened

HEADER_LINES: Final = 64
"""Lines before the first one with levels."""

ROWS_ALIKE: Final = 64
"""Of so many samples some are like the one before: a bit has more than one."""

TICKS_MOST: Final = 1e18
"""A time beyond it, in ns or samples, is none."""

COLUMNS_MOST: Final = 64
"""So many levels of a row are read in columns: no analyser has more."""

_RATE: Final = re.compile(r"sample ?rate:? *([0-9.]+ *[kMG]?Hz)", re.IGNORECASE)
_META: Final = re.compile(r"META samplerate: ([0-9]{1,15})")
"""What sigrok writes among the lines of a device that learns its rate only then."""
_NAMES: Final = re.compile(r"; Channels \(\d+/\d+\): (.+)")
_TRIGGER: Final = "Trigger"
_UNIT: Final = re.compile(r"[\[(]([^\])]+)[\])]")
_UNITS: Final = {
    unit: scale
    for units, scale in (
        (("s", "seconds"), 1.0),
        (("ms", "milliseconds"), 1e-3),
        (("us", "\u00b5s", "microseconds"), 1e-6),
        (("ns", "nanoseconds"), 1e-9),
        (("ps", "picoseconds"), 1e-12),
    )
    for unit in units
}
_DATE: Final = re.compile(rb"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(?:\.\d{1,9})?)(Z|[+-]\d\d:?\d\d)?,")
_TIME: Final = re.compile(rb"-?([0-9]{1,15})(?:\.|(?![0-9.]))([0-9]{0,9})")
_LEVELS: Final = re.compile(rb"[ \t]*[01xX]([ \t]*,[ \t]*[01xX])*[ \t]*")


class _Head(NamedTuple):
    """What stands before the levels.

    ``scale`` is the unit of the first column in seconds, 0 where it is no time; ``rate`` the
    samples a second, 0 where nobody says it.
    """

    names: Sequence[str]
    scale: float
    rate: float
    is_sigrok: bool
    first: LineBlock


def read_signal_csv(opened: Opened) -> LogicInput:
    """Open a table.

    Raises:
        InputError: it does not say what is in it.
    """
    given = blocks_with_points(arriving(opened.stream))
    text = (block for block in given if block is not None)
    head = _head(text)
    line = head.first.text[:200].lstrip()
    dated = _DATE.match(line) if head.scale else None
    try:
        zero_ns = _unix_ns(dated) if dated else 0
    except ValueError:
        raise InputError(f"there is no date {quoted(line.partition(b',')[0])}") from None
    if not head.scale and not head.rate:
        raise InputError("the table has neither times nor a sample rate: export it with times")
    per_second = head.rate or float(NS)
    rows = _LevelRows(head, per_second, is_dated=dated is not None)
    return LogicInput(
        head.names,
        NS / per_second,
        1 if head.rate else 0,
        rows.stretches(head.first, text),
        is_dated=dated is not None,
        is_open_ended=bool(head.scale),
        zero_ns=zero_ns,
    )


def _head(text: Iterator[LineBlock]) -> _Head:
    block = next(text, None)
    lines = block.text.split(b"\n", HEADER_LINES) if block is not None else []
    rate, is_sigrok = 0.0, False
    names: list[str] = []
    columns: list[str] = []
    for nth, line in enumerate(lines[:HEADER_LINES]):
        shown = line.decode("utf-8", "replace").strip()
        if shown.startswith(";"):
            is_sigrok = is_sigrok or "libsigrok " in shown
            if match := _RATE.search(shown):
                rate = rate_in(match[1])
            if match := _NAMES.match(shown):
                names = [name.strip() for name in match[1].split(",")]
        elif match := _META.fullmatch(shown):
            rate = rate_in(match[1])
        elif _has_levels(line):
            assert block is not None
            rest = b"\n".join(lines[nth:])
            first = LineBlock(rest, block.number + nth, 0, block.cut_off)
            return _Head(*_named(names, columns, line, rate), rate, is_sigrok, first)
        elif shown:
            columns = [column.strip() for column in cells_of(shown)]
    raise InputError("no line of the table has a time and levels")


def _has_levels(line: bytes) -> bool:
    _, _, rest = line.partition(b",")
    return bool(_LEVELS.fullmatch(line) or (_LEVELS.fullmatch(rest) and line[:1] in b"0123456789-"))


def _named(
    names: list[str], columns: list[str], line: bytes, rate: float
) -> tuple[list[str], float]:
    """Return the names of the channels, and the unit of time, 0 where there is no column of it."""
    count = line.count(b",") + 1
    if names and columns[-1:] == [_TRIGGER]:  # sigrok's, behind its channels
        names = [*names, _TRIGGER]
    head = columns[0].lower() if columns else ""
    unit = _UNIT.search(head)
    scale = _UNITS.get(unit[1] if unit else head, 0.0)
    is_timed = bool(scale) or head.startswith("time") or 0 < len(names) == count - 1
    if is_timed and not scale and rate:
        scale = _unit_of(line, rate)
    if is_timed and not scale:
        raise InputError("the table does not say the unit of its times")
    found = columns[1:] if is_timed else columns
    if len(found) != count - is_timed or all(name in ("logic", _TRIGGER) for name in found):
        found = names if len(names) == count - is_timed else [""] * (count - is_timed)
    return unlike([name or f"D{nth}" for nth, name in enumerate(found)]), scale


def _unit_of(line: bytes, rate: float) -> float:
    """Return the unit in which sigrok says when the first sample ends; 0 if that fits none."""
    try:
        samples = float(line.partition(b",")[0]) * rate
    except ValueError:
        return 0
    if not 0.1 < samples < 1e16:  # a sample in s to fs
        return 0
    thousands = -np.log10(samples) / 3
    return float(10.0 ** (3 * np.rint(thousands))) if abs(thousands % 1 - 0.5) > 0.4 else 0


def _unix_ns(dated: re.Match[bytes]) -> int:
    """Return a date as Unix time; without a zone it is taken as UTC.

    Raises:
        ValueError: there is no such date, or none that can be reckoned with.
    """
    year, date = int(dated[1][:4]), np.datetime64(dated[1].decode(), "s")  # of ns 64 bits wrap
    if not is_time(int(date.astype(np.int64)) * NS):
        raise ValueError(f"the year {year}")
    out = int(np.datetime64(dated[1].decode(), "ns").astype(np.int64))
    return out - zone_ns((dated[2] or b"").decode())


class _LevelRows:
    """The rows of a table, block by block."""

    def __init__(self, head: _Head, per_second: float, *, is_dated: bool) -> None:
        self._count = len(head.names)
        self._scale, self._per_second = head.scale, per_second
        # sigrok counts a row's samples before it prints the time
        self._late = 1 if head.is_sigrok and head.scale else 0
        self._is_dated = is_dated
        self._zero_ns = 0
        self._row = 0
        self._levels = np.full(self._count, -1)
        self._last = -(1 << 62)

    def stretches(self, first: LineBlock, text: Iterator[LineBlock]) -> Iterator[Stretch]:
        """Yield what the rows say.

        Raises:
            DamagedLine: a row is none, or its time goes back.
        """
        for block in itertools.chain((first,), text):
            at, levels = self._read(block)
            if len(at):
                yield self._stretch(at, levels, block)

    def _read(self, block: LineBlock) -> tuple[I64, F64]:
        """Return the times of rows, in ticks, and their levels; NaN where there is no data."""
        text = block.text.strip(b"\n")
        if not self._scale:
            width = 2 * self._count
            data = np.frombuffer(text + b"\n", np.uint8)
            if len(data) % width == 0:
                signs = data.reshape(-1, width)
                values = signs[:, ::2] - np.uint8(ord("0"))
                if (values <= 1).all() and (signs[:, -1] == ord("\n")).all():
                    self._need_all(values)
                    return self._numbered(len(values)), values.astype(np.float64)
        if self._is_dated:
            text = self._undated(text, block)
        plain = None if block.cut_off or not self._scale else self._plain_cells(text)
        cells = self._cells(text, block) if plain is None else plain
        if not self._scale:
            return self._numbered(len(cells)), cells
        ticks = cells[:, 0] * (self._scale * self._per_second)
        if not (np.abs(ticks) < TICKS_MOST).all():
            raise DamagedLine(block.number, "a time is none", nonsense=False)
        return np.rint(ticks).astype(np.int64) - self._late, cells[:, 1:]

    def _need_all(self, values: U8) -> None:
        """Refuse rows of changes only (``dedup``) that do not say when they were."""
        is_first = not self._row and len(values) > ROWS_ALIKE
        if is_first and (values[1:] != values[:-1]).any(axis=1).all():
            why = "the rows of the table are changes, and have no times: export it with times"
            raise InputError(why)

    def _numbered(self, count: int) -> I64:
        self._row += count
        return np.arange(self._row - count, self._row)

    def _plain_cells(self, text: bytes) -> F64 | None:
        """Return the cells of rows that are as usual, None where they need a closer look."""
        if self._count > COLUMNS_MOST:
            return None
        lines = TextLines(text)
        pattern = re.compile(_TIME.pattern + rb",([01])" * self._count)
        levels = range(3, 3 + self._count)
        out = np.empty((len(lines), 1 + self._count))
        try:
            for some in likenesses(lines, pattern, (1, 2, *levels), ()):
                out[some.rows, 0] = some.decimals(1, 2)
                if some.one[0].startswith(b"-"):
                    out[some.rows, 0] *= -1
                for column, group in enumerate(levels, 1):
                    out[some.rows, column] = some.number(group)
        except UnlikeError:
            return None
        return out

    def _cells(self, text: bytes, block: LineBlock) -> F64:
        lines = text.replace(b"X", b"nan").replace(b"x", b"nan").decode("latin-1").split("\n")
        count = self._count + bool(self._scale)
        try:
            if block.cut_off and not _is_row(lines[-1], count):
                lines.pop()  # half a row
            found = np.loadtxt(lines, delimiter=",", ndmin=2, comments=None) if lines else None
        except ValueError:
            found = None
            lines = [line for line in lines if line.strip()]
        if not lines:
            return np.empty((0, count))
        if found is None or found.shape[1] != count:
            wrong = next((n for n, one in enumerate(lines) if not _is_row(one, count)), 0)
            shown = quoted(lines[wrong].encode())
            raise DamagedLine(block.number + wrong, f"{shown} is no row", nonsense=False)
        return found

    def _undated(self, text: bytes, block: LineBlock) -> bytes:
        """Return the rows with seconds since the first one in place of dates."""
        lines = text.split(b"\n")
        matches = [_DATE.match(line) for line in lines]
        if None in matches:
            wrong = matches.index(None)
            raise DamagedLine(block.number + wrong, f"{quoted(lines[wrong])} has no date")
        times = self._since_1970(matches, block)
        self._zero_ns = self._zero_ns or int(times[0])
        pairs = zip(times - self._zero_ns, lines, matches, strict=True)
        return b"\n".join(b"%.9f,%s" % (t / NS, one[m.end() :]) for t, one, m in pairs if m)

    def _since_1970(self, dates: Sequence[re.Match[bytes] | None], block: LineBlock) -> I64:
        """Return dates in ns, whatever their zone."""
        texts = [m[1].decode() for m in dates if m]
        try:
            whole = np.array(texts, "datetime64[s]").astype(np.int64)
            if (np.abs(whole - whole[0]) < TICKS_MOST / NS).all():
                return np.array(texts, "datetime64[ns]").astype(np.int64)
        except ValueError:
            pass  # told below
        raise DamagedLine(block.number, "a date is none, or far from the first", nonsense=False)

    def _stretch(self, at: I64, levels: F64, block: LineBlock) -> Stretch:
        steps = np.diff(at, prepend=self._last)
        if (steps < 0).any():
            line = block.number + int(np.argmax(steps < 0))
            raise DamagedLine(line, "its time is before the last", nonsense=False)
        known = ~np.isnan(levels)
        if not np.isin(levels[known], (0, 1)).all():
            raise DamagedLine(block.number, "a level is neither 0 nor 1", nonsense=False)
        before, edges = [], []
        for channel in range(self._count):
            rows = np.flatnonzero(known[:, channel])
            said = levels[rows, channel].astype(np.int64)
            if self._levels[channel] < 0 and len(said):
                self._levels[channel] = said[0]
            level = int(self._levels[channel])
            new = np.diff(said, prepend=level) != 0
            before.append(level if level >= 0 else 1)
            edges.append(at[rows[new]])
            if len(said):
                self._levels[channel] = said[-1]
        self._last = int(at[-1])
        return Stretch(before, edges, self._last)


def _is_row(line: str, count: int) -> bool:
    try:
        return len([float(cell) for cell in line.split(",")]) == count
    except ValueError:
        return False
