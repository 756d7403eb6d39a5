"""A capture read in the background, to its end or for as long as it grows."""

from __future__ import annotations

import os
import queue
import threading
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from sniffer.decoding.pipeline import Pipeline
from sniffer.ground.model import NS, Clock, DamagedInputError, SnifferError
from sniffer.ground.runs import ChunkRun
from sniffer.jobs.order import merged
from sniffer.jobs.telling import Teller
from sniffer.sources import SOURCES
from sniffer.sources.recognise import HEAD, is_printable
from sniffer.sources.text import Opened

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from pathlib import Path

    from sniffer.decoding.options import Options
    from sniffer.ground.model import Chunk
    from sniffer.inside.index import CaptureIndex
    from sniffer.sources import Source

PAGE: Final = 1 << 16
"""Payload of a page, in bytes: what is decoded and fetched at once. Some 5000 frames."""

PAGE_CHUNKS: Final = 1 << 13
"""Chunks of a page at most."""

LOOK_S: Final = 0.05
"""How often a file is looked at for more."""

QUIET_S: Final = 1.0
"""A bus of which a growing recording has nothing for so long is taken to be silent: ten times what
a recorder holds back."""

WAITING_MOST: Final = 1 << 14
"""Chunks that are read ahead of what decodes them."""


def has_begun(path: Path) -> bool:
    """Tell whether a file that somebody writes shows what it is: it has a line, or is no text."""
    with path.open("rb") as file:
        head = file.read(HEAD)
    return len(head) == HEAD or not is_printable(head) or b"\n" in head or b"\r" in head


class GrowingFile:
    """A file that somebody writes: at its end, reading waits for more until it is stopped."""

    def __init__(self, path: Path, stop: threading.Event) -> None:
        self._path = path
        self._file = path.open("rb", buffering=0)
        self._stop = stop

    def read(self, size: int, /) -> bytes:
        """Return what has been written, up to ``size`` bytes; none once it is stopped.

        Raises:
            DamagedInputError: it was begun anew, as logs that rotate are: no more comes here.
        """
        while not (data := self._file.read(size)):
            if (anew := self._anew()) is not None:
                raise DamagedInputError(f"{self._path}: {anew}; open it again to see what it has")
            if self._stop.wait(LOOK_S):
                return b""
        return data

    def _anew(self) -> str | None:
        """Return how somebody began the file anew, None where nobody did."""
        mine = os.fstat(self._file.fileno())
        if mine.st_size < self._file.tell():
            return "it was cut short and is written anew"
        try:
            there = self._path.stat()
        except OSError:  # moved away: another one may come
            return None
        return None if os.path.samestat(mine, there) else "another file has taken its place"

    def close(self) -> None:
        """Close it."""
        self._file.close()


