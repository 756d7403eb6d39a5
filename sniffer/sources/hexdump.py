"""Dumps with offsets: ``xxd``, ``hexdump -C`` and ``od -tx1`` in all their widths.

A line is taken apart by its structure - offset, pairs of hex digits, gutter - and never searched
for what looks like hex, because the gutter may hold anything (``|..1443..|``). The offsets are
checked against the bytes: they count what a ``*`` line stands for and betray a missing line.
"""

from __future__ import annotations

import itertools
import re
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.ground.patterns import later
from sniffer.sources.text import (
    CUT_OFF,
    PIECE,
    DamagedLine,
    LineBlock,
    Opened,
    arriving,
    quoted,
    untimed,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from sniffer.ground.model import Chunk

REPEATED: Final = 1 << 22
"""Bytes that the ``*`` lines of a dump may stand for, whatever its size: six minutes of a line at
115200 baud that always says the same. More is a damaged offset, or no capture."""

REPEATED_SHARE: Final = 256
"""And so many more for each byte of the dump: it takes time in proportion to its size."""

_DIGITS: Final = {8: b"01234567", 10: b"0123456789", 16: b"0123456789abcdefABCDEF"}
_FORMATS: Final = {8: b"%0*o", 10: b"%0*d", 16: b"%0*x"}
# hex digits become one letter: lines of one layout then look alike
_SHAPE: Final = bytes.maketrans(_DIGITS[16], b"h" * len(_DIGITS[16]))
_PROBED: Final = 64  # lines looked at to tell octal, decimal and hex offsets apart
_RUN: Final = 4096  # lines of one layout read at once, at most
_XXD: Final = later(rb" *([0-9A-Fa-f]{4,16}):(?: (.*))?$", re.DOTALL)
_OFFSET: Final = later(rb" *([0-9A-Fa-f]{4,16})(?: +(.*))?$", re.DOTALL)


class DumpLine(NamedTuple):
    """A dump line taken apart; ``offset`` is empty where the dump has none (``od -An``)."""

    offset: bytes
    pairs: bytes
    gutter: bytes


class Dialect(NamedTuple):
    """How one tool lays out a line.

    ``split`` returns None where the line is not of this tool; ``opener`` bytes stand between hex
    digits and gutter. ``radices`` of the offsets are tried in order. ``grouped``: pairs may stand
    together without a space.
    """

    tool: str
    split: Callable[[bytes], DumpLine | None]
    radices: tuple[int, ...]
    opener: int = 1
    grouped: bool = False


def _split_xxd(line: bytes) -> DumpLine | None:
    match = _XXD.match(line)
    if not match:
        return None
    # groups are one space apart, so the first two spaces are where the gutter begins
    pairs, _, gutter = (match[2] or b"").partition(b"  ")
    return DumpLine(match[1], pairs, gutter)


def _split_hexdump(line: bytes) -> DumpLine | None:
    match = _OFFSET.match(line)
    if not match:
        return None
    pairs, _, gutter = (match[2] or b"").partition(b"|")
    # tshark -x opens its gutter with three spaces and no bar
    pairs, _, bare = pairs.partition(b"   ")
    return DumpLine(match[1], pairs, bare.strip() or gutter)


def _split_od(line: bytes) -> DumpLine | None:
    offset, text = b"", line
    if not line.startswith(b" "):
        match = _OFFSET.match(line)
        if not match:
            return None
        offset, text = match[1], match[2] or b""
    pairs, _, gutter = text.partition(b">")
    # wider columns than one or two spaces hold decimal numbers (od -td1), not hex
    return None if b"   " in pairs.strip() else DumpLine(offset, pairs, gutter)


XXD: Final = Dialect("xxd", _split_xxd, (16, 10), opener=2, grouped=True)
HEXDUMP: Final = Dialect("hexdump -C", _split_hexdump, (16,))
OD: Final = Dialect("od -tx1", _split_od, (8, 10, 16))


def tidy(line: bytes) -> bytes:
    """Return a dump line without trailing blanks, tabs turned into spaces."""
    if b"\t" in line:
        line = line.replace(b":\t", b": ").expandtabs()
    return line.rstrip()


def bytes_in(dialect: Dialect, parts: DumpLine | None) -> bytes | None:
    """Return the bytes that a line states, None where it is no line of bytes in hex."""
    if parts is None or (not parts.pairs and parts.gutter):
        return None
    try:
        data = bytes.fromhex(parts.pairs.decode("ascii"))
    except ValueError:
        return None
    # groups of more than two digits are words, and their byte order is anybody's guess
    return data if dialect.grouped or len(parts.pairs.split()) == len(data) else None


def counted(dialect: Dialect, lines: list[bytes]) -> tuple[int, int]:
    """Return the radix of the offsets, and how many of them it proves right.

    It is the first radix under which the offsets count the bytes.
    """
    marks: list[tuple[bytes, int, bool]] = []  # offset, bytes in the line, behind a *
    starred = False
    for line in map(tidy, lines[:_PROBED]):
        parts = dialect.split(line)
        data = bytes_in(dialect, parts)
        if parts and data is not None:
            marks.append((parts.offset, len(data), starred))
        starred = line.strip() == b"*"
    offsets = [offset for offset, _, _ in marks if offset]
    order = dialect.radices
    if dialect is OD and offsets and len(offsets[0]) == 6:
        order = order[::-1]  # od -Ax writes six digits, octal and decimal seven
    valid = [radix for radix in order if not b"".join(offsets).translate(None, _DIGITS[radix])]
    for radix in valid:
        right = [
            _fits(int(after, radix) - int(offset, radix), length, repeated)
            for (offset, length, _), (after, _, repeated) in itertools.pairwise(marks)
            if offset and length and after.strip(b"0")
        ]
        if all(right):
            return radix, len(right)
    return (valid or order)[0], 0


def _fits(step: int, length: int, repeated: bool) -> bool:
    return step > 0 and step % length == 0 if repeated else step == length


class _Layout(NamedTuple):
    """The columns of a line: those laid out alike are read many at a time."""

    length: int
    width: int  # of the offset, in digits
    offset: slice
    pairs: slice
    head: slice  # all up to the gutter's opener
    shape: bytes

    @classmethod
    def of(cls, line: bytes, parts: DumpLine, opener: int) -> _Layout:
        indent = line.index(parts.offset)
        behind = indent + len(parts.offset)
        start = line.index(parts.pairs, behind)
        end = start + len(parts.pairs)
        head = slice(0, end + opener)
        shape = line[head].translate(_SHAPE)
        offset, pairs = slice(indent, behind), slice(start, end)
        return cls(len(line), len(parts.offset), offset, pairs, head, shape)


class _Reading:
    """Where a dump has got to: ``_expected`` is the offset that the next line must state."""

    def __init__(self, dialect: Dialect) -> None:
        self._dialect = dialect
        self._radix = 0
        self._expected = -1
        self._previous = b""
        self._layout: _Layout | None = None
        self._run = 1  # lines tried at once
        self._credit = REPEATED
        self.starred = False
        self.cut_off = False
        self.dumps = 1

    def read(self, block: LineBlock) -> Iterator[bytes]:
        """Yield the bytes that the lines of ``block`` state."""
        lines = block.lines()
        self._credit += REPEATED_SHARE * len(block.text)
        self._radix = self._radix or counted(self._dialect, lines)[0]
        index = 0
        while index < len(lines):
            if data := self._alike(lines, index):
                index += len(data) // len(self._previous)
                yield data
            else:
                yield from self._one(tidy(lines[index]), block.number + index, block.cut_off)
                index += 1

    def _alike(self, lines: list[bytes], index: int) -> bytes:
        """Read lines laid out like the one before in one go; nothing unless every one fits."""
        layout = self._layout
        if layout is None or self.starred or len(lines[index]) != layout.length:
            return b""
        run = lines[index : index + self._run]
        while len(run[-1]) != layout.length:
            run.pop()
        # one misfit costs what was tried: so try few after a misfit, and twice as many each time
        limit, self._run = self._run, 1
        joined = b"".join([line[layout.head] for line in run])
        if joined.translate(_SHAPE) != layout.shape * len(run):
            return b""
        step, number = len(self._previous), _FORMATS[self._radix]
        due = range(self._expected, self._expected + step * len(run), step)
        stated = b"".join([line[layout.offset] for line in run]).lower()
        if stated != b"".join([number % (layout.width, offset) for offset in due]):
            return b""
        self._run = min(2 * limit, _RUN)
        data = bytes.fromhex(b"".join([line[layout.pairs] for line in run]).decode("ascii"))
        self._expected = due.stop
        self._previous = data[-step:]
        return data

    def _one(self, line: bytes, number: int, cut_off: bool) -> Iterator[bytes]:
        if not line:
            return
        if line.strip() == b"*":
            if self._expected < 0:
                raise DamagedLine(number, "a * cannot be counted here: dump again with -v")
            self.starred = True
            return
        parts = self._dialect.split(line)
        data = bytes_in(self._dialect, parts)
        if cut_off and self._is_half(line, parts, data):
            self.cut_off = True
            if parts is None or not parts.pairs:
                return  # it broke off in the offset
            parts = parts._replace(pairs=parts.pairs[:-1])
            data = bytes_in(self._dialect, parts)
        if parts is None or data is None:
            raise DamagedLine(number, f"{quoted(line)} is no line of {self._dialect.tool}")
        if parts.offset:
            yield from self._due(parts.offset, data, number)
        elif self._expected >= 0:
            raise DamagedLine(number, f"{quoted(line)} has no offset: ask od for one type, -tx1")
        if not data:
            return
        if parts.offset:
            self._layout = _Layout.of(line, parts, self._dialect.opener)
            self._previous = data
            self._expected += len(data)
        yield data

    def _is_half(self, line: bytes, parts: DumpLine | None, data: bytes | None) -> bool:
        """Tell whether a last line without line end breaks off in mid-offset or mid-byte."""
        if self._layout and not line.translate(None, _DIGITS[16] + b":"):
            return len(line.rstrip(b":")) < self._layout.width or (
                self._dialect is XXD and parts is None
            )
        return data is None and parts is not None and not parts.gutter

    def _due(self, text: bytes, data: bytes, number: int) -> Iterator[bytes]:
        """Check a line's offset; yield what the ``*`` before it stands for."""
        if text.translate(None, _DIGITS[self._radix]):
            raise DamagedLine(number, f"the offset {quoted(text)} is not in base {self._radix}")
        offset = int(text, self._radix)
        if self._expected < 0:
            self._expected = offset
        missing = offset - self._expected
        shown, due = text.decode(), f"{self._number(self._expected, len(text))} is due"
        if self.starred:
            step = len(self._previous)
            # only a closing offset may end in the middle of a repeated line
            if missing < 0 or (data and missing % step):
                why = f"offset {shown} does not fit the * before it"
                raise DamagedLine(number, why, nonsense=False)
            self._credit -= missing
            if self._credit < 0:
                why = f"by offset {shown} the * before it stands for {missing} bytes: not credible"
                raise DamagedLine(number, why, nonsense=False)
            piece = self._previous * (min(missing, PIECE) // step + 1)
            for done in range(0, missing, len(piece)):
                yield piece[: missing - done]
            self.starred = False
        elif missing and not offset:
            self.dumps += 1
        elif missing:
            way = "skips" if missing > 0 else "goes back"
            why = f"offset {shown} {way} {abs(missing)} bytes ({due}): the dump is damaged"
            raise DamagedLine(number, why, nonsense=False)
        self._expected = offset

    def _number(self, offset: int, width: int) -> str:
        return (_FORMATS[self._radix] % (width, offset)).decode()

    def notes(self) -> Iterator[str]:
        """Yield what is worth knowing about the dump, at its end."""
        if self.dumps > 1:
            yield f"{self.dumps} dumps, one behind the other, are read as one stream"
        if self.cut_off:
            yield CUT_OFF
        if self.starred:
            yield "the dump ends with a *: how often the last line repeats is not known"


def _bytes(opened: Opened, dialect: Dialect) -> Iterator[bytes | None]:
    reading = _Reading(dialect)
    try:
        for block in arriving(opened.stream):
            if block is None:
                yield None
            else:
                yield from reading.read(block)
    finally:
        opened.notes.extend(reading.notes())


def read_xxd(opened: Opened) -> Iterator[Chunk]:
    """Yield the bytes of an ``xxd`` dump."""
    return untimed(_bytes(opened, XXD), opened.bus)


def read_hexdump(opened: Opened) -> Iterator[Chunk]:
    """Yield the bytes of a ``hexdump -C`` (or ``tshark -x``) dump."""
    return untimed(_bytes(opened, HEXDUMP), opened.bus)


def read_od(opened: Opened) -> Iterator[Chunk]:
    """Yield the bytes of an ``od -tx1`` dump, whatever the radix of its offsets."""
    return untimed(_bytes(opened, OD), opened.bus)
