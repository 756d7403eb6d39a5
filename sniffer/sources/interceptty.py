r"""What interceptty writes of bytes that pass, and what interceptty-nicedump makes of it.

    [22:55 09.850602]< 0xfa             a line a byte, ``<`` to the device, ``>`` and a TAB from it
                     < 0x41 (A)
    [22:55 09.851733]> \t0xfd
    < fa:41(A):0d([CR])                 with ``-e``, up to the byte that ends a line
    <  fa 41 0d                       | A        interceptty-nicedump, ten bytes a row

With ``-T`` (in forks of 2019 and later) each buffer that was read has a time of the day in front of
its first line, blanks in front of the others; the original has no times. A buffer is written down
when it was read and passed on. Layout as in interceptty.c.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

from sniffer.ground.model import Chunk, Clock, Direction
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
from sniffer.sources.walltime import DATELESS, DayClock

if TYPE_CHECKING:
    from collections.abc import Iterator

# time of the day or blanks as wide, side, bytes in one of three ways
_STAMP: Final = rb"(?:\[(\d\d):(\d\d) (\d\d)\.(\d{6})\]|( {17}))?"
_SHOWN: Final = rb"\((?:\[[A-Z0-9]{2,3}\]|' '|[^\n])\)"  # a sign, or the name of one
_BYTE: Final = rb"0x([0-9a-f]{2})(?: " + _SHOWN + rb")?"
_PACKED: Final = rb"((?:[0-9a-f]{2}(?:" + _SHOWN + rb")?:?)+)"
LINE: Final = later(_STAMP + rb"([<>]) [\t ]{0,6}(?:" + _BYTE + rb"|" + _PACKED + rb")")
"""Hour, minute, second and fraction or blanks, side, one byte or several."""

# a buffer, or what one side says, a byte a line: what is odd is read line by line
_RUN: Final = rb"([<>]) \t?" + _BYTE
_TIMED: Final = later(
    rb"\[(\d\d):(\d\d) (\d\d)\.(\d{6})\]" + _RUN + rb"\n(?: {17}\5 \t?" + _BYTE + rb"\n){0,4095}"
)
_BARE: Final = later(_RUN + rb"\n(?:\1 \t?" + _BYTE + rb"\n){0,4095}")
_IN_RUN: Final = later(rb"^[^<>]*[<>] \t?0x(..)", re.MULTILINE)
NICE: Final = later(rb"([<>]) ((?: [0-9a-f]{2}){1,10}) *\|.*")
"""A row of interceptty-nicedump: side and bytes."""

_EACH: Final = later(rb"([0-9a-f]{2})(?:" + _SHOWN + rb")?:?")
_BEGIN: Final = rb"(?:\[\d\d:\d\d \d\d\.\d{6}\]| {17})?[<>] "
_OURS: Final = later(_BEGIN)
_TORN: Final = later(rb"(?:\[[\d:. ]*\]?| +|[<>])$|" + _BEGIN)
_SIDES: Final = {b"<": Direction.TX, b">": Direction.RX}  # until it is known who answers


def is_line(line: bytes) -> bool:
    """Tell whether a line holds bytes."""
    return LINE.fullmatch(line) is not None or NICE.fullmatch(line) is not None


class _Buffers(TextLog):
    """Where a log has got to: the buffer that is being read."""

    def __init__(self, bus: str) -> None:
        self._bus = bus
        self._clock = DayClock()
        self._t_ns: int | None = None
        self._side = Direction.UNKNOWN
        self._held = bytearray()
        self.timed = self.cut_off = False
        self.talk = 0

    def chunks(self, block: LineBlock) -> Iterator[Chunk]:
        """Yield what the lines of ``block`` hold."""
        walk = LineWalk(block)
        while walk.is_inside:
            timed = _TIMED.match(block.text, walk.at)
            bare = None if timed else _BARE.match(block.text, walk.at)
            if timed:
                yield from self.rest()
                self._t_ns = self._clock.ns(timed[1], timed[2], timed[3], timed[4], walk.number)
                self._side, self.timed = _SIDES[timed[5]], True
            elif bare:
                yield from self._turned(_SIDES[bare[1]])
            else:
                yield from self._line(*walk.line(), block.cut_off)
            if run := timed or bare:
                yield from self._add(b"".join(_IN_RUN.findall(run[0])))
                walk.at = run.end()
        if self._t_ns is None:
            yield from self.rest()

    def rest(self) -> Iterator[Chunk]:
        """Yield the buffer that no line continues."""
        if self._held:
            clock = Clock.NONE if self._t_ns is None else Clock.FILE
            yield Chunk(bytes(self._held), self._t_ns, clock, self._bus, self._side)
            self._held.clear()

    def _line(self, line: bytes, number: int, cut_off: bool) -> Iterator[Chunk]:
        found = LINE.fullmatch(line)
        nice = None if found else NICE.fullmatch(line)
        if found:
            side = _SIDES[found[6]]
            if found[1] is not None:
                yield from self.rest()
                self._t_ns = self._clock.ns(found[1], found[2], found[3], found[4], number)
                self.timed = True
            elif found[5] is None or side != self._side:
                yield from self._turned(side)
            self._side = side
            data = found[7] or b"".join(_EACH.findall(found[8]))
        elif nice:
            yield from self._turned(_SIDES[nice[1]])
            data = nice[2].replace(b" ", b"")
        else:
            self.cut_off = cut_off and _TORN.match(line) is not None
            if not self.cut_off and _OURS.match(line):
                raise DamagedLine(number, f"{quoted(line)} is no line of interceptty")
            self.talk += bool(line.strip()) and not self.cut_off
            return
        yield from self._add(data)

    def _add(self, data: bytes) -> Iterator[Chunk]:
        self._held += bytes.fromhex(data.decode("ascii"))
        if len(self._held) >= PIECE:
            yield from self.rest()

    def _turned(self, side: Direction) -> Iterator[Chunk]:
        """Begin a buffer without a time where the other side speaks."""
        if side != self._side or self._t_ns is not None:
            yield from self.rest()
            self._t_ns, self._side = None, side

    def notes(self) -> Iterator[str]:
        """Yield what is worth knowing about the log, at its end."""
        yield DATELESS if self.timed else "it has no times: its bytes are laid out back to back"
        others = left_out(self.talk, "between its own", "interceptty's")
        yield from remarks(others, cut_off=self.cut_off)


def read_interceptty(opened: Opened) -> Iterator[Chunk]:
    """Yield one chunk a buffer; who of the two sides is the controller, its frames tell."""
    told = oriented(read_log(opened, _Buffers(opened.bus)), opened.notes, ("<", ">"))
    return handed_over(told, Direction.TX)
