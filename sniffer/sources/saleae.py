"""Tables of the Async Serial analyzer, as Saleae's Logic 1 and Logic 2 export them: a row a byte.

    Time [s],Value,Parity Error,Framing Error          Logic 1
    0.042980320000000,0xD4,,

    name,type,start_time,duration,"data","error"       Logic 2
    "Async Serial","data",0.0006025,2.375e-05,0xC8,

Both stamp where a byte begins. The duration of Logic 2 ends in the middle of the stop bit
(SerialAnalyzer.cpp); Logic 1 tells none, so it is taken from bytes that follow each other.
"""

from __future__ import annotations

import itertools
from decimal import Decimal, DecimalException
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.limits import BAUDS, is_time
from sniffer.ground.model import NS, Chunk, Clock, Direction, Mark, MarkKind
from sniffer.ground.patterns import later
from sniffer.ground.runs import ChunkRun
from sniffer.signals.rates import STANDARD, snapped
from sniffer.sources.alike import TextLines, UnlikeError, likenesses
from sniffer.sources.locales import blocks_with_points
from sniffer.sources.text import (
    CUT_OFF,
    PAUSE,
    DamagedLine,
    LineBlock,
    Opened,
    arriving,
    cells_of,
    quoted,
)
from sniffer.sources.walltime import ZONELESS, WallClock, zone_ns

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from sniffer.ground.model import I64, U8
    from sniffer.sources.alike import AlikeLines

TABLE_1: Final = later(rb'"?Time ?\[s\]"?, ?"?Value"?, ?"?Parity Error"?, ?"?Framing Error"?\s*$')
"""The head of a table of Logic 1."""

TABLE_2: Final = later(rb'"?name"?,"?type"?,"?start_time"?,"?duration"?,')
"""The head of a table of Logic 2: behind it come the columns of whatever analyzers there are."""

HEXADECIMAL: Final = (
    "its values are no hexadecimal numbers: export again with the radix Hexadecimal, "
    "every value as 0xFF"
)
"""What is said of another radix: "5" may be the digit, the number 5, or 05."""

_HEX: Final = later(r"0[xX]([0-9A-Fa-f]{1,2})")
_BITS: Final = later(r"0[bB]([01 ]{1,11})")
_NUMBER: Final = later(r"([0-9]{1,3})")
_SECONDS: Final = later(r"(-?)([0-9]{1,10})(?:\.([0-9]*))?")
_ISO: Final = later(
    r"([0-9]{4}-[0-9]{2}-[0-9]{2})[T ]([0-9]{2}:[0-9]{2}:[0-9]{2})(?:\.([0-9]+))?"
    r"(Z|[+-][0-9]{2}:?[0-9]{2})?"
)
# rows as they are nearly always, which say what others like them say: read in columns
_PLAIN_1: Final = later(rb"([0-9]{1,9})\.([0-9]{9})([0-9]*),0x([0-9A-F]{2}),(Error)?,(Error)?")
_PLAIN_2: Final = later(
    rb'"?([^",\n]*)"?,"?data"?,([0-9]{1,9})\.([0-9]{1,9}),([0-9.e-]{1,24}),0x([0-9A-F]{2})'
    rb'(?:,(?:"?(parity|framing)"?)?)?'
)
_COLUMNS_2: Final = ("name", "type", "start_time", "duration", "data", "error")
_KNOWN: Final = (*_COLUMNS_2, "address")
_ERRORS: Final[Mapping[str, MarkKind]] = {
    "parity": MarkKind.PARITY,
    "framing": MarkKind.FRAMING,
}
_ROWS: Final = 4096  # of Logic 1, by which the length of a byte is told
_CLOSEST: Final = 0.05  # share of the rows that follow each other as close as they can
_SAME: Final = 1.05  # bytes a twentieth further apart follow each other, too


_Row = tuple[int, bytes, tuple[Mark, ...]]


