"""By how much two clocks differ that stamped the same traffic: found from the bytes both heard.

Two taps on one bus hear the same bytes. Runs of bytes that occur once in each of them are the same
moment, so each gives the difference of the clocks, but for what the adapters held back. Traffic
that repeats itself has few such runs, or none: then runs that occur some times vote, all with all,
and only a difference that far more vote for than for any other is taken.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sniffer.ground.model import I64, U8, Chunk

RUN: Final = 24
"""Bytes of a run: longer than an exchange of most commands, so that values and their neighbours
make it single."""

MOST: Final = 4 << 20
"""Bytes of a stream that are compared: six minutes of a full line at 115200 baud."""

OFTEN: Final = 8
"""A run that occurs more often than this says nothing."""

BIN_NS: Final = 20_000_000
"""Votes so near each other are for one difference: an FTDI adapter holds bytes for 16 ms."""

LEAST: Final = 16
"""Votes for a difference at least: so many runs are not alike by chance."""

CLEAR: Final = 3
"""So many times as many as for the second one."""


class Alignment(NamedTuple):
    """By how much the second clock is ahead, in ns; half of the runs lie within ``spread_ns``."""

    offset_ns: int
    spread_ns: int
    runs: int


def aligned(
    first: Iterable[Chunk], second: Iterable[Chunk], *, byte_ns: tuple[int, int] = (0, 0)
) -> Alignment | None:
    """Return by how much the clock of the second tap is ahead, None where nothing tells.

    ``byte_ns`` is how long a byte takes in each; 0: a read's bytes all count as its last one.
    """
    keys_a, times_a = _runs(first, byte_ns[0])
    keys_b, times_b = _runs(second, byte_ns[1])
    ahead = _votes(keys_a, times_a, keys_b, times_b)
    if len(ahead) < LEAST:
        return None
    bins, counts = np.unique(ahead // BIN_NS, return_counts=True)
    # a difference at the edge of a bin has its votes in two of them
    both = counts + np.where(np.isin(bins + 1, bins), np.append(counts[1:], 0), 0)
    best = int(np.argmax(both))
    others = both[np.abs(bins - bins[best]) > 1]
    if both[best] < max(LEAST, CLEAR * int(others.max(initial=0))):
        return None
    low = bins[best] * BIN_NS
    mine = ahead[(ahead >= low) & (ahead < low + 2 * BIN_NS)]
    offset = int(np.median(mine))
    return Alignment(offset, int(np.median(np.abs(mine - offset))), len(mine))


def stamped(chunks: Iterable[Chunk], byte_ns: int) -> tuple[U8, I64]:
    """Return the first ``MOST`` bytes of a stream, and when each came by the stamps."""
    parts: list[bytes] = []
    times: list[int] = []
    sizes: list[int] = []
    size = 0
    for chunk in chunks:
        if chunk.data and chunk.t_ns is not None:
            parts.append(chunk.data)
            times.append(chunk.t_ns)
            sizes.append(len(chunk.data))
            size += len(chunk.data)
            if size >= MOST:
                break
    data = np.frombuffer(b"".join(parts), np.uint8)
    behind = np.repeat(np.cumsum(sizes), sizes) - np.arange(len(data)) - 1  # bytes of the read
    return data, np.repeat(np.array(times, np.int64), sizes) - behind * byte_ns


def _runs(chunks: Iterable[Chunk], byte_ns: int) -> tuple[I64, I64]:
    """Return a number for each run of a stream's bytes, in order, and when its last byte came."""
    heard, stamps = stamped(chunks, byte_ns)
    data = heard.astype(np.uint64)
    if len(data) < RUN:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    n = len(data) - RUN + 1
    keys = np.zeros(n, np.uint64)
    for k in range(RUN):
        # a polynomial modulo 2^64 (the multiplier of Knuth's MMIX): unlike runs of so few bytes
        # have one number too rarely to matter in a vote
        keys = keys * np.uint64(6364136223846793005) + data[k : k + n] + np.uint64(1)
    return keys.view(np.int64), stamps[RUN - 1 :]


def _votes(keys_a: I64, times_a: I64, keys_b: I64, times_b: I64) -> I64:
    """Return all differences of times of like runs that do not occur too often."""
    order_a, order_b = np.argsort(keys_a, kind="stable"), np.argsort(keys_b, kind="stable")
    known_a, first_a, count_a = np.unique(keys_a[order_a], return_index=True, return_counts=True)
    known_b, first_b, count_b = np.unique(keys_b[order_b], return_index=True, return_counts=True)
    _, in_a, in_b = np.intersect1d(known_a, known_b, assume_unique=True, return_indices=True)
    for most in (1, OFTEN):
        few = (count_a[in_a] <= most) & (count_b[in_b] <= most)
        out = []
        for i, j in zip(in_a[few].tolist(), in_b[few].tolist(), strict=True):
            a = times_a[order_a[first_a[i] : first_a[i] + count_a[i]]]
            b = times_b[order_b[first_b[j] : first_b[j] + count_b[j]]]
            out.append((b[None, :] - a[:, None]).ravel())
        votes: I64 = np.concatenate(out) if out else np.empty(0, np.int64)
        if len(votes) >= LEAST:
            return votes
    return votes
