"""What grabserial writes with ``--hex-output`` and times (``-t``, ``-T``, or both).

    [14:25:05.770066 0.000002] FA AF 01 0F 2A 02 00 26 FA AF 01 00 1E 02 01 84

A row has as many bytes as ``--hex-size`` says (16), however long they took to come. Its time is
taken when the first of them was read, so only that byte has a stamp. In the brackets stand the time
of day, the seconds since the very first byte and those since the row before, as options have it; in
front of them a label. Layout as in the program itself (version 2.2.0).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.ground.limits import is_time
from sniffer.ground.model import NS
from sniffer.ground.patterns import later
from sniffer.sources.blockstamps import StampedLog
from sniffer.sources.refusals import refused
from sniffer.sources.text import DamagedLine, Opened, left_out, quoted, read_log, remarks
from sniffer.sources.walltime import DATELESS, ZONELESS, DayClock, WallClock

if TYPE_CHECKING:
    import re
    from collections.abc import Iterator

    from sniffer.ground.model import Chunk

_STAMP: Final = (
    rb"(?:(\S.{0,60}?) )?\[(?:(?:(\d{4}-\d\d-\d\d) )?((\d\d):(\d\d):(\d\d))\.(\d{6})(?: |(?=\])))?"
    rb"(?:(-?\d{1,10})\.(\d{6})(?: -?\d{1,10}\.\d{6})?)?\] "
)
ROW: Final = later(_STAMP + rb"((?:[0-9A-F]{2} )*[0-9A-F]{2}) ?")
"""Label, day, time of day and its parts, fraction, seconds and their fraction, bytes."""

_GUTTER: Final = later(_STAMP + rb"(?:[0-9A-F]{2} )+> ")
_HALF: Final = later(_STAMP + rb"((?:[0-9A-F]{2} )*)[0-9A-F]?")
_TORN: Final = later(rb"(?:\S.{0,60}? )?\[[\d:. -]*(?:\] ?)?$")
_OURS: Final = later(rb"(?:\S.{0,60}? )?\[(?:\d\d:\d\d:\d\d|\d+)\.\d{6}[ \]]")


def is_row(line: bytes) -> bool:
    """Tell whether ``line`` is a row with a time.

    Raises:
        InputError: it is one of ``--hex-ascii``.
    """
    if _GUTTER.match(line):
        what = "a log of `grabserial --hex-ascii`, which leaves out every byte 0D,"
        raise refused(what, "log with `--hex-output` alone")
    return ROW.fullmatch(line) is not None


class _GrabserialLog(StampedLog):
    """Where a log has got to."""

    def __init__(self, bus: str) -> None:
        super().__init__(bus)
        self._default = bus
        self._wall = WallClock()
        self._day = DayClock()
        self.zoneless = self.dateless = False
        self.talk = 0

    def _line(self, line: bytes, number: int, cut_off: bool) -> Iterator[Chunk]:
        row = ROW.fullmatch(line)
        if row is None and cut_off:
            row = _HALF.fullmatch(line)
            self.cut_off = row is not None or _TORN.match(line) is not None
        if row is None:
            if not self.cut_off and _OURS.match(line):
                raise DamagedLine(number, f"{quoted(line)} is no row of `grabserial --hex-output`")
            self.talk += bool(line.strip()) and not self.cut_off
            return
        label = row[1]
        bus = label.decode("utf-8", "replace") if label else self._default
        yield from self._block.begin(self._time(row, number), bus)
        yield from self._block.add(bytes.fromhex(row[10].decode("ascii")))

    def _time(self, row: re.Match[bytes], number: int) -> int:
        _, day, time, hour, minute, second, fraction, seconds, part, _ = row.groups()
        if day:
            self.zoneless = True
            return self._wall.ns(day, time, fraction, number)
        if time:
            self.dateless = True
            return self._day.ns(hour, minute, second, fraction, number)
        if seconds is None:
            raise DamagedLine(number, f"{quoted(row[0])} has no time")
        t_ns = abs(int(seconds)) * NS + int(part) * 1000
        t_ns = -t_ns if seconds.startswith(b"-") else t_ns
        if not is_time(t_ns):
            raise DamagedLine(number, f"{quoted(seconds)} seconds are too many")
        return t_ns

    def notes(self) -> Iterator[str]:
        """Yield what is worth knowing about the log, at its end."""
        first = "only the first byte of a row has a time: no response times follow from them"
        dateless = DATELESS if self.dateless else "its times count from its first byte"
        yield f"{ZONELESS if self.zoneless else dateless}; {first}"
        others = left_out(self.talk, "between its rows", "grabserial's")
        yield from remarks(others, cut_off=self.cut_off)


def read_grabserial(opened: Opened) -> Iterator[Chunk]:
    """Yield the first byte of each row with its time, the others without; a label is a bus."""
    return read_log(opened, _GrabserialLog(opened.bus))
