r"""What pySerial's ``spy://`` prints of the calls that a program makes on its port.

    000003.001 TX   0000  48 45 4C 4C 4F                                    HELLO
    000003.102 RX   0000  48 45 4C 4C 4F                                    HELLO
    000003.250 Q-RX reset_input_buffer

Columns as in serial/urlhandler/protocol_spy.py of pySerial 3.5: seconds since the port was opened,
rounded to milliseconds, before a write and behind a read; the offset counts the bytes of one call.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from sniffer.ground.coarse import coarse
from sniffer.ground.limits import is_time
from sniffer.ground.model import MS, NS, Chunk, Clock, Direction, Mark, MarkKind
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

if TYPE_CHECKING:
    from collections.abc import Iterator

SPY_LINE: Final = later(
    rb"(-?\d{5,12})\.(\d{3}) (TX|RX|Q-RX|Q-TX|BRK|RTS|DTR|CTS|DSR|RI|CD) +(\S.*)"
)
"""Seconds, thousandths, label, and what was called or the offset with the bytes."""

COLOURS: Final = later(rb"\x1b\[\d+m")
"""What the option ``color`` puts in front of the lines."""

# a line of a call, as nearly all are: what is odd is read line by line
_ENTRY: Final = later(
    rb"(\d{5,9})\.(\d{3}) (TX|RX)   ([0-9A-F]{4})  "
    rb"((?:[0-9A-F]{2} ){1,8}(?: (?:[0-9A-F]{2} ){1,8})?)( *)([^\n]*)\n"
)
_SURE: Final = later(rb"\d{6}\.\d{3} [TR]X   0000  [0-9A-F]{2} ")
_BYTES: Final = later(rb"([0-9A-F]{4,12})  (.*)")
_ROW: Final = later(rb"(?:[0-9A-F]{2} ){1,8}(?: (?:[0-9A-F]{2} ){0,8})?")
_COLUMNS: Final = 49  # of hex: 16 bytes with a blank each, and one in the middle
_TORN: Final = later(rb".*[TR]X   [0-9A-F]{4}  ")  # such a line is no word of the program
_EMPTY: Final = b"<empty>"
_HALF: Final = later(rb"-?\d*(?:\.\d{0,3}(?: (?:[A-Z-]{0,4}(?: +[0-9A-F]*)?)?)?)?$")
_STAMPED: Final = later(rb"-?\d{5,}")
_DIRECTIONS: Final = {b"TX": Direction.TX, b"RX": Direction.RX}
_PLACES: Final = 3
"""Decimal places of the seconds that it writes."""

_BREAKS: Final = (b"send_break", b"active")


def is_log(lines: list[bytes]) -> bool:
    """Tell whether a log begins in these lines: what the program says may stand before it."""
    plain = [COLOURS.sub(b"", line) for line in lines]
    return bool(SPY_LINE.fullmatch(plain[0])) or any(_SURE.match(line) for line in plain)


class _Calls(TextLog):
    """Where a log has got to: the call whose lines are being read."""

    def __init__(self, bus: str) -> None:
        self._bus = bus
        self._held: Chunk | None = None
        self._due: dict[Direction, int] = {}
        self._marks: tuple[Mark, ...] = ()
        self.emptied = 0
        self.talk = 0
        self.cut_off = False

    def chunks(self, block: LineBlock) -> Iterator[Chunk]:
        """Yield what the lines of ``block`` hold."""
        walk = LineWalk(block)
        while walk.is_inside:
            found = _ENTRY.match(block.text, walk.at)
            if found is not None:
                told = self._entry(found.groups())
                if told is not None:
                    walk.at = found.end()
                    yield from told
                    continue
            line, number = walk.line()
            text = COLOURS.sub(b"", line) if b"\x1b" in line else line
            yield from self._line(text, number, block.cut_off)

    def _entry(self, said: tuple[bytes, ...]) -> tuple[Chunk, ...] | None:
        """Take a line that is as usual; return the call that is over. None: look closer."""
        seconds, thousandths, label, offset, row, blanks, gutter = said
        if gutter and len(row) + len(blanks) < _COLUMNS:
            return None
        data, direction, held = bytes.fromhex(row.decode("ascii")), _DIRECTIONS[label], self._held
        if offset == b"0000":
            t_ns = (int(seconds) * 1000 + int(thousandths)) * MS + MS // 2
            self._due[direction] = len(data)
            self._begin(direction, t_ns, data)
            return () if held is None else (held,)
        at = int(offset, 16)
        if held is None or held.direction is not direction or len(held.data) >= PIECE:
            return None
        if self._due.get(direction) != at:
            return None
        self._due[direction] = at + len(data)
        whole = held.data + data
        self._held = Chunk(whole, held.t_ns, Clock.FILE, self._bus, direction, held.marks)
        return ()

    def rest(self) -> Iterator[Chunk]:
        """Yield the call that no line continues."""
        if self._held is not None:
            yield self._held
            self._held = None

    def _line(self, line: bytes, number: int, cut_off: bool) -> Iterator[Chunk]:
        found = SPY_LINE.fullmatch(line)
        if found is None:
            self.cut_off = cut_off and _HALF.match(line) is not None
            if not self.cut_off and (_STAMPED.match(line) or _TORN.match(line)):
                raise DamagedLine(number, f"{quoted(line)} is no line of pySerial's spy://")
            self.talk += bool(line.strip()) and not self.cut_off
            return
        seconds, thousandths, label, rest = found.groups()
        t_ns = abs(int(seconds)) * NS + int(thousandths) * MS
        t_ns = -t_ns if seconds.startswith(b"-") else t_ns
        # rounded, so it may have been half a millisecond later
        t_ns += MS // 2
        if not is_time(t_ns):
            raise DamagedLine(number, f"{quoted(seconds)} seconds are too many")
        direction = _DIRECTIONS.get(label)
        if direction is None:
            self._called(label, rest)
            return
        row = _BYTES.fullmatch(rest)
        if row:
            data = self._row(row[2], number, cut_off)
            yield from self._add(int(row[1], 16), direction, t_ns, data, number)
        elif cut_off:
            self.cut_off = True
        elif rest.rstrip() != _EMPTY:
            raise DamagedLine(number, f"{quoted(line)} has no offset and bytes")

    def _called(self, label: bytes, what: bytes) -> None:
        if label == b"BRK" and what.startswith(_BREAKS):
            self._marks += (Mark(MarkKind.BREAK, 0),)
        self.emptied += label == b"Q-RX" and what.startswith((b"reset_input", b"flushInput"))

    def _row(self, text: bytes, number: int, cut_off: bool) -> bytes:
        pairs = text[:_COLUMNS].rstrip(b" ") + b" "
        if not _ROW.fullmatch(pairs):
            half = _ROW.match(pairs) if cut_off else None
            if not cut_off:
                raise DamagedLine(number, f"{quoted(text)} is no line of pySerial's spy://")
            self.cut_off = True
            pairs = half[0] if half else b""
        return bytes.fromhex(pairs.decode("ascii"))

    def _add(
        self, offset: int, direction: Direction, t_ns: int, data: bytes, number: int
    ) -> Iterator[Chunk]:
        due = self._due.get(direction, offset)
        if offset and offset != due:
            why = f"offset {offset:04X} does not go on from {due:04X}: the log is damaged"
            raise DamagedLine(number, why, nonsense=False)
        self._due[direction] = offset + len(data)
        if not data:
            return
        held = self._held
        if offset and held and held.direction == direction and len(held.data) < PIECE:
            self._held = replace(held, data=held.data + data)
            return
        yield from self.rest()
        self._begin(direction, t_ns, data)

    def _begin(self, direction: Direction, t_ns: int, data: bytes) -> None:
        """Hold the first line of a call."""
        unsure = coarse(len(data), _PLACES)
        marks = (*self._marks, *unsure) if self._marks else unsure
        self._marks = ()
        self._held = Chunk(data, t_ns, Clock.FILE, self._bus, direction, marks)

    def notes(self) -> Iterator[str]:
        """Yield what is worth knowing about the log, at its end."""
        yield "its times count from when the port was opened, in whole milliseconds"
        times = "once" if self.emptied == 1 else f"{self.emptied} times"
        emptied = f"the program emptied its input {times}: what it had not read is missing"
        others = left_out(self.talk, "between", "spy://")
        yield from remarks(emptied if self.emptied else "", others, cut_off=self.cut_off)


def read_spy(opened: Opened) -> Iterator[Chunk]:
    """Yield one chunk a call; who of the two sides is the controller, its frames tell."""
    # the program stamps what it writes before it writes, whoever it plays
    calls = handed_over(read_log(opened, _Calls(opened.bus)), Direction.TX)
    return oriented(calls, opened.notes, ("TX", "RX"))
