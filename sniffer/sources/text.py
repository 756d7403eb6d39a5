"""What all text inputs share: blocks of whole lines, and damage that knows its line.

A reader takes an :class:`Opened` input and yields chunks lazily; it holds one block at a time,
whatever the size of the file. Where the text stops making sense it raises ``DamagedLine`` after
having yielded all that came before.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, NamedTuple, Protocol, TypeVar, runtime_checkable

import numpy as np

from sniffer.ground.model import Chunk, DamagedInputError
from sniffer.ground.wording import counted

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from pathlib import Path

    from sniffer.ground.files import Stream

T = TypeVar("T")

BLOCK: Final = 1 << 18
"""Text or raw bytes read at a time, in bytes."""

PIECE: Final = 1 << 16
"""Payload of one chunk where the input has no times, in bytes."""

LONGEST_LINE: Final = 1 << 20
"""A dump line longer than this is none, in bytes: it bounds memory."""

FIRST_LINES: Final = 8
"""Nonsense up to this line means a wrong format, not a damaged file."""

UTF8_BOM: Final = b"\xef\xbb\xbf"

_NEWLINE: Final = 10

CUT_OFF: Final = "the last line is cut off: read as far as it goes"
"""The note about an input that ends in the middle of a line."""


PAUSE: Final = Chunk(b"")
"""What a reader yields where nothing more has come yet: what it gave before may be handed on."""


@runtime_checkable
class Arriving(Protocol):
    """A stream whose bytes come when they come."""

    def read(self, size: int, /) -> bytes:
        """Return up to ``size`` bytes that are there, none at the end; wait for the first."""

    def comes(self) -> bool:
        """Tell whether a read would have something soon, or the end."""


def pauses(stream: Stream) -> bool:
    """Tell whether nothing more has come of a stream for a while."""
    return isinstance(stream, Arriving) and not stream.comes()


@dataclass(frozen=True, slots=True)
class Opened:
    """An input that is open: where its bytes come from and what its chunks are to say.

    ``path`` is None for standard input and for bytes. Readers add to ``notes`` what a person
    should know although nothing is wrong, one sentence each.
    """

    stream: Stream
    name: str
    path: Path | None = None
    bus: str = "bus0"
    notes: list[str] = field(default_factory=list)


class DamagedLine(DamagedInputError):
    """The text makes no sense from ``line`` on, counted from 1.

    ``nonsense`` is false where the line is well-formed but contradicts what was read before it:
    that is a damaged file however early it comes.
    """

    def __init__(self, line: int, why: str, *, column: int = 0, nonsense: bool = True) -> None:
        where = f"line {line}, column {column}" if column else f"line {line}"
        super().__init__(f"{where}: {why}")
        self.line = line
        self.nonsense = nonsense


class LineBlock(NamedTuple):
    """Whole lines without the last line end; CRLF is already LF.

    ``number`` is the first line's, from 1. ``column`` counts the bytes of that line which earlier
    blocks held (only where an endless line was parted). ``cut_off`` marks the last block of a
    text that does not end in a line end: its last line may be half written.
    """

    text: bytes
    number: int
    column: int
    cut_off: bool

    def lines(self) -> list[bytes]:
        """Return the lines without their ends."""
        return self.text.split(b"\n")


class LineWalk:
    """A way through a block by whole entries where they are as usual, by lines where they are not.

    ``at`` is where the next entry or line begins; who reads an entry moves it behind it.
    """

    def __init__(self, block: LineBlock) -> None:
        self._text = block.text
        self._counted, self._number = 0, block.number
        self.at = 0

    @property
    def is_inside(self) -> bool:
        """Whether there is another line."""
        return self.at <= len(self._text)

    @property
    def number(self) -> int:
        """The number of the line at which the walk is."""
        self._number += self._text.count(b"\n", self._counted, self.at)
        self._counted = self.at
        return self._number

    def line(self) -> tuple[bytes, int]:
        """Return the next line and its number, and go on behind it."""
        number = self.number
        end = self._text.find(b"\n", self.at)
        end = len(self._text) if end < 0 else end
        line = self._text[self.at : end]
        self.at = end + 1
        return line, number


def quoted(text: bytes) -> str:
    """Return the head of ``text``, safe to show in a message of one line."""
    shown = ascii(text[:40].decode("utf-8", "replace"))
    return shown if len(text) <= 40 else shown + "..."


def blocks(stream: Stream, *, size: int = 0) -> Iterator[LineBlock]:
    """Yield the text in whole lines; see ``arriving``."""
    return (block for block in arriving(stream, size=size) if block is not None)


def arriving(
    stream: Stream, part: Callable[[bytes], int] | None = None, *, size: int = 0
) -> Iterator[LineBlock | None]:
    """Yield the text in whole lines, None where nothing more has come yet.

    ``part`` says where in a buffer without a line end an endless line may be parted; without it
    such a line raises :class:`DamagedLine`. ``size``: bytes that are read at once, ``BLOCK`` if 0.
    """
    held = b""
    number, column, first = 1, 0, True
    while True:
        if pauses(stream):
            yield None
        read = stream.read(size or BLOCK)
        if first:
            read = read.removeprefix(UTF8_BOM)
            first = False
        if not read:
            break
        held += read
        end = held.rfind(b"\n")
        if end < 0:
            if part is None:
                if len(held) > LONGEST_LINE:
                    raise DamagedLine(
                        number, f"a line of more than {LONGEST_LINE} bytes is no dump"
                    )
            elif len(held) >= BLOCK and (end := part(held)) > 0:
                yield LineBlock(held[:end], number, column, cut_off=False)
                column += end
                held = held[end:]
            continue
        text, held = held[:end], held[end + 1 :]
        if b"\r" in text:  # looking for one sign takes a tenth of looking for two
            text = text.replace(b"\r\n", b"\n").removesuffix(b"\r")
        yield LineBlock(text, number, column, cut_off=False)
        # a tenth of the time of bytes.count, which stops at each
        number += int(np.count_nonzero(np.frombuffer(text, np.uint8) == _NEWLINE)) + 1
        column = 0
    if held:
        yield LineBlock(held, number, column, cut_off=True)


class TextLog(Protocol):
    """Where the reader of a log has got to."""

    def chunks(self, block: LineBlock) -> Iterator[Chunk]:
        """Yield what the lines of ``block`` hold."""

    def rest(self) -> Iterator[Chunk]:
        """Yield what is held back, in case a further line belongs to it."""
        return iter(())

    def notes(self) -> Iterator[str]:
        """Yield what is worth knowing about the log, at its end."""


def read_log(opened: Opened, log: TextLog) -> Iterator[Chunk]:
    """Yield the chunks of a log; those before damage, too, and the notes however it ends."""
    return read_blocks(opened, log, log.chunks)


def read_blocks(
    opened: Opened, log: TextLog, taken: Callable[[LineBlock], Iterator[T]]
) -> Iterator[Chunk | T]:
    """Do that with what is made of each block by ``taken``, runs of chunks for instance."""
    try:
        for block in arriving(opened.stream):
            if block is None:
                yield PAUSE
            else:
                yield from taken(block)
        yield from log.rest()
    except DamagedInputError:
        yield from log.rest()
        raise
    finally:
        opened.notes.extend(log.notes())


def left_out(count: int, between: str, whose: str) -> str:
    """Return what is said of lines of others, nothing where there are none."""
    are = "is" if count == 1 else "are"
    return f"{counted(count, 'line')} {between} {are} none of {whose}: left out" if count else ""


def remarks(*told: str, cut_off: bool) -> Iterator[str]:
    """Yield in one note what there is to say at the end of a log, if there is anything."""
    said = [*filter(None, told), *([CUT_OFF] if cut_off else [])]
    if said:
        yield "; ".join(said)


def joined(pieces: Iterable[bytes | None]) -> Iterator[bytes | None]:
    """Join small pieces to about :data:`PIECE` bytes; what came before damage is yielded first.

    None is a pause, before which everything is yielded, too.
    """
    held: list[bytes] = []
    size = 0
    try:
        for piece in pieces:
            if piece is not None:
                held.append(piece)
                size += len(piece)
            if size >= PIECE or (size and piece is None):
                yield b"".join(held)
                held.clear()
                size = 0
            if piece is None:
                yield None
    except DamagedInputError:
        if size:
            yield b"".join(held)
        raise
    if size:
        yield b"".join(held)


def untimed(pieces: Iterable[bytes | None], bus: str) -> Iterator[Chunk]:
    """Yield chunks without times."""
    for piece in joined(pieces):
        yield PAUSE if piece is None else Chunk(piece, bus=bus)


def cells_of(line: str) -> list[str]:
    """Return the cells of a row, one that is empty where its quotes make no sense."""
    if '"' not in line:
        return line.split(",")
    try:
        return next(csv.reader([line]), [])
    except csv.Error:
        return [""]