class Reading:
    """Reads a source into an index, in threads of its own.

    ``done``: nothing more comes. ``problem`` says in a line why it was not read to its end,
    ``failure`` is what kept it from being read at all; ``remarks`` is what a person should know.

    Args:
        source: what is read.
        options: how it is decoded; what a recording says of itself fills what is not said.
        index: takes the batches.
        growing: the file is written to; it is read on until ``stop``.
    """

    def __init__(
        self,
        source: Source,
        options: Options,
        index: CaptureIndex,
        *,
        growing: Path | None = None,
    ) -> None:
        self.index = index
        self.problem = ""
        self.failure: SnifferError | None = None
        self.remarks: list[str] = []
        self.growing = growing is not None
        self._source, self._options, self._path = source, options, growing
        self._stop = threading.Event()
        self._go_on = threading.Event()
        self._go_on.set()
        self._thread = threading.Thread(target=self._run, name="reading", daemon=True)

    @property
    def done(self) -> bool:
        """Whether nothing more comes."""
        return not self._thread.is_alive()

    def start(self, *, first: bool = False) -> None:
        """Begin; ``first``: with the first page, and wait until it is shown (``go_on``)."""
        if first:
            self._go_on.clear()
        self._thread.start()

    def go_on(self) -> None:
        """Read on behind the first page."""
        self._go_on.set()

    def wait(self, seconds: float | None = None) -> None:
        """Wait for its end."""
        self._thread.join(seconds)

    def stop(self) -> None:
        """Read no further; return when nothing is read any more, or after a moment."""
        self._stop.set()
        self._go_on.set()
        if self._thread.is_alive():
            self._thread.join(2 * QUIET_S)

    def _run(self) -> None:
        pipeline: Pipeline | None = None
        try:
            facts = self._source.facts()
            options = self._options.with_facts(facts, self._source.tables)
            pipeline = Pipeline(options, [self.index], live=self.growing)
            groups = self._followed(pipeline) if self._path else self._pieces(options)
            for group in groups:
                pipeline.feed(group)
                self.index.settle()
                if len(self.index.lines):
                    self._go_on.wait()
                if self._stop.is_set():
                    return
            self._end(pipeline)
        except DamagedInputError as error:
            self.problem = str(error)
            if pipeline is not None:
                self._end(pipeline)
        except SnifferError as error:
            self.problem, self.failure = str(error), error
        except OSError as error:
            self.problem = f"reading broke off ({error.strerror or error})"
        except Exception as error:  # a thread has nobody above it: it is said on the screen
            self.problem = f"a fault of this program ({type(error).__name__}: {error})"[:200]

    def _end(self, pipeline: Pipeline) -> None:
        try:
            pipeline.close()
        except SnifferError as error:  # its protocol cannot be told
            self.problem, self.failure = self.problem or str(error), error
        self.index.settle()
        for mistake in pipeline.mistaken():
            self.remarks.append(f"{mistake}: it looks like {mistake.found}")
        self.remarks += self._source.notes

    def _pieces(self, options: Options) -> Iterator[Sequence[Chunk]]:
        """Cut the groups of the source into pages."""
        quiet = Teller(self.remarks.append)
        self._source.hasten(PAGE, PAGE_CHUNKS)  # the first screen waits for the first page alone
        for group in merged(self._source, self._source, options, quiet):
            yield from pages(group)

    def _followed(self, pipeline: Pipeline) -> Iterator[Sequence[Chunk]]:
        """Yield what comes when it comes; tell the decoders of silences in a recording."""
        assert self._path is not None
        coming: queue.Queue[Chunk | Exception | None] = queue.Queue(WAITING_MOST)
        stream = GrowingFile(self._path, self._stop)
        reader = threading.Thread(
            target=self._read, args=(stream, coming), name="following", daemon=True
        )
        reader.start()
        heard, at = 0, time.monotonic()
        while True:
            try:
                first = coming.get(timeout=LOOK_S)
            except queue.Empty:
                silent_s = time.monotonic() - at
                if heard and silent_s > QUIET_S:
                    pipeline.idle(heard + int((silent_s - QUIET_S / 2) * NS))
                    self.index.settle()
                    heard = 0
                continue
            group: list[Chunk] = []
            size, one = 0, first
            while one is not None and not isinstance(one, Exception):
                group.append(one)
                size += len(one.data)
                if size >= PAGE or coming.empty():
                    break
                one = coming.get()
            if group:
                yield group
                at, last = time.monotonic(), group[-1]
                heard = (last.t_ns or 0) if last.clock == Clock.READ else 0
            if isinstance(one, Exception):
                raise one
            if one is None:
                return

    def _read(self, stream: GrowingFile, coming: queue.Queue[Chunk | Exception | None]) -> None:
        """Put the chunks of a growing file into a queue, then what ended them."""
        assert self._path is not None
        end: Exception | None = None
        try:
            for chunk in self._chunks(stream):
                while not self._stop.is_set():
                    try:
                        coming.put(chunk, timeout=LOOK_S)
                        break
                    except queue.Full:
                        continue
                if self._stop.is_set():
                    break
        except (SnifferError, OSError) as error:
            # stopped, it breaks off wherever it was
            end = None if self._stop.is_set() else error
        finally:
            stream.close()
        coming.put(end)

    def _chunks(self, stream: GrowingFile) -> Iterator[Chunk]:
        if self._source.format == "mcap":
            from sniffer.mcapfile import source

            for group in source.groups(stream, hasty=True):
                yield from group
            return
        name = os.fspath(self._path or "")
        for told in SOURCES[self._source.format](Opened(stream, name, self._path)):
            if isinstance(told, ChunkRun):
                yield from told
            else:
                yield told


def pages(group: Iterable[Chunk]) -> Iterator[list[Chunk]]:
    """Cut a group into pages."""
    page: list[Chunk] = []
    size = 0
    for chunk in (piece for each in group for piece in pieces(each)):
        page.append(chunk)
        size += len(chunk.data)
        if size >= PAGE or len(page) >= PAGE_CHUNKS:
            yield page
            page, size = [], 0
    if page:
        yield page


def pieces(chunk: Chunk) -> Iterator[Chunk]:
    """Cut a chunk that is longer than a page, if it has no time of its own and nothing marks it."""
    if len(chunk.data) <= PAGE or chunk.t_ns is not None or chunk.marks:
        yield chunk
        return
    for at in range(0, len(chunk.data), PAGE):
        yield replace(chunk, data=chunk.data[at : at + PAGE])
