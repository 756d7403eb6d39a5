r"""Logs that people and programs of their own write: bytes behind a time, a direction, or both.

    22:55:06.001 -> FF FF FF 01 02 F1 0B           the monitor of the Arduino IDE
    [2026-11-20 22:55:06,001] TX: ff-ff-ff-01-02-f1-0b
    1795215306.001216 RX FFFFFF010200FC
    Sent: 0xFF 0xA0 0x00 0x20   Received: 0x00 0xA4
    >> #5QD
    << *5QD1443
    [DEBUG] [1732694400.123456]: TX: FF A0 00 20   behind the head of a logging framework
    {"t": 1732694400.123456, "dir": "TX", "data": "ffa00020"}

No tool defines them, so nobody knows of which byte a time is: it is taken for the moment at which
all of them had been read, or at which they were handed over to be sent. LSS text stands as it is.
How a line is taken apart says ``loglines``, how bytes are spelled ``logbytes``.
"""

from __future__ import annotations

import enum
import functools
from typing import TYPE_CHECKING, Final

from sniffer.ground.coarse import coarse
from sniffer.ground.model import Chunk, Clock, Direction
from sniffer.ground.patterns import later
from sniffer.ground.wording import counted
from sniffer.sources.logbytes import MOSTLY, SOME_BYTES, stated
from sniffer.sources.logfields import LogFields, fields_of
from sniffer.sources.logfronts import prefix_of
from sniffer.sources.loglines import Dumps, SaidLine, are_pointed, said
from sniffer.sources.logstamps import LogClock, places
from sniffer.sources.plain import BadLineError, share_of_hex
from sniffer.sources.refusals import refused
from sniffer.sources.sides import handed_over, oriented
from sniffer.sources.spelling import Spelling
from sniffer.sources.text import (
    FIRST_LINES,
    DamagedLine,
    LineBlock,
    Opened,
    TextLog,
    left_out,
    quoted,
    read_log,
    remarks,
)

if TYPE_CHECKING:
    import re
    from collections.abc import Callable, Iterator, Sequence

_IN_FRONT: Final = (
    "put a time or a direction in front, or write lines `(seconds.fraction) bus0 #HEX`"
)
_TIMES: Final = later(rb"\d{4}[-/]\d\d[-/]\d\d|\d\d:\d\d:\d\d(?:[.,]\d+)?")
_DECIMAL: Final = later(rb"[ ,\[]\d{3}(?![^ ,\]])|[\[{(] *\d+,")


class _LineKind(enum.Enum):
    """What a line is."""

    BYTES = enum.auto()  # it states some, well or badly
    QUIET = enum.auto()  # a direction or a time, and none
    WORDS = enum.auto()
    ODD = enum.auto()  # there may be bytes in it, with nothing in front that is known


def is_log(lines: Sequence[bytes]) -> bool:
    """Tell whether these lines are such a log, in which no line has bytes and nothing in front.

    Mistakes in hex are the reader's to report; numbers of three digits are decimal.
    """
    kinds = _kinds(lines)
    return _LineKind.BYTES in kinds and _LineKind.ODD not in kinds


def others(lines: Sequence[bytes]) -> list[bytes]:
    """Return the lines that would be none of such a log."""
    known = (_LineKind.BYTES, _LineKind.QUIET)
    return [line for line, kind in zip(lines, _kinds(lines), strict=True) if kind not in known]


def refuse_bare(lines: Sequence[bytes]) -> None:
    """Raise InputError where most lines are of such a log, and one has nothing but bytes."""
    kinds = _kinds(lines)
    if 2 * kinds.count(_LineKind.BYTES) < len(lines):
        return
    for line, kind in zip(lines, kinds, strict=True):
        if kind is _LineKind.ODD and share_of_hex(line) == 1:
            what = f"a log in which bytes have nothing in front of them ({quoted(line)})"
            raise refused(what, _IN_FRONT)


def lines_of(block: bytes) -> list[bytes]:
    """Return the lines of a text; where no line ends otherwise, they end with 0D."""
    return block.split(b"\n" if b"\n" in block.rstrip(b"\n") else b"\r")


def _kinds(lines: Sequence[bytes]) -> list[_LineKind]:
    """Return what each of the first lines of a text is."""
    fields = fields_of(lines[0]) if lines else None
    if fields is None:
        dumps = Dumps()
        return [_kind(line, functools.partial(said, dumps=dumps.names), dumps) for line in lines]
    return [
        _LineKind.QUIET if fields.is_head(line) else _kind(line, fields.said, Dumps())
        for line in lines
    ]


