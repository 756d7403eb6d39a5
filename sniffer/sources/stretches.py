"""An input from one place of its file to another: what a part of a capture is read from."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np

from sniffer.ground.model import Chunk, DamagedInputError
from sniffer.sources import SingleSource
from sniffer.sources.text import BLOCK

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from sniffer.sources.logstretches import LogCount, LogStretch
    from sniffer.sources.source import Source

HEAD: Final = 1 << 20
"""Bytes that are decoded first: what is spoken, how fast, and what servos are set to is known from
them, and mostly stays so. A capture of 100 MB has a hundredth of that."""

LEAST: Final = 1 << 22
"""Bytes of a part at least: its warm-up is a sixteenth of that."""

MOST: Final = 1 << 26
"""And at most: what is guessed wrong, and what waits for its turn on the disk, are parts."""

SHARES: Final = 4
"""Parts a job: the last ones end together, whatever the machine does beside."""

UNPACKED: Final = 8
"""Bytes that a recording holds, unpacked, for each byte of a bus: what is decoded stands beside it.
Where there is more or less of it, parts are smaller or larger."""

WRITTEN: Final = 5
"""Bytes of a log for each byte of a bus, about: a time, a bus, and two digits a byte."""

WARM: Final = 1 << 18
"""Payload that a part decodes before its own, in bytes: by then it knows what is under way. Answers
are late for requests that are half as far behind at most (``anomalies.answers``)."""


class FileStretch(Protocol):
    """A part of an input; iterate it for groups of chunks. It can be pickled.

    ``bases`` tells where in its stream the first byte of each bus stands, once it was read; ``due``
    where it must stand, as far as that is known before.
    """

    bases: dict[str, int]
    due: dict[str, int]

    def __iter__(self) -> Iterator[Sequence[Chunk]]:
        """Read it."""
        ...


@dataclass(slots=True)
class BinaryStretch:
    """Bytes of a file of raw bytes; iterate it for groups of chunks, as the whole input has them.

    ``bases`` and ``due`` as ``FileStretch`` has them: here both are plain.
    """

    path: Path
    name: str
    bus: str
    begin: int
    end: int
    bases: dict[str, int] = field(default_factory=dict)
    due: dict[str, int] = field(default_factory=dict)

    def __iter__(self) -> Iterator[Sequence[Chunk]]:
        self.bases[self.bus] = at = self.begin
        try:
            with self.path.open("rb", buffering=0) as file:
                file.seek(at)
                while at < self.end and (data := file.read(min(BLOCK, self.end - at))):
                    at += len(data)
                    yield [Chunk(data, bus=self.bus)]
        except OSError as error:
            why = f"{self.name}: reading broke off after {at} bytes"
            raise DamagedInputError(f"{why} ({error.strerror})") from None


@dataclass(frozen=True, slots=True)
class Seam:
    """Where a part begins: its warm-up, and what of it is its own."""

    warm: FileStretch
    own: FileStretch


@dataclass(frozen=True, slots=True)
class Stretches:
    """A capture as stretches: its head, and the parts behind it in order.

    ``tally`` is all of it by its edges, where it must be counted first what stands before each.
    """

    head: FileStretch
    parts: Sequence[Seam]
    tally: Sequence[LogStretch] = ()

    def in_turn(self, notes: list[str]) -> Iterator[FileStretch]:
        """Yield the parts for one who has read the head, each when the one before was read.

        What is worth knowing of all of it stands in ``notes`` in the end.
        """
        from sniffer.sources.logstretches import LogStretch, notes_of

        last = self.head
        for stretch in (seam.own for seam in self.parts):
            if isinstance(stretch, LogStretch) and isinstance(last, LogStretch):
                stretch.before = last.behind
            yield stretch
            last = stretch
        if isinstance(last, LogStretch):
            notes[:] = notes_of(last.behind)

    def counted(self, counts: Sequence[LogCount]) -> list[str]:
        """Take what the stretches of ``tally`` hold; return what is worth knowing of all of it."""
        from sniffer.sources.logstretches import LogStretch, notes_of, summed

        sums = summed(counts)
        before = dict(zip([one.begin for one in self.tally], sums, strict=False))
        for seam in self.parts:
            for stretch in (seam.warm, seam.own):
                assert isinstance(stretch, LogStretch)
                stretch.before = before[stretch.begin]
        return notes_of(sums[-1])


@dataclass(frozen=True, slots=True)
class Sizes:
    """How a capture is cut: bytes of the head, of a part at least and at most, and of a warm-up.

    Parts of raw bytes are whole blocks, as they are read. ``first`` bytes stand in the first group
    of the whole input: by them times are judged, so the head must have as many.
    """

    head: int = HEAD
    least: int = LEAST
    most: int = MOST
    warm: int = WARM
    block: int = BLOCK
    first: int = BLOCK

    @property
    def smallest(self) -> int:
        """Bytes that a capture of raw bytes has at least that is cut."""
        return self.head + 2 * self.least

    def each(self, rest: int, jobs: int) -> int:
        """Return the size of a part, where so many bytes follow the head."""
        return min(max(rest // (SHARES * jobs), self.least), self.most)


def stretches_of(source: Source, sizes: Sizes, jobs: int) -> Stretches | str:
    """Return a capture in parts for so many jobs; in words why not, where it is read in one go.

    Nothing is said where it is too small to gain by it.
    """
    if not isinstance(source, SingleSource):
        return f"only one file can be read in parts, not {source.label}"
    if source.path is None:
        return "only a file that is not packed can be read in parts"
    if source.format == "bin":
        return _of_binary(source, source.path, sizes, jobs)
    if source.format == "mcap":
        return _of_recording(source, source.path, sizes, jobs)
    if source.format == "candump":
        return _of_log(source, source.path, sizes, jobs)
    return f"only raw bytes, candump logs and recordings are read in parts, not {source.label}"


def _of_binary(source: SingleSource, path: Path, sizes: Sizes, jobs: int) -> Stretches | str:
    size = path.stat().st_size
    if size < sizes.smallest:
        return ""
    each = sizes.each(size - sizes.head, jobs)
    each = -(-each // sizes.block) * sizes.block  # chunks are those of the whole input

    def stretch(begin: int, end: int) -> FileStretch:
        return BinaryStretch(path, source.name, source.bus, begin, end)

    parts = [
        Seam(stretch(max(at - sizes.warm, 0), at), stretch(at, min(at + each, size)))
        for at in range(sizes.head, size, each)
    ]
    return Stretches(stretch(0, sizes.head), parts)


def _of_log(source: SingleSource, path: Path, sizes: Sizes, jobs: int) -> Stretches | str:
    from sniffer.sources.logstretches import LogStretch, is_one_way, line_behind

    size, head = path.stat().st_size, sizes.head * WRITTEN
    if size - head < 2 * sizes.least * WRITTEN:
        return ""

    def stretch(begin: int, end: int) -> LogStretch:
        return LogStretch(path, source.name, source.bus, begin, end)

    each = sizes.each((size - head) // WRITTEN, jobs) * WRITTEN
    with path.open("rb") as file:
        seams = [at for at in (line_behind(file, x) for x in range(head, size, each)) if at < size]
        seams = sorted(set(seams))
        warm = [line_behind(file, max(at - sizes.warm * WRITTEN, 0)) for at in seams]
    if len(seams) < 2:
        return ""
    if not is_one_way([chunk for group in stretch(0, seams[0]) for chunk in group]):
        return "its lines may be of two taps, and mixed"
    parts = [
        Seam(stretch(early, at), stretch(at, end))
        for early, (at, end) in zip(warm, itertools.pairwise([*seams, size]), strict=True)
    ]
    edges = sorted({0, *warm, *seams, size})
    tally = [stretch(begin, end) for begin, end in itertools.pairwise(edges)]
    return Stretches(stretch(0, seams[0]), parts, tally)


def _of_recording(source: SingleSource, path: Path, sizes: Sizes, jobs: int) -> Stretches | str:
    from sniffer.mcapfile.stretches import RecordedFile, indexed

    if path.stat().st_size < sizes.head:
        return ""
    found = indexed(path)
    if found is None:
        return "the recording has no index that is sound: `sniffer recover` makes one"
    end = np.cumsum(np.array(found.sizes, np.int64))
    total = int(end[-1])
    head = sizes.head * UNPACKED
    each = sizes.each(total // UNPACKED - sizes.head, jobs) * UNPACKED
    marks = np.searchsorted(end, np.arange(head, total, each)).tolist()
    seams = sorted({mark + 1 for mark in marks if mark + 1 < len(end)})
    if len(seams) < 2:
        return ""
    file = RecordedFile(path, source.name, found)
    parts = []
    for begin, until in itertools.pairwise([*seams, len(end)]):
        warm = int(np.searchsorted(end, end[begin - 1] - sizes.warm * UNPACKED))
        parts.append(Seam(file.stretch(min(warm, begin - 1), begin), file.stretch(begin, until)))
    return Stretches(file.stretch(0, seams[0]), parts)
