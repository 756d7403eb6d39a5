"""A log of lines from one line of its file to another, with what was said before it counted."""

from __future__ import annotations

import itertools
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from sniffer.ground.limits import GROUP_CHUNKS
from sniffer.ground.model import DamagedInputError, Direction
from sniffer.sources.candump import CandumpLog, notes_on
from sniffer.sources.text import BLOCK, DamagedLine, Opened, blocks, read_log

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path
    from typing import BinaryIO

    from sniffer.ground.model import Chunk


class LogCount(NamedTuple):
    """What a stretch of a log holds: bytes by bus, lines, CAN error frames; how it ends."""

    sizes: Counter[str]
    lines: int = 0
    errors: int = 0
    cut_off: bool = False


@dataclass(slots=True)
class LogStretch:
    """Whole lines of a log, read as the whole is.

    ``before`` is what stands in front of them; ``bases`` and ``due`` are as a ``Stretch`` has them.
    """

    path: Path
    name: str
    bus: str
    begin: int
    end: int
    before: LogCount = field(default_factory=lambda: LogCount(Counter()))
    bases: dict[str, int] = field(default_factory=dict)
    due: dict[str, int] = field(default_factory=dict)
    behind: LogCount = field(default_factory=lambda: LogCount(Counter()))
    """What stands in front of whatever follows, but for the bytes: known once it was read."""

    def __iter__(self) -> Iterator[Sequence[Chunk]]:
        group: list[Chunk] = []
        held = 0
        try:
            with self.path.open("rb", buffering=0) as file:
                part, log = _Bounded(file, self.begin, self.end), CandumpLog(self.bus)
                for chunk in read_log(Opened(part, self.name, bus=self.bus), log):
                    self.bases.setdefault(chunk.bus, self.before.sizes[chunk.bus])
                    group.append(chunk)
                    held += len(chunk.data)
                    if held >= BLOCK or len(group) >= GROUP_CHUNKS:
                        yield group
                        group, held = [], 0
                own = LogCount(Counter(), part.lines, log.errors, log.cut_off)
                self.behind = _sum(self.before, own)
        except DamagedLine as damage:
            if group:
                yield group
            why = str(damage).removeprefix(f"line {damage.line}")
            told = f"{self.name}, line {damage.line + self.before.lines}{why}"
            raise DamagedInputError(told) from None
        except OSError as error:
            why = f"{self.name}: reading broke off ({error.strerror})"
            raise DamagedInputError(why) from None
        if group:
            yield group

    def count(self) -> LogCount:
        """Return what it holds, as far as its lines make sense."""
        log, sizes, lines = CandumpLog(self.bus), Counter[str](), 0
        try:
            with self.path.open("rb", buffering=0) as file:
                for block in blocks(_Bounded(file, self.begin, self.end)):
                    sizes += log.sizes(block)
                    lines += block.text.count(b"\n") + 1
        except (DamagedInputError, OSError):
            pass  # whoever decodes it tells
        return LogCount(sizes, lines, log.errors, log.cut_off)


class _Bounded:
    """A file from one place to another."""

    def __init__(self, file: BinaryIO, begin: int, end: int) -> None:
        file.seek(begin)
        self._file, self._left = file, end - begin
        self.lines = 0
        """The lines that were read to their end."""

    def read(self, size: int, /) -> bytes:
        """Return up to ``size`` bytes, none at the end."""
        data = self._file.read(min(size, self._left))
        self._left -= len(data)
        self.lines += data.count(b"\n")
        return data


def line_behind(file: BinaryIO, at: int) -> int:
    """Return where the first line begins that begins at ``at`` or behind it, or the file ends."""
    if not at:
        return 0
    file.seek(at - 1)
    while data := file.read(BLOCK):
        end = data.find(b"\n")
        if end >= 0:
            return at + end
        at += len(data)
    return at - 1


def summed(counts: Sequence[LogCount]) -> list[LogCount]:
    """Return what stands before each of some stretches that follow on each other, and all of it."""
    return list(itertools.accumulate(counts, _sum, initial=LogCount(Counter())))


def _sum(a: LogCount, b: LogCount) -> LogCount:
    return LogCount(a.sizes + b.sizes, a.lines + b.lines, a.errors + b.errors, b.cut_off)


def notes_of(told: LogCount) -> list[str]:
    """Return what is worth knowing of a log, as its reader has it."""
    return list(notes_on(told.errors, cut_off=told.cut_off))


def is_one_way(chunks: Sequence[Chunk]) -> bool:
    """Tell whether no bus of a log names a wire: then its lines cannot be mixed by their host."""
    first: dict[str, Chunk] = {}
    for chunk in chunks:
        first.setdefault(chunk.bus, chunk)
    return all(c.t_ns is None or c.direction == Direction.UNKNOWN for c in first.values())