def _kind(line: bytes, taken: Callable[[bytes], SaidLine | None], dumps: Dumps) -> _LineKind:
    """Return what a line is that is taken apart so; ``dumps`` is told of it."""
    parts: Sequence[tuple[Direction, bytes]] = ()
    try:
        told = taken(line) or SaidLine(None, ())
        parts = told.parts
        sizes = [len(_data(*part, Spelling())) for part in parts]
        dumps.take(told.dump, sum(sizes))
        has_bytes = any(sizes)
    except BadLineError:
        has_bytes = not _DECIMAL.search(line)
    if has_bytes:
        return _LineKind.BYTES
    if any(way is not Direction.UNKNOWN for way, _ in parts):
        return _LineKind.QUIET
    if known := prefix_of(line):  # of a whole system: most lines are of others
        return _LineKind.ODD if SOME_BYTES.search(line, known[2]) else _LineKind.WORDS
    rest = _TIMES.sub(b"", line)
    if SOME_BYTES.search(rest) or share_of_hex(rest) > MOSTLY:
        return _LineKind.ODD
    return _LineKind.QUIET if parts else _LineKind.WORDS


def _data(way: Direction, text: bytes, spelling: Spelling) -> bytes:
    return stated(text, spelling, is_directed=way is not Direction.UNKNOWN)


class LabelledLog(TextLog):
    """Where a log has got to."""

    def __init__(self, bus: str) -> None:
        self._bus = bus
        self._clock = LogClock()
        self._fields: LogFields | None = None
        self._is_pointed = False
        self._dumps = Dumps()
        self._spelling = Spelling()
        self.timed = self.cut_off = False
        self.talk = self.empty = 0

    def chunks(self, block: LineBlock) -> Iterator[Chunk]:
        """Yield what the lines of ``block`` hold."""
        lines = lines_of(block.text) if block.number == 1 else block.lines()
        if block.number == 1:
            self._fields = fields_of(lines[0])
            self._is_pointed = are_pointed(lines[:FIRST_LINES])
        for number, line in enumerate(lines, block.number):
            is_last = block.cut_off and number == block.number + len(lines) - 1
            self.cut_off = False
            try:
                yield from self._line(line, number)
            except BadLineError as error:
                if not is_last:
                    raise DamagedLine(number, f"{quoted(line)}: {error.why}") from None
                self.cut_off = True

    def _line(self, line: bytes, number: int) -> Iterator[Chunk]:
        """Yield what a line holds.

        Raises:
            BadLineError: it does not say which bytes it has.
        """
        fields = self._fields
        told = (
            fields.said(line)
            if fields
            else said(line, is_pointed=self._is_pointed, dumps=self._dumps.names)
        )
        stamp, parts, dump = told or SaidLine(None, ())
        has_bytes = False
        for direction, text in parts:
            data = _data(direction, text, self._spelling)
            if data:
                has_bytes = True
                self._dumps.take(dump, len(data))
                yield self._chunk(stamp, direction, data, number)
        is_empty = not has_bytes and any(way is not Direction.UNKNOWN for way, _ in parts)
        self.empty += is_empty
        is_head = fields is not None and fields.is_head(line)
        self.talk += bool(line.strip()) and not (has_bytes or is_empty or is_head)

    def _chunk(
        self, stamp: re.Match[bytes] | None, direction: Direction, data: bytes, number: int
    ) -> Chunk:
        if stamp is None:
            return Chunk(data, bus=self._bus, direction=direction)
        self.timed = True
        marks = coarse(len(data), places(stamp))
        t_ns = self._clock.ns(stamp, number)
        return Chunk(data, t_ns, Clock.FILE, self._bus, direction, marks)

    def notes(self) -> Iterator[str]:
        """Yield what is worth knowing about the log, at its end."""
        if self.timed:
            whose = "nobody says of which byte its times are: taken for the last one of what was "
            told = whose + "read, and for when what was sent was handed over"
            yield "; ".join(filter(None, (self._clock.remark, told)))
        else:
            yield "it has no times: its bytes are laid out back to back"
        empty = f"{counted(self.empty, 'line')} with a direction and no bytes: left out"
        notes = f"{counted(self._spelling.notes, 'note')} behind bytes: left out"
        yield from remarks(
            left_out(self.talk, "between", "its own"),
            empty if self.empty else "",
            notes if self._spelling.notes else "",
            cut_off=self.cut_off,
        )


def read_labelled(opened: Opened) -> Iterator[Chunk]:
    """Yield a chunk for each direction of a line; the frames tell which one is the controller's."""
    lines = handed_over(read_log(opened, LabelledLog(opened.bus)), Direction.TX)
    return oriented(lines, opened.notes, ("TX", "RX"))