class _ByteRows:
    """What rows say: a byte each, when it was over, and what was wrong with it."""

    def __init__(self, lines: TextLines) -> None:
        self.lines = lines
        self._value = np.empty(len(lines), np.uint8)
        self._t_ns = np.empty(len(lines), np.int64)
        self._marks: dict[int, tuple[Mark, ...]] = {}

    def take(self, some: AlikeLines, t_ns: I64, value: U8, marks: tuple[Mark, ...]) -> None:
        """Take some rows in."""
        self._value[some.rows], self._t_ns[some.rows] = value[0], t_ns
        if marks:
            self._marks |= dict.fromkeys(some.rows.tolist(), marks)

    def run(self, clock: Clock, bus: str) -> ChunkRun:
        """Return all rows, which are of one bus."""
        n = len(self._value)
        ends, ways = np.arange(1, n + 1), np.zeros(n, np.uint8)
        return ChunkRun(self._value.tobytes(), ends, self._t_ns, ways, clock, bus, self._marks)

    def chunks(self, clock: Clock, names: Mapping[str, Sequence[I64]]) -> list[Chunk]:
        """Return all rows, which are of several buses."""
        of = np.empty(len(self._value), np.int64)
        for nth, parts in enumerate(names.values()):
            of[np.concatenate(parts)] = nth
        buses, data, marks = [*names], self._value.tobytes(), self._marks
        rows = enumerate(zip(of.tolist(), self._t_ns.tolist(), strict=True))
        return [
            Chunk(data[n : n + 1], t_ns, clock, buses[nth], Direction.UNKNOWN, marks.get(n, ()))
            for n, (nth, t_ns) in rows
        ]


class _ByteTable:
    """What the rows of both have in common: values, times, and the radix of the first value."""

    def __init__(self, bus: str) -> None:
        self.bus = bus
        self._radix = 0
        self._wall = WallClock()
        self.zoneless = self.dated = False
        self.left_out = 0
        self.cut_off = False

    def value(self, text: str, line: int) -> bytes:
        """Return a byte; DamagedLine where it is none, or of another radix than the first."""
        text = text.strip()
        for radix, pattern in ((16, _HEX), (2, _BITS), (10, _NUMBER)):
            found = pattern.fullmatch(text)
            if found:
                number = int(found[1].replace(" ", ""), radix)
                self._radix = self._radix or radix
                if radix != self._radix or number > 0xFF:
                    break
                return bytes((number,))
        raise DamagedLine(line, f"{quoted(text.encode())} is no byte: {HEXADECIMAL}")

    def time(self, text: str, line: int) -> int:
        """Return seconds or an ISO date in ns."""
        seconds = _SECONDS.fullmatch(text)
        dated = None if seconds else _ISO.fullmatch(text)
        if seconds:
            t_ns = int(seconds[2]) * NS + int((seconds[3] or "")[:9].ljust(9, "0"))
            t_ns = -t_ns if seconds[1] else t_ns
        elif dated:
            parts = [(dated[i] or "").encode() for i in (1, 2, 3)]
            t_ns = self._wall.ns(parts[0], parts[1], parts[2], line) - zone_ns(dated[4] or "")
            self.zoneless, self.dated = self.zoneless or not dated[4], True
        else:
            t_ns = self.span(text, line)
        if not is_time(t_ns):
            raise DamagedLine(line, f"{quoted(text.encode())} s are too many")
        return t_ns

    def span(self, text: str, line: int) -> int:
        """Return seconds in ns, also those with an exponent."""
        try:
            number = Decimal(text) * NS
            if number.is_finite() and abs(number) < 1 << 62:
                return round(number)
        except DecimalException:
            pass  # told below
        raise DamagedLine(line, f"{quoted(text.encode())} is no number of seconds")

    def notes(self) -> Iterator[str]:
        """Yield what is worth knowing about the table, at its end."""
        if self.zoneless:
            yield ZONELESS
        elif not self.dated:
            yield "its times count from the trigger, or from the begin of the capture"
        if self.left_out:
            yield f"{self.left_out} rows of other analyzers are left out"
        if self.cut_off:
            yield CUT_OFF


