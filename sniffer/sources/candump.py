"""Log lines with a time each, as ``candump -L`` writes them: ``(1732142106.123456) bus0 RX#FAAF``.

In front of the ``#`` stands a direction, a CAN id or nothing; an id is no payload. Behind no bus
there is a direction: ``#`` alone may begin a remark, or a line of LSS. The time is
read digit by digit into integer nanoseconds: a float has no room for them.
"""

from __future__ import annotations

import re
from collections import Counter
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.coarse import FINE, coarse
from sniffer.ground.limits import TIME_END_NS
from sniffer.ground.model import NS, Chunk, Clock, Direction, Mark
from sniffer.ground.patterns import later
from sniffer.ground.runs import ChunkRun
from sniffer.sources.text import (
    CUT_OFF,
    DamagedLine,
    LineBlock,
    Opened,
    TextLog,
    quoted,
    read_blocks,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

# time, its fraction, bus, label, CAN FD flags, bytes, remote request, direction of candump -x
_LINE: Final = later(
    rb"^(?:\(([0-9]{1,10})(?:[.,]([0-9]*))?\)[ \t]+)?"
    rb"(?:([^\s#()]+)[ \t]+|(?=[TtRr][Xx]#))([TtRr][Xx]|[0-9A-Fa-f]{1,8}|)#"
    rb"(#[0-9A-Fa-f])?((?:[0-9A-Fa-f]{2})*)(R[0-9A-Fa-f]?)?"
    rb"(?:[ \t]+([RT]))?[ \t]*$",
    re.MULTILINE,
)
# what a line looks like that broke off while it was written, before its "#"
_HALF: Final = later(rb"\([0-9]*[.,]?[0-9]*(\)[ \t]*([^\s#()]+([ \t]+[0-9A-Za-z]*)?)?)?$")
_DIRECTIONS: Final = {
    b"TX": Direction.TX,
    b"T": Direction.TX,
    b"RX": Direction.RX,
    b"R": Direction.RX,
}
_ERROR_FRAME: Final = 0x2000_0000  # CAN_ERR_FLAG of linux/can.h: its bytes were on no wire

_WIRES: Final = {b"": 0, b"TX": 1, b"RX": 2}
_NANO: Final = 9  # digits of a fraction that are kept

_Row = tuple[bytes, bytes, bytes, bytes, bytes, bytes, bytes, bytes]


def is_line(line: bytes) -> bool:
    """Tell whether ``line`` is one of these, with the name of its bus."""
    found = _LINE.match(line)
    return found is not None and found[3] is not None


def are_nameless(lines: Sequence[bytes]) -> bool:
    """Tell whether all lines are of these, of a bus that has no name.

    One alone may be LSS: ``TX#5D1800``.
    """
    found = [_LINE.match(line) for line in lines]
    return bool(found) and all(line is not None and line[3] is None for line in found)


class CandumpLog(TextLog):
    """The lines of a log, block by block."""

    def __init__(self, bus: str) -> None:
        self._buses: dict[bytes, str] = {b"": bus}
        self.errors = 0
        self.cut_off = False

    def parts(self, block: LineBlock) -> Iterator[Chunk | ChunkRun]:
        """Yield one chunk a line, all of them together where the lines are as usual."""
        rows: list[_Row] = _LINE.findall(block.text)
        run = self._run(rows) if len(rows) == block.text.count(b"\n") + 1 else None
        if run is None:
            yield from self._chunks(rows, block)
        else:
            yield run

    def chunks(self, block: LineBlock) -> Iterator[Chunk]:
        """Yield one chunk a line."""
        return self._chunks(_LINE.findall(block.text), block)

    def _run(self, rows: list[_Row]) -> ChunkRun | None:
        """Return rows of one bus with bytes, times alike and no ids; None: look closer."""
        seconds, fractions, buses, labels, _, digits, _, flags = zip(*rows, strict=True)
        places = len(fractions[0])
        if len({*buses}) > 1 or any({*flags}) or places > _NANO:
            return None
        if not _WIRES.keys() >= {*labels} or {*map(len, fractions)} != {places}:
            return None
        if not places or not all(seconds) or not all(digits):
            return None
        whole = np.array([*map(int, seconds)], np.int64)
        if whole.max() >= TIME_END_NS // NS:
            return None
        t_ns = whole * NS + np.array([*map(int, fractions)], np.int64) * 10 ** (_NANO - places)
        ends = np.cumsum([*map(len, digits)]) // 2
        ways = np.array([_WIRES[label] for label in labels], np.uint8)
        data = bytes.fromhex(b"".join(digits).decode("ascii"))
        name = self._name(buses[0])
        marks: dict[int, tuple[Mark, ...]] = {}
        if places < FINE:
            marks = {n: coarse(len(told) // 2, places) for n, told in enumerate(digits)}
        return ChunkRun(data, ends, t_ns, ways, Clock.FILE, name, marks)

    def _chunks(self, rows: list[_Row], block: LineBlock) -> Iterator[Chunk]:
        # one match a line, or the lines need a closer look
        if len(rows) == block.text.count(b"\n") + 1:
            for number, row in enumerate(rows, block.number):
                if chunk := self._chunk(row, number):
                    yield chunk
            return
        for number, line in enumerate(block.lines(), block.number):
            yield from self._line(line.strip(), number, block.cut_off)

    def sizes(self, block: LineBlock) -> Counter[str]:
        """Return how many bytes the lines of ``block`` hold by bus, as ``chunks`` has them."""
        out: Counter[str] = Counter()
        rows: list[_Row] = _LINE.findall(block.text)
        plain = not any(len(row[3]) == 8 for row in rows)  # an error frame has a long id
        if plain and len(rows) == block.text.count(b"\n") + 1:
            for row in rows:
                out[self._name(row[2])] += len(row[5]) // 2
        else:
            for chunk in self.chunks(block):
                out[chunk.bus] += len(chunk.data)
        return out

    def _line(self, line: bytes, number: int, cut_off: bool) -> Iterator[Chunk]:
        if not line or line.startswith(b"#"):
            return
        rows: list[_Row] = _LINE.findall(line)
        if not rows and cut_off:
            rows = _LINE.findall(line[:-1])  # it may have broken off in mid-byte
            self.cut_off = bool(rows) or _HALF.match(line) is not None
            if not rows and self.cut_off:
                return
        if not rows:
            why = f"{quoted(line)} is no line like '(1732142106.123456) bus0 RX#FAAF01'"
            raise DamagedLine(number, why)
        if chunk := self._chunk(rows[0], number):
            yield chunk

    def _chunk(self, row: _Row, number: int) -> Chunk | None:
        seconds, fraction, bus, label, _, digits, _, flag = row
        if not digits:
            return None
        name = self._name(bus)
        direction = _DIRECTIONS.get(label.upper() or flag, Direction.UNKNOWN)
        if direction is Direction.UNKNOWN and label:
            if len(label) == 8 and int(label, 16) & _ERROR_FRAME:
                self.errors += 1
                return None
            direction = _DIRECTIONS.get(flag, Direction.UNKNOWN)
        data = bytes.fromhex(digits.decode("ascii"))
        if not seconds:
            return Chunk(data, bus=name, direction=direction)
        t_ns = int(seconds) * NS + int(fraction[:9].ljust(9, b"0"))
        if t_ns >= TIME_END_NS:
            raise DamagedLine(number, f"{quoted(seconds)} seconds are beyond the year 2257")
        return Chunk(data, t_ns, Clock.FILE, name, direction, coarse(len(data), len(fraction)))

    def _name(self, bus: bytes) -> str:
        name = self._buses.get(bus)
        if name is None:
            name = self._buses[bus] = bus.decode("utf-8", "replace")
        return name

    def notes(self) -> Iterator[str]:
        """Yield what was left out."""
        return notes_on(self.errors, cut_off=self.cut_off)


def notes_on(errors: int, *, cut_off: bool) -> Iterator[str]:
    """Yield what was left out of a log with so many error frames."""
    if errors:
        yield f"{errors} CAN error frames are left out: their bytes were on no wire"
    if cut_off:
        yield CUT_OFF


def read_candump(opened: Opened) -> Iterator[Chunk | ChunkRun]:
    """Yield one chunk a line; its time is that of the line, on the file's clock."""
    log = CandumpLog(opened.bus)
    return read_blocks(opened, log, log.parts)
