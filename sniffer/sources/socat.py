"""What ``socat -x`` and ``socat -x -v`` write of the bytes that pass between two ports.

    > 2026/11/20 22:55:10.000150680  length=10 from=18 to=27
     fd df 01 00 2a 02 01 83 03 a8                    ....*.....
    --

The header says how many bytes follow, so the gutter of ``-v``, which may look like hex, is never
looked at. Between blocks stands whatever else went to the same terminal. Layout and order of things
as in xiotransfer.c of socat 1.7: a block is written when it was read, before it is passed on.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

from sniffer.ground.limits import OFFSET_END
from sniffer.ground.model import Chunk, Clock, Direction, Mark, MarkKind
from sniffer.ground.patterns import later
from sniffer.sources.sides import handed_over, oriented
from sniffer.sources.text import (
    PIECE,
    DamagedLine,
    LineBlock,
    LineWalk,
    Opened,
    TextLog,
    left_out,
    quoted,
    read_log,
    remarks,
)
from sniffer.sources.walltime import SUMMER_ENDS, ZONELESS, WallClock

if TYPE_CHECKING:
    from collections.abc import Iterator

HEADER: Final = later(
    rb"^([<>]) (\d{4}/\d\d/\d\d) (\d\d:\d\d:\d\d)(?:\.(\d{1,9}))? +length=(\d{1,19})"
    rb" from=(\d{1,19}) to=(\d{1,19})[ ]*$",
    re.MULTILINE,
)
"""Direction, day, time, fraction, number of bytes, and their places in the direction's stream."""

# a block on one line, as nearly all are: what is odd is read line by line
_ENTRY: Final = later(
    rb"([<>]) (.{19})\.(\d{6}|\d{9})  length=(\d{1,19})"
    rb" from=(\d{1,19}) to=(\d{1,19})\n((?: [0-9a-f]{2})+)( *)([^\n]*)\n(?:--\n)?"
)
_ALL: Final = later(rb"(?: [0-9a-f]{2})+ *")  # -x: a block on one line
_ROW: Final = later(rb"((?: [0-9a-f]{2}){1,16}) *")  # -x -v: 48 columns before the gutter
_COLUMNS: Final = 48
TALK: Final = later(rb"\d{4}/\d\d/\d\d \d\d:\d\d:\d\d(?:\.\d+)? socat\[")
"""How a line begins in which socat speaks of itself."""

_HALF: Final = later(rb"[<>](?: [\d/]{0,10}(?: [\d:.]*(?: +[a-z=\d ]*)?)?)?$|-$")
_SIDES: Final = {b">": Direction.TX, b"<": Direction.RX}  # until it is known who answers
_LOST_MOST: Final = 1 << 32  # a larger hole is a damaged number: four days of a line at 115200
_NINE: Final = 9
_MICRO: Final = b"000"


def is_row(line: bytes) -> bool:
    """Tell whether a line holds bytes of a block."""
    return bool(_ALL.fullmatch(line) or _ROW.fullmatch(line[:_COLUMNS]))


class _Block:
    """A block that is being read: what its header says, and what has come of it."""

    def __init__(self, t_ns: int, side: Direction, size: int, marks: tuple[Mark, ...]) -> None:
        self.t_ns = t_ns
        self.side = side
        self.size = size
        self.marks = marks
        self.left = size
        self.data = bytearray()