class _Logic1(_ByteTable):
    """Rows wait until enough of them tell how long a byte is."""

    def __init__(self, bus: str) -> None:
        super().__init__(bus)
        self._waiting: list[_Row] | None = []
        self._byte_ns = 0
        self._clock = Clock.FILE

    def rows(self, text: bytes) -> Sequence[Chunk | ChunkRun] | None:
        """Return what rows say that are as usual, None where they need a closer look."""
        if self._waiting is not None or self._radix != 16:
            return None
        told = _ByteRows(TextLines(text))
        try:
            for some in likenesses(told.lines, _PLAIN_1, (1, 2, 3), (4,)):
                t_ns = some.number(1) * NS + some.number(2) + self._byte_ns
                told.take(some, t_ns, some.octets(4), _marks(some.one[5], some.one[6]))
        except UnlikeError:
            return None
        return [told.run(self._clock, self.bus)]

    def row(self, cells: Sequence[str], line: int, cut_off: bool) -> Iterator[Chunk]:
        """Yield what a row says."""
        if len(cells) != 4 and not cut_off:
            raise DamagedLine(line, f"a row has {len(cells)} cells, not 4")
        if len(cells) != 4:  # whether its value is whole is not known
            self.cut_off = True
            return
        data, t_ns = self.value(cells[1], line), self.time(cells[0], line)
        marks = _marks(cells[2].strip(), cells[3].strip())
        if self._waiting is None:
            yield self._chunk(t_ns, data, marks)
            return
        self._waiting.append((t_ns, data, marks))
        if len(self._waiting) >= _ROWS:
            yield from self.rest()

    def rest(self) -> Iterator[Chunk]:
        """Yield what waits."""
        if self._waiting is None:
            return
        waiting, self._waiting = self._waiting, None
        self._byte_ns = _byte_ns([t_ns for t_ns, _, _ in waiting])
        self._clock = Clock.SAMPLE if self._byte_ns else Clock.FILE
        for row in waiting:
            yield self._chunk(*row)

    def _chunk(self, t_ns: int, data: bytes, marks: tuple[Mark, ...]) -> Chunk:
        return Chunk(data, t_ns + self._byte_ns, self._clock, self.bus, marks=marks)

    def notes(self) -> Iterator[str]:
        """Yield what is worth knowing about the table, at its end."""
        yield from super().notes()
        if not self._byte_ns:
            yield "it does not tell how long a byte is: times are those of where bytes begin"


def _marks(parity: bytes | str | None, framing: bytes | str | None) -> tuple[Mark, ...]:
    if not parity and not framing:
        return ()
    kinds = ((MarkKind.PARITY, parity), (MarkKind.FRAMING, framing))
    return tuple(Mark(kind, 0, 1) for kind, told in kinds if told)


