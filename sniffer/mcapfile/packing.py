"""Chunks of an MCAP file made ready to be written: packed, summed, and with an index behind them.

Of a conversion a thread puts messages in order and packs them, beside the one that decodes and
encodes: zstd, sums and large copies work outside the interpreter's lock. What is written is the
same, in the same order.
"""

from __future__ import annotations

import itertools
import struct
import zlib
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
import zstandard
from mcap.opcode import Opcode

from sniffer.mcapfile.index import ChunkNote

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from concurrent.futures import Future

    import numpy.typing as npt

    from sniffer.ground.model import I64, Mask
    from sniffer.mcapfile.queue import Sorted, Unsorted
    from sniffer.mcapfile.rows import U16

LEVEL: Final = 1
"""Of zstd: 3, its default, takes a fifth longer and packs no better."""

SMALL: Final = 1 << 17
SMALL_LEVEL: Final = 3
"""Of chunks of fewer bytes, as those of the raw bytes of a live recording are: a twentieth less."""

WAITING: Final = 16 << 20
"""Records handed over and not written yet, in bytes: from then on one waits for the first."""

_INDEX: Final = np.dtype([("log", "<u8"), ("at", "<u8")])


class ChunkContents(NamedTuple):
    """What a chunk is made of: its records, and the messages among them.

    ``at`` is where in ``data`` each message stands, ``listed`` whether the index says so. Of each
    channel it says so of one message at least.
    """

    data: bytes | memoryview
    log: I64
    channel: U16
    at: I64
    listed: Mask

    @classmethod
    def of(cls, rows: Sorted, head: bytes, *, indexed: bool) -> ChunkContents:
        """Return messages with other records before them."""
        data = b"".join((head, rows.data)) if head else rows.data
        at = rows.start + len(head) if head else rows.start
        listed = rows.listed if indexed else np.zeros(len(at), bool)
        return cls(data, rows.log, rows.channel, at, listed)


class ReadyChunk(NamedTuple):
    """A chunk as it is written, and what the summary says of it, as if it stood at 0."""

    data: bytes
    note: ChunkNote


def ready(compression: str, packed: bytes, crc: int, contents: ChunkContents) -> ReadyChunk:
    """Return a chunk whose records are packed already; ``crc`` is the sum of those."""
    data, log, channel, at, listed = contents
    times = log.astype(np.uint64)  # as the format has them, whatever a damaged one says
    first, last = int(times.min()), int(times.max())
    name = compression.encode()
    body = struct.pack("<QQQII", first, last, len(data), crc, len(name)) + name
    body += struct.pack("<Q", len(packed))
    head = struct.pack("<BQ", Opcode.CHUNK, len(body) + len(packed)) + body
    counts = np.bincount(channel)
    ids = np.flatnonzero(counts).astype(np.uint16)
    counts = counts[ids]
    if not listed.all():
        # Who looks a topic up finds the chunk by the index that it has for it, and the library of
        # TypeScript reads no file in which a chunk has none.
        earliest = np.empty(int(ids[-1]) + 1, np.int64)
        earliest[channel[::-1]] = np.arange(len(channel))[::-1]
        listed = listed.copy()
        listed[earliest[ids]] = True
        times, channel, at = times[listed], channel[listed], at[listed]
    entries = np.bincount(channel)[ids]
    parts = [head, packed, *_message_indexes(ids, entries, times, channel, at)]
    length = len(head) + len(packed)
    told = compression, len(packed), len(data), ids, counts, entries
    return ReadyChunk(b"".join(parts), ChunkNote(0, length, first, last, *told))


class Packer:
    """Packs chunks with zstd; ``beside``: in a thread of its own, a few ahead."""

    def __init__(self, *, beside: bool) -> None:
        self._large = zstandard.ZstdCompressor(level=LEVEL)
        self._small = zstandard.ZstdCompressor(level=SMALL_LEVEL)
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="chunks") if beside else None
        self._waiting: deque[tuple[Future[list[ReadyChunk]], int]] = deque()
        self._held = 0

    def pack(self, contents: ChunkContents) -> Iterator[ReadyChunk]:
        """Take a chunk; yield what can be written now."""
        return self._do(partial(self._packed, [contents]), len(contents.data))

    def lay(self, rows: Unsorted, floor: int, head: bytes) -> Iterator[ReadyChunk]:
        """Take messages, put them in order and pack them; yield what can be written now.

        No log time is below ``floor``; ``head`` are records that stand before all of them.
        """
        return self._do(partial(self._laid, rows, floor, head), rows.size)

    def _do(self, make: Callable[[], list[ReadyChunk]], size: int) -> Iterator[ReadyChunk]:
        if self._thread is None:
            yield from make()
            return
        self._waiting.append((self._thread.submit(make), size))
        self._held += size
        yield from self.done(wait=False)

    def _laid(self, rows: Unsorted, floor: int, head: bytes) -> list[ReadyChunk]:
        heads = itertools.chain([head], itertools.repeat(b""))
        pieces = zip(rows.sorted(floor).pieces(), heads, strict=False)
        return self._packed(ChunkContents.of(rows, head, indexed=True) for rows, head in pieces)

    def _packed(self, chunks: Iterable[ChunkContents]) -> list[ReadyChunk]:
        out = []
        for contents in chunks:
            packer = self._small if len(contents.data) < SMALL else self._large
            crc = zlib.crc32(contents.data)
            out.append(ready("zstd", packer.compress(contents.data), crc, contents))
        return out

    def done(self, *, wait: bool) -> Iterator[ReadyChunk]:
        """Yield the chunks that are packed by now, in their order; ``wait``: all there are."""
        waiting = self._waiting
        while waiting and (wait or self._held > WAITING or waiting[0][0].done()):
            packing, size = waiting.popleft()
            self._held -= size
            yield from packing.result()

    def drop(self) -> None:
        """Forget what is not written, and end the thread."""
        self._waiting.clear()
        self._held = 0
        if self._thread is not None:
            self._thread.shutdown(wait=False, cancel_futures=True)


def _message_indexes(
    ids: U16, counts: I64, times: npt.NDArray[np.uint64], channel: U16, at: I64
) -> Iterator[bytes]:
    """Yield a message index record for each channel of a chunk."""
    order = np.argsort(channel, kind="stable")
    index = np.empty(len(order), _INDEX)
    index["log"], index["at"] = times[order], at[order]
    entries, done = index.tobytes(), 0
    for number, count in zip(ids.tolist(), counts.tolist(), strict=True):
        n = 16 * count
        yield struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + n, number, n)
        yield entries[done : done + n]
        done += n