class _SocatLog(TextLog):
    """Where a log has got to."""

    def __init__(self, bus: str) -> None:
        self._bus = bus
        self._clock = WallClock(local=True)
        self._stamp = b""  # the last second, and when it began
        self._stamp_ns = 0
        self._micro: bool | None = None  # whether nine digits are microseconds
        self._block: _Block | None = None
        self._due: dict[Direction, int] = {}
        self._size = 0  # of all blocks so far
        self._heard: dict[Direction, int] = {}  # of them, when a side was heard last
        self.cut_off = False
        self.talk = 0
        self.logs = 1
        self.lost: list[int] = []

    def chunks(self, block: LineBlock) -> Iterator[Chunk]:
        """Yield what the lines of ``block`` hold."""
        if self._micro is None:
            stamps = [found[3] for found in HEADER.findall(block.text) if len(found[3]) == _NINE]
            self._micro = all(stamp.startswith(_MICRO) for stamp in stamps) if stamps else None
        walk = LineWalk(block)
        while walk.is_inside:
            if self._block is None and (found := _ENTRY.match(block.text, walk.at)):
                chunk = self._entry(found.groups())
                if chunk is not None:
                    walk.at = found.end()
                    yield chunk
                    continue
            yield from self._line(*walk.line(), block.cut_off)

    def _entry(self, said: tuple[bytes, ...]) -> Chunk | None:
        """Return what a block says that is on one line and as usual; None: look closer."""
        mark, stamp, fraction, length, begin, end, row, blanks, gutter = said
        size, first, last = int(length), int(begin), int(end)
        side = _SIDES[mark]
        if len(row) != 3 * size or last - first + 1 != size or last >= OFFSET_END:
            return None
        if gutter and (len(row) > _COLUMNS or len(row) + len(blanks) < _COLUMNS):
            return None
        if self._due.get(side, first) != first or stamp != self._stamp:
            return None
        nine = len(fraction) == _NINE
        if nine and (self._micro is None or (self._micro and not fraction.startswith(_MICRO))):
            return None
        t_ns = self._stamp_ns + int(fraction) * (1 if nine and not self._micro else 1000)
        self._due[side] = last + 1
        self._size += size
        self._heard[side] = self._size
        return Chunk(bytes.fromhex(row.decode("ascii")), t_ns, Clock.FILE, self._bus, side)

    def rest(self) -> Iterator[Chunk]:
        """Yield what has come of a block that is not whole."""
        if self._block is not None:
            self.cut_off = True
            yield from self._piece(self._block)
            self._block = None

    def _line(self, line: bytes, number: int, cut_off: bool) -> Iterator[Chunk]:
        if self._block is not None:
            if line.startswith(b" "):
                yield from self._row(self._block, line, number, cut_off)
            elif line and not TALK.match(line):
                short = f"a block of {self._block.size} bytes ends {self._block.left} bytes early"
                raise DamagedLine(number, f"{short}, at {quoted(line)}", nonsense=False)
            return
        header = HEADER.match(line)
        if cut_off and (header or _HALF.match(line)):
            self.cut_off = True  # of a header the last number may be half
        elif header:
            self._begin(header, number)
        elif line.startswith((b" ", b"<", b">")):
            raise DamagedLine(number, f"{quoted(line)} belongs to no block of socat -x")
        elif line and line != b"--":
            self.talk += not TALK.match(line)

    def _begin(self, header: re.Match[bytes], number: int) -> None:
        mark, day, time, fraction = header[1], header[2], header[3], header[4] or b""
        size, first, last = int(header[5]), int(header[6]), int(header[7])
        if not size or last - first + 1 != size or last >= OFFSET_END:
            raise DamagedLine(number, f"{quoted(_counts(header))} does not add up", nonsense=False)
        if len(fraction) == _NINE and self._micro is not False:
            # Microseconds, filled up to nine digits: socat 1.7.4 prints timeval by the format of
            # timespec. A log with others has nanoseconds.
            self._micro = fraction.startswith(_MICRO)
            fraction = fraction[3:] if self._micro else fraction
        t_ns = self._clock.ns(day, time, fraction, number)
        self._stamp = b"%s %s" % (day, time)
        self._stamp_ns = t_ns - int(fraction.ljust(_NINE, b"0"))
        side = _SIDES[mark]
        self._block = _Block(t_ns, side, size, self._hole(side, first, size, number))
        self._due[side] = last + 1
        self._size += size
        self._heard[side] = self._size

    def _hole(self, side: Direction, first: int, size: int, number: int) -> tuple[Mark, ...]:
        """Return what is to be said where bytes before a block are missing."""
        due = self._due.get(side, first)
        if first < due:
            if first:
                why = f"from={first} goes back, {due} is due: the log is damaged"
                raise DamagedLine(number, why, nonsense=False)
            self.logs += 1
            self._due = dict.fromkeys(self._due, 0)
            return (Mark(MarkKind.SILENT, 0),)  # another run: nothing leads across
        if first == due:
            return ()
        if first - due > _LOST_MOST:
            why = f"{first - due} bytes are missing before from={first}: not credible"
            raise DamagedLine(number, why, nonsense=False)
        # anywhere since the side was heard last: what the other one said meanwhile is there
        self.lost.append(first - due)
        since = self._size - self._heard[side]
        return (Mark(MarkKind.OVERRUN, -since, since + size, first - due),)

    def _row(self, block: _Block, line: bytes, number: int, cut_off: bool) -> Iterator[Chunk]:
        row = _ALL.fullmatch(line) or _ROW.fullmatch(line[:_COLUMNS])
        text = row[0] if row else b""
        if row is None and cut_off:
            half = _ALL.match(line)  # in mid-byte
            text = half[0] if half else b""
        elif row is None:
            why = f"{quoted(line)} is no line of a block of {block.size} bytes"
            raise DamagedLine(number, why)
        data = bytes.fromhex(text.decode("ascii"))
        if len(data) > block.left:
            raise DamagedLine(number, f"more bytes than length={block.size} says")
        block.data += data
        block.left -= len(data)
        if not block.left:
            self._block = None
        if not block.left or len(block.data) >= PIECE:
            yield from self._piece(block)

    def _piece(self, block: _Block) -> Iterator[Chunk]:
        if block.data:
            data, marks = bytes(block.data), block.marks
            block.data.clear()
            block.marks = ()
            yield Chunk(data, block.t_ns, Clock.FILE, self._bus, block.side, marks)

    def notes(self) -> Iterator[str]:
        """Yield what is worth knowing about the log, at its end."""
        nine = "nine digits of its seconds are microseconds, as socat 1.7.4 writes them"
        yield f"{ZONELESS}; {nine}" if self._micro else ZONELESS
        told = []
        if self.lost:
            places = "1 place" if len(self.lost) == 1 else f"{len(self.lost)} places"
            lost = f"{sum(self.lost)} bytes are missing in {places}"
            told.append(f"{lost}, as from= and to= count them")
        if self.logs > 1:
            told.append(f"{self.logs} logs, one behind the other, are read as one stream")
        if self._clock.went_back:
            told.append(SUMMER_ENDS)
        others = left_out(self.talk, "between its blocks", "socat's")
        yield from remarks(*told, others, cut_off=self.cut_off)


def _counts(header: re.Match[bytes]) -> bytes:
    """Return what a header says of lengths and places."""
    return b"length=%s from=%s to=%s" % (header[5], header[6], header[7])


def read_socat(opened: Opened) -> Iterator[Chunk]:
    """Yield one chunk a block; who of the two sides is the controller, its frames tell."""
    told = oriented(read_log(opened, _SocatLog(opened.bus)), opened.notes, (">", "<"))
    return handed_over(told, Direction.TX)