def _byte_ns(starts: Sequence[int]) -> int:
    """Return how long a byte is where bytes follow each other; 0 where that is not plain."""
    apart = sorted(b - a for a, b in itertools.pairwise(starts) if b > a)
    if not apart:
        return 0
    closest = apart[int(len(apart) * _CLOSEST)]
    packed = [gap for gap in apart if gap <= closest * _SAME]
    byte_ns = packed[len(packed) // 2]
    # ten bits; eleven with parity, or two stop bits
    is_rate = any(snapped(bits * NS / byte_ns, ()) in STANDARD for bits in (10, 11))
    return byte_ns if is_rate and byte_ns <= 11 * NS // BAUDS[0] else 0


class _Logic2(_ByteTable):
    def __init__(self, bus: str, head: Sequence[str]) -> None:
        super().__init__(bus)
        self._width = len(head)
        self._at = {name: head.index(name) for name in _KNOWN if name in head}
        self._others = [i for i, name in enumerate(head) if name not in _KNOWN]
        self._is_plain = tuple(head) in (_COLUMNS_2, _COLUMNS_2[:-1])

    def rows(self, text: bytes) -> Sequence[Chunk | ChunkRun] | None:
        """Return what rows say that are as usual, None where they need a closer look."""
        if not self._is_plain or self._radix != 16:
            return None
        told = _ByteRows(TextLines(text))
        names: dict[str, list[I64]] = {}
        try:
            for some in likenesses(told.lines, _PLAIN_2, (2, 3), (5,)):
                one = some.one
                if one[0].count(b",") != self._width - 1:
                    return None
                part = some.number(3) * 10 ** (9 - len(one[3]))
                end = some.number(2) * NS + part + self._whole_ns(one[4].decode(), 0)
                marks = (Mark(_ERRORS[one[6].decode()], 0, 1),) if one[6] else ()
                told.take(some, end, some.octets(5), marks)
                names.setdefault(one[1].decode("utf-8", "replace") or self.bus, []).append(
                    some.rows
                )
        except (UnlikeError, DamagedLine):
            return None
        if len(names) == 1:
            return [told.run(Clock.SAMPLE, *names)]
        return told.chunks(Clock.SAMPLE, names)

    def _whole_ns(self, duration: str, line: int) -> int:
        """Return how long a byte takes whose duration is stated: it ends in its stop bit."""
        lasts = self.span(duration, line)
        if not 0 <= lasts <= NS:
            raise DamagedLine(line, f"a byte does not take {lasts / NS:g} s")
        return lasts + lasts // 19  # nine and a half bits of ten

    def row(self, cells: Sequence[str], line: int, cut_off: bool) -> Iterator[Chunk]:
        """Yield what a row says."""
        if len(cells) != self._width:
            if not cut_off:
                raise DamagedLine(line, f"a row has {len(cells)} cells, not {self._width}")
            self.cut_off = True
            return
        at = self._at
        if cells[at["type"]] != "data" or any(cells[i] for i in self._others):
            self.left_out += 1
            return
        t_ns = self.time(cells[at["start_time"]], line)
        end = t_ns + self._whole_ns(cells[at["duration"]], line)
        told = cells[at["error"]].strip() if "error" in at else ""
        marks = (Mark(_ERRORS.get(told, MarkKind.FRAMING), 0, 1),) if told else ()
        data = self.value(cells[at["data"]], line)
        yield Chunk(data, end, Clock.SAMPLE, cells[at["name"]] or self.bus, marks=marks)

    def rest(self) -> Iterator[Chunk]:
        """Yield nothing: no row waits."""
        return iter(())


def read_saleae(opened: Opened) -> Iterator[Chunk | ChunkRun]:
    """Yield one chunk a byte: its time is that of its end, the names in a table are buses."""
    table: _Logic1 | _Logic2 | None = None
    try:
        for block in blocks_with_points(arriving(opened.stream)):
            if block is None:
                yield PAUSE
                continue
            plain = table.rows(block.text) if table is not None and not block.cut_off else None
            if plain is not None:
                yield from plain
                continue
            for number, line in enumerate(_lines(block), block.number):
                if not line.strip():
                    continue
                if table is None:
                    table = _table(line, number, opened.bus)
                else:
                    yield from table.row(cells_of(line), number, block.cut_off)
        if table is not None:
            yield from table.rest()
    except DamagedLine:
        if table is not None:
            yield from table.rest()
        raise
    finally:
        opened.notes.extend(table.notes() if table is not None else ())


def _lines(block: LineBlock) -> list[str]:
    return block.text.decode("utf-8", "replace").split("\n")


def _table(line: str, number: int, bus: str) -> _Logic1 | _Logic2:
    text = line.encode()
    if TABLE_1.match(text):
        return _Logic1(bus)
    head = [cell.strip() for cell in cells_of(line)]
    if TABLE_2.match(text) and "data" in head:
        return _Logic2(bus, head)
    what = f"{quoted(text)} is no head of a table of the Async Serial analyzer"
    raise DamagedLine(number, f"{what}: export the one of that analyzer, radix Hexadecimal")


def is_hexadecimal(lines: Sequence[bytes]) -> bool:
    """Tell whether all values in the first lines of a table are hexadecimal numbers."""
    text = [line.decode("utf-8", "replace") for line in lines]
    head = [cell.strip() for cell in cells_of(text[0])]
    column = head.index("data") if "data" in head else 1
    kind = head.index("type") if "type" in head else None
    rows = [cells_of(line) for line in text[1:]]
    values = [
        row[column]
        for row in rows
        if len(row) == len(head) and (kind is None or row[kind] == "data")
    ]
    return all(_HEX.fullmatch(value.strip()) for value in values)
