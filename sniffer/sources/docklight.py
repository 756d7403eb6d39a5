"""What Docklight writes into a plain text log in its HEX representation.

    Docklight Log File (HEX) - Started 01.03.2019 14:09:26.248
    01.03.2019 14:09:28.633 [TX] - FA AF 01 0F 2A 02 00 26
    01.03.2019 14:09:28.637 [RX] - FD DF 01 00 2A 02 01 83 03 A8  a comment behind two blanks
     a comment of its own

A time is written where the direction changes and before a sequence is sent, in front of what comes
then: it is that of the first byte, and nothing tells when the others came. Dates are as Windows has
them set. Layout as in the logs that come with the maker's examples (2005 to 2026).
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

from sniffer.ground.model import Direction
from sniffer.ground.patterns import later
from sniffer.ground.wording import counted
from sniffer.sources.blockstamps import StampedLog
from sniffer.sources.refusals import refused
from sniffer.sources.sides import oriented
from sniffer.sources.text import DamagedLine, LineBlock, Opened, quoted, read_log, remarks
from sniffer.sources.walltime import SUMMER_ENDS, ZONELESS, WallClock

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.ground.model import Chunk

_HEAD: Final = later(rb"(?:<title>)?Docklight Log File \(([^)]*)\) - (Started|Stopped) ")
_STAMP: Final = (
    rb"(\d{1,4})([./-])(\d\d?)[./-](\d{1,4}) (\d\d?:\d\d:\d\d)"
    rb"(?:[.,](\d{1,9}))?(?: ?([AaPp])\.?[Mm]\.?)? \[([^\]]{1,40})\] -(?: |$)"
)
LINE: Final = later(_STAMP + rb"((?:[0-9A-F]{2} )*(?:[0-9A-F]{2}$)?)(?: .*)?")
"""Date by its parts, time of day, fraction, half of the day, channel, bytes; a comment stands
behind two blanks."""

_STAMPED: Final = later(_STAMP)
_STROKES: Final = later(rb"^(\d\d?)/(\d\d?)/\d", re.MULTILINE)
_FURTHER: Final = later(rb"(?:[0-9A-F]{2} )+(?: .*)?")  # no comment: those begin with a blank
_HALF: Final = later(_STAMP + rb"((?:[0-9A-F]{2} )*)[0-9A-F]?$")
_OTHERWISE: Final = later(rb"\S.{0,40}\d:\d\d.{0,20}\[[^\]]{1,40}\] -(?: [0-9A-F]{2})+(?: |$)")
_TORN: Final = later(rb"Docklight.*$|\d[\d./: -]*(?:\[.{0,40})?(?:\] ?-? ?)?$")
_PLAIN: Final = "log it as plain text in the representation HEX"
_SIDES: Final = (Direction.TX, Direction.RX)


def is_docklight(lines: list[bytes]) -> bool:
    """Tell whether these are the first lines of a log in HEX.

    Raises:
        InputError: it is a log in another representation, or a page of HTML.
    """
    for line in lines:
        head = _HEAD.match(line)
        if head and (head[1] != b"HEX" or line.startswith(b"<")):
            shown = (
                "a page of HTML" if line.startswith(b"<") else head[1].decode("ascii", "replace")
            )
            raise refused(f"a Docklight log ({shown[:20]})", _PLAIN)
        if head:
            return True
        if stamped := _STAMPED.match(line):
            if LINE.fullmatch(line) and stamped.end() < len(line):
                return True
            raise refused("a Docklight log that is not in HEX", _PLAIN)
        if line[:1] not in (b"<", b" ", b""):
            return False
    return False


class _Turns(StampedLog):
    """Where a log has got to."""

    def __init__(self, bus: str, names: list[str]) -> None:
        super().__init__(bus)
        self._bus = bus
        self._names = names
        self._clock = WallClock(local=True)
        self._month_first: bool | None = None
        self.comments = 0

    def chunks(self, block: LineBlock) -> Iterator[Chunk]:
        """Yield what the lines of ``block`` hold."""
        if self._month_first is None:
            self._look_at_dates(block.text)
        yield from super().chunks(block)

    def _line(self, line: bytes, number: int, cut_off: bool) -> Iterator[Chunk]:
        found = LINE.fullmatch(line)
        if found is None and cut_off:
            found = _HALF.match(line)
            self.cut_off = found is not None or _TORN.match(line) is not None
        if found:
            t_ns, side = self._time(found.groups(), number), self._side(found[8], number)
            yield from self._block.begin(t_ns, self._bus, side, len(found[6] or b""))
            yield from self._block.add(bytes.fromhex(found[9].decode("ascii")))
        elif _FURTHER.fullmatch(line) and self._block.direction != Direction.UNKNOWN:
            yield from self._block.add(bytes.fromhex(line.partition(b"  ")[0].decode("ascii")))
        elif not self.cut_off:
            self._aside(line, number)

    def _aside(self, line: bytes, number: int) -> None:
        """Pass over a line that holds no bytes."""
        head = _HEAD.match(line)
        if head and head[1] != b"HEX":
            shown = quoted(head[1])
            raise DamagedLine(number, f"a log in {shown} begins here: {_PLAIN}", nonsense=False)
        if not head and (_STAMPED.match(line) or _OTHERWISE.match(line)):
            raise DamagedLine(number, f"{quoted(line)} is no line of a Docklight log in HEX")
        self.comments += bool(line.strip()) and head is None

    def _side(self, name: bytes, number: int) -> Direction:
        shown = name.decode("utf-8", "replace")
        if shown in ("TX", "RX") and not self._names:
            self._names += ["TX", "RX"]
        if shown not in self._names:
            if len(self._names) == len(_SIDES):
                raise DamagedLine(number, f"[{shown}] is a third channel: a log has two")
            self._names.append(shown)
        return _SIDES[self._names.index(shown)]

    def _look_at_dates(self, text: bytes) -> None:
        """Learn the order of dates with strokes, by a day beyond the 12th where there is one."""
        dates = [(int(first), int(second)) for first, second in _STROKES.findall(text)]
        if dates:
            self._month_first = not any(first > 12 for first, _ in dates)

    def _time(self, parts: tuple[bytes | None, ...], number: int) -> int:
        first, mark, second, third, time, fraction, half = (part or b"" for part in parts[:7])
        year, month, day = third, second, first
        if len(first) == 4:
            year, day = first, third
        elif mark == b"/" and self._month_first:
            month, day = first, second
        year = b"20" + year if len(year) == 2 else year
        if half:
            hour, _, rest = time.partition(b":")
            if not 1 <= int(hour) <= 12:
                raise DamagedLine(number, f"there is no time {quoted(time)} of half a day")
            time = b"%d:%s" % (int(hour) % 12 + 12 * (half in b"Pp"), rest)
        return self._clock.ns(b"-".join((year, month, day)), time, fraction, number)

    def notes(self) -> Iterator[str]:
        """Yield what is worth knowing about the log, at its end."""
        first = "only the first byte of a line has a time: no response times follow from them"
        yield f"{ZONELESS}; {first}"
        yield from remarks(
            "its dates are read with the month first" if self._month_first else "",
            SUMMER_ENDS if self._clock.went_back else "",
            f"{counted(self.comments, 'line')} of comments: left out" if self.comments else "",
            cut_off=self.cut_off,
        )


def read_docklight(opened: Opened) -> Iterator[Chunk]:
    """Yield the first byte of each line with its time, the others without.

    Who of the two sides is the controller, its frames tell.
    """
    names: list[str] = []
    return oriented(read_log(opened, _Turns(opened.bus, names)), opened.notes, names)
