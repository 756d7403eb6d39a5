"""Arrival stamps -> time on the wire, with an uncertainty.

A stamp is the latest moment its chunk's last byte can have come. Bytes are laid back to back from
there; they can have come earlier by the *slack*: the time the line had to spare since the chunk
before, but never more than the adapter can hold bytes back (its latency).
"""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.model import I64, NS, U8, Chunk, Clock, Direction, Frames, MarkKind, Mask

if TYPE_CHECKING:
    from collections.abc import Mapping

LATENCY_NS: Final[Mapping[Clock, int]] = MappingProxyType(
    {
        Clock.NONE: 0,
        # The stamps of a text file are taken at their word, to one USB full-speed frame.
        Clock.FILE: 1_000_000,
        # The FTDI latency timer's default; an adapter that merges bytes holds them this long.
        Clock.READ: 16_000_000,
        Clock.SAMPLE: 0,
    }
)
"""How long a stamp may lag behind its bytes, by kind of clock."""


def byte_time_ns(baud: int) -> int:
    """Return the wire time of one byte, 8N1: ten bits."""
    return 10 * NS // baud


def _held(chunks: tuple[Chunk, ...]) -> I64:
    """Return by how much each chunk may be older than stamped because the tap came late, in ns."""
    out = np.zeros(len(chunks), np.int64)
    for i, chunk in enumerate(chunks):
        for mark in chunk.marks:
            if mark.kind == MarkKind.HELD:
                out[i] = max(mark.count, out[i])
    return out


def _merged(chunks: tuple[Chunk, ...], latency: I64) -> Mask:
    """Tell which chunks are of two taps; their latency is raised to what their marks say."""
    out = np.zeros(len(chunks), bool)
    for i, chunk in enumerate(chunks):
        out[i] = chunk.clock == Clock.READ and chunk.direction != Direction.UNKNOWN
        for mark in chunk.marks:
            if mark.kind == MarkKind.MERGED:
                out[i], latency[i] = True, max(mark.count, int(latency[i]))
    return out


def _clock_of(chunk: Chunk) -> Clock:
    """Return a chunk's clock; a time that nobody vouches for is a time stamp like any other."""
    if chunk.clock == Clock.NONE and chunk.t_ns is not None:
        return Clock.FILE
    return chunk.clock


class Stamps:
    """One row a chunk that is still in the buffer: offset behind it, stamp, slack, direction."""

    def __init__(
        self, baud: int, tail_ns: int, latency_ns: int | None = None, base: int = 0
    ) -> None:
        self.byte_ns = byte_time_ns(baud)
        self.clock = Clock.NONE
        self._tail_ns = tail_ns
        self._latency_ns = latency_ns
        self._end = np.empty(0, np.int64)
        self._t = np.empty(0, np.int64)
        self._slack = np.empty(0, np.int64)
        self._direction = np.empty(0, np.uint8)
        self._first = self._offset = base
        self._last: int | None = None

    def add(self, chunks: tuple[Chunk, ...]) -> I64:
        """Take chunks in; return the stream offsets of the silences (barriers) before them."""
        sizes = np.array([len(k.data) for k in chunks], np.int64)
        end = self._offset + np.cumsum(sizes)
        clock = max(_clock_of(k) for k in chunks)
        self.clock = max(self.clock, clock)
        if clock == Clock.NONE and self._last is None:
            t = end * self.byte_ns
            slack = np.full(len(end), -1)
            barriers = np.empty(0, np.int64)
        else:
            t = self._known(chunks, sizes)
            before = t[0] - sizes[0] * self.byte_ns if self._last is None else self._last
            previous = np.concatenate([[before], t[:-1]])
            lull = t - sizes * self.byte_ns - previous
            usual = LATENCY_NS[self.clock] if self._latency_ns is None else self._latency_ns
            held = _held(chunks)
            latency = np.maximum(usual, held)
            slack = np.clip(lull, 0, latency)
            if self._last is None:
                slack[0] = latency[0]
            # Of two taps the pause on the wire is not known: each stamp may be late by all of it.
            slack = np.where(_merged(chunks, latency), latency, slack)
            # The bytes of a tap that came late may follow those before without a pause.
            barriers = (end - sizes)[lull - held > self._tail_ns]
            self._last = int(t[-1])
        self._end = np.concatenate([self._end, end])
        self._t = np.concatenate([self._t, t])
        self._slack = np.concatenate([self._slack, slack])
        directions = np.array([k.direction for k in chunks], np.uint8)
        self._direction = np.concatenate([self._direction, directions])
        self._offset = int(end[-1])
        return barriers[barriers > self._first]

    def _known(self, chunks: tuple[Chunk, ...], sizes: I64) -> I64:
        """Return the stamps; a chunk without one follows the chunk before it without a pause."""
        out: list[int] = []
        last = self._last
        for chunk, size in zip(chunks, sizes.tolist(), strict=True):
            last = chunk.t_ns if chunk.t_ns is not None else (last or 0) + size * self.byte_ns
            out.append(last)
        return np.array(out, np.int64)

    @property
    def last_ns(self) -> int:
        """The latest stamp; 0 before the first."""
        return self._last or 0

    def silent_since(self, now_ns: int) -> bool:
        """Tell whether the line has been silent for longer than the protocol's tail time."""
        return self._last is not None and now_ns - self._last > self._tail_ns

    def forget(self, offset: int) -> None:
        """Drop the rows of chunks that end at or before ``offset``."""
        keep = int(np.searchsorted(self._end, offset, "right"))
        # A chunk's last byte is needed as long as a gap may end on it: keep one row back.
        keep = max(0, keep - 1)
        if keep:
            self._end, self._t = self._end[keep:], self._t[keep:]
            self._slack, self._direction = self._slack[keep:], self._direction[keep:]

    def at(self, end: I64) -> I64:
        """Return the time of the byte before each stream offset."""
        k = np.searchsorted(self._end, end, "left")
        return np.asarray(self._t[k] - (self._end[k] - end) * self.byte_ns)

    def time(self, frames: Frames, base: int) -> Frames:
        """Fill in times, uncertainty and direction."""
        if not len(frames):
            return frames
        start, end = frames.start + base, frames.end + base
        k = np.searchsorted(self._end, end, "left")
        t_end = self._t[k] - (self._end[k] - end) * self.byte_ns
        j = np.searchsorted(self._end, start, "right")
        t_first = self._t[j] - (self._end[j] - start) * self.byte_ns
        directions: U8 = self._direction[k]
        return replace(
            frames,
            t_end=t_end,
            uncertainty=self._slack[k],
            t_start=np.minimum(t_first, t_end - frames.length * self.byte_ns),
            direction=directions,
        )
