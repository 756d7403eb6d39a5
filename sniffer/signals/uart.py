"""Edges of one wire -> bytes as a UART reads them.

A falling edge may be a start bit. Which ones are is a chain: the next one lies behind the middle of
the stop bit. Only that chain is walked, over ready-made jumps, all runs of bytes at once. The bits
of all frames are then read together, edge by edge instead of bit by bit: an edge toggles every bit
whose middle lies behind it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from sniffer.ground.model import F64, I64, U8

FRAMING: Final = 1
PARITY: Final = 2
BREAK: Final = 4

DATA_BITS: Final = 8

NEXT_MOST: Final = 24
"""So many edges behind one another are looked at before they are searched: a line that makes more
within a byte is no serial one."""

FEW_LEFT: Final = 16
"""So many runs of bytes are walked one by one: a step in columns costs as much as that."""

NO_PARITY: Final = "N"
ODD: Final = "O"


class UartBytes(NamedTuple):
    """One row a byte: its value, the tick of its start edge, what was wrong with it (bits)."""

    value: U8
    start: I64
    flags: U8

    @property
    def is_bad(self) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Whether something was wrong with each byte."""
        return np.asarray(self.flags != 0)


def _first_behind(at: I64, distance: float) -> I64:
    """Return for each of ascending times the first one further behind it than ``distance``.

    A byte has five falling edges at most, so looking at the next few is ten times faster than
    searching.
    """
    out = np.arange(1, len(at) + 1)
    for step in range(1, NEXT_MOST):
        near = at[step:] - at[:-step] <= distance
        if not near.any():
            return out
        out[: len(near)] += near
    return np.searchsorted(at, at + distance, "right")


def _chain(jump: I64, anchors: I64) -> I64:
    """Return the places that are met from the first on, when each says which one is next.

    No jump passes over an ``anchor``: it stands behind a pause. So all pauses are left at once, and
    every step is one for all of them; where few are left, each is walked by itself.
    """
    n = len(jump)
    ends = np.zeros(n + 1, bool)
    ends[anchors] = ends[n] = True
    at = np.concatenate([[0], anchors])
    met = []
    while len(at) > FEW_LEFT:
        met.append(at)
        at = jump[at]
        at = at[~ends[at]]
    rest: list[int] = []
    to = jump.tolist() if len(at) else []
    for one in at.tolist():
        place = one
        while True:
            rest.append(place)
            place = to[place]
            if ends[place]:
                break
    return np.sort(np.concatenate([*met, np.array(rest, np.int64)]))


class Receiver:
    """A UART on one wire, stretch by stretch.

    Args:
        bit: length of a bit, in ticks.
        level: of the wire before its first edge.
        invert: the line idles low.
        parity: N, E or O.
    """

    def __init__(
        self, bit: float, level: int, *, invert: bool = False, parity: str = NO_PARITY
    ) -> None:
        self._bit = bit
        self._level = level ^ int(invert)
        self._parity = parity
        self._n = 1 + DATA_BITS + (parity != NO_PARITY)  # bits before the stop bit
        self._held: I64 = np.empty(0, np.int64)
        self.horizon = 0
        """No byte that is still to come begins before this tick."""

    def take(self, edges: I64, until: int, *, stays: bool = False) -> UartBytes:
        """Return the bytes whose stop bit is known; the level is known up to ``until``.

        ``stays``: if the line idles then, it is taken to do so for as long as a byte lasts.
        """
        e = np.concatenate([self._held, edges]) if len(self._held) else edges
        if stays and self._level ^ (len(e) & 1):
            until += int((self._n + 1) * self._bit) + 1
        self.horizon = until + 1
        begin = 0 if self._level else 1  # of the first falling edge
        falls = e[begin::2]
        row, open_at = self._starts(falls, e[begin + 1 :: 2], until)
        end = len(e) if open_at is None else begin + 2 * open_at
        out = self._bytes(e[:end], begin, row)
        self._held = e[end:]
        self._level = 1 if open_at is not None else self._level ^ (len(e) & 1)
        if open_at is not None:
            self.horizon = int(falls[open_at])
        return out

    def _starts(self, falls: I64, rises: I64, until: int) -> tuple[I64, int | None]:
        """Return which falling edges begin a byte, and which one begins what is not over yet."""
        if not len(falls):
            return np.empty(0, np.int64), None
        bit, middle = self._bit, (self._n + 0.5) * self._bit
        low: F64 = np.full(len(falls), np.inf)
        low[: len(rises)] = rises - falls[: len(rises)]
        real = low > 0.5 * bit
        # behind a byte the next fall behind the middle of its stop bit; else just the next one
        behind = _first_behind(falls, middle)
        jump = np.where(real, behind, np.arange(1, len(falls) + 1))
        over = int(np.searchsorted(falls, until - middle, "right"))
        row = _chain(jump, np.flatnonzero(np.diff(falls) > middle) + 1)
        row = row[real[row]]
        open_at = int(row[-1]) if len(row) and row[-1] >= over else None
        return row[row < over], open_at

    def _bytes(self, e: I64, begin: int, row: I64) -> UartBytes:
        """Read the bytes that begin at the falling edges ``row``."""
        if not len(row):
            return UartBytes(np.empty(0, np.uint8), e[:0], np.empty(0, np.uint8))
        n = self._n
        first = begin + 2 * row
        start = e[first]
        # Bit 0 is the start bit, bit n the stop bit, all of them low until an edge says otherwise.
        owner = np.repeat(np.arange(len(row)), np.diff(np.append(first, len(e))))
        after = (e[first[0] :] - start[owner]) / self._bit
        place = np.minimum(np.ceil(after - 0.5), n + 1).astype(np.int32)
        toggle = np.left_shift(np.int32(-1), place)
        toggle[place > n] = 0
        toggle[first - first[0]] = 0
        word = np.bitwise_xor.reduceat(toggle, first - first[0])
        flags = np.where(word >> n & 1, 0, FRAMING).astype(np.uint8)
        flags[word & ((1 << n + 1) - 1) == 0] = BREAK
        if self._parity != NO_PARITY:
            ones = np.bitwise_count(word >> 1 & (1 << DATA_BITS + 1) - 1) & 1
            wrong = ones != (self._parity == ODD)
            flags[wrong & (flags != BREAK)] |= PARITY
        return UartBytes((word >> 1 & 0xFF).astype(np.uint8), start, flags)
