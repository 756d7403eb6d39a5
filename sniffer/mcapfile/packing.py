"""Chunks of an MCAP file made ready to be written: packed, summed, and with an index behind them.

Of a conversion a thread packs them beside the one that decodes and encodes: zstd works outside the
interpreter's lock. What is written is the same, in the same order.
"""

from __future__ import annotations

import struct
import zlib
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
import zstandard
from mcap.opcode import Opcode

from sniffer.mcapfile.index import ChunkNote

if TYPE_CHECKING:
    from collections.abc import Iterator
    from concurrent.futures import Future

    import numpy.typing as npt

    from sniffer.ground.model import I64
    from sniffer.mcapfile.rows import U16

LEVEL: Final = 1
"""Of zstd: 3, its default, takes a fifth longer and packs no better."""

SMALL: Final = 1 << 17
SMALL_LEVEL: Final = 3
"""Of chunks of fewer bytes, as those of the raw bytes of a live recording are: a twentieth less."""

WAITING: Final = 8
"""Chunks handed over and not written yet: from then on the next one waits for the first."""

_INDEX: Final = np.dtype([("log", "<u8"), ("at", "<u8")])


class ChunkContents(NamedTuple):
    """What a chunk is made of: its records, and the messages among them.

    ``at`` is where in ``data`` each message stands, ``indexed`` whether the index will say so.
    """

    data: bytes | memoryview
    log: I64
    channel: U16
    at: I64
    indexed: bool


class ReadyChunk(NamedTuple):
    """A chunk as it is written, and what the summary says of it, as if it stood at 0."""

    data: bytes
    note: ChunkNote


def ready(compression: str, packed: bytes, crc: int, contents: ChunkContents) -> ReadyChunk:
    """Return a chunk whose records are packed already; ``crc`` is the sum of those."""
    data, log, channel, at, indexed = contents
    times = log.astype(np.uint64)  # as the format has them, whatever a damaged one says
    first, last = int(times.min()), int(times.max())
    name = compression.encode()
    body = struct.pack("<QQQII", first, last, len(data), crc, len(name)) + name
    body += struct.pack("<Q", len(packed))
    head = struct.pack("<BQ", Opcode.CHUNK, len(body) + len(packed)) + body
    counts = np.bincount(channel)
    ids = np.flatnonzero(counts).astype(np.uint16)
    counts = counts[ids]
    parts = [head, packed]
    if indexed:
        parts += _message_indexes(ids, counts, times, channel, at)
    length = len(head) + len(packed)
    told = compression, len(packed), len(data), ids, counts, indexed
    return ReadyChunk(b"".join(parts), ChunkNote(0, length, first, last, *told))


class Packer:
    """Packs chunks with zstd; ``beside``: in a thread of its own, a few ahead."""

    def __init__(self, *, beside: bool) -> None:
        self._large = zstandard.ZstdCompressor(level=LEVEL)
        self._small = zstandard.ZstdCompressor(level=SMALL_LEVEL)
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="chunks") if beside else None
        self._waiting: deque[tuple[Future[tuple[bytes, int]], ChunkContents]] = deque()

    def pack(self, contents: ChunkContents) -> Iterator[ReadyChunk]:
        """Take a chunk; yield what can be written now."""
        if self._thread is None:
            yield ready("zstd", *self._compress(contents.data), contents)
        else:
            # only this: the thread waits for the interpreter as often as it comes back
            packing = self._thread.submit(self._compress, contents.data)
            self._waiting.append((packing, contents))
            yield from self.done(wait=False)

    def _compress(self, data: bytes | memoryview) -> tuple[bytes, int]:
        """Return a chunk's records packed, and their sum: both work outside the lock."""
        crc = zlib.crc32(data)
        return (self._small if len(data) < SMALL else self._large).compress(data), crc

    def done(self, *, wait: bool) -> Iterator[ReadyChunk]:
        """Yield the chunks that are packed by now, in their order; ``wait``: all there are."""
        waiting = self._waiting
        while waiting and (wait or len(waiting) > WAITING or waiting[0][0].done()):
            packing, contents = waiting.popleft()
            yield ready("zstd", *packing.result(), contents)

    def drop(self) -> None:
        """Forget what is not written, and end the thread."""
        self._waiting.clear()
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
