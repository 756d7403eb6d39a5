"""Named checksums: one scalar form (grammars, explanations) and one on columns (block framing)."""

from __future__ import annotations

import functools
import operator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sniffer.ground.model import I64, U8, Mask

    Folds = np.ndarray[Any, np.dtype[np.unsignedinteger[Any]]]


MANY: Final = 1 << 9
"""So many stretches are worth being told apart by their lengths."""

SHORT: Final = 4
"""Bytes up to which it is quicker to fold them byte by byte, all stretches of a length at once: to
look for the edges of one costs as much as some eight bytes do."""


class Sum(Protocol):
    """A checksum as grammars, framing and explanations use it.

    One that may stand elsewhere than right behind what it covers, or with its high byte first, has
    ``over(block, spans)``, too: the checksums of what the stretches ``block[first:last]`` of each
    packet are, put together. One that says its ``width`` in bytes is refused in another field.
    """

    @property
    def formula(self) -> str:
        """Say it to a person."""
        ...

    def __call__(self, data: bytes) -> int:
        """Return the checksum of ``data``."""
        ...

    def good(self, block: U8, first: I64, at: I64) -> Mask:
        """Tell where the checksum of ``block[first:at]`` stands at ``at``."""
        ...


@dataclass(frozen=True, slots=True)
class Checksum:
    """Fold all bytes by ``fold``, then ``seal`` the result; ``formula`` says it to a person.

    ``plain`` folds the few bytes of one frame: numpy takes longer to start than that takes. Of two
    bytes (``width``) a field says which one is the first.
    """

    formula: str
    plain: Callable[[bytes], int]
    fold: np.ufunc
    undo: np.ufunc
    seal: Callable[[Any], Any]
    width: int = 1

    @property
    def _kind(self) -> type[np.uint8 | np.uint16]:
        return np.uint8 if self.width == 1 else np.uint16

    def __call__(self, data: bytes) -> int:
        """Return the checksum of ``data``."""
        return int(self.seal(self.plain(data) & (1 << 8 * self.width) - 1))

    def good(self, block: U8, first: I64, at: I64) -> Mask:
        """Tell where the sum of ``block[first:at]`` stands at ``at``, the low byte first."""
        got: Folds = block[at]
        if self.width > 1:
            got = got | block[at + 1].astype(np.uint16) << np.uint16(8)
        return np.asarray(self.seal(self._folded(block, first, at)) == got)

    def over(self, block: U8, spans: Sequence[tuple[I64, I64]]) -> Folds:
        """Return the checksums of packets, each of the stretches ``block[first:last]`` in order."""
        parts = [self._folded(block, first, last) for first, last in spans]
        return np.asarray(self.seal(functools.reduce(self.fold, parts)))

    def _folded(self, block: U8, first: I64, last: I64) -> Folds:
        """Fold one stretch of each packet; an empty one folds to zero."""
        kind = self._kind
        if not len(first):
            return np.zeros(0, kind)
        length = last - first
        if int(length.sum()) > len(block):
            # Where candidates overlap time and again, one running sum is less than all of theirs.
            run = np.append(kind(0), self.fold.accumulate(block, dtype=kind))
            return np.asarray(self.undo(run[last], run[first]))
        if len(first) < MANY or int(length.min()) > SHORT:
            return self._by_edges(block, first, last)
        out = np.zeros(len(first), kind)
        times = np.bincount(length)
        for size in np.flatnonzero(times[1 : SHORT + 1]).tolist():
            rows = np.flatnonzero(length == size + 1)
            at = first.take(rows)
            parts = [block.take(at + k) for k in range(size + 1)]
            out[rows] = self.fold.reduce(parts, dtype=kind)
        if times[SHORT + 1 :].any():
            rows = np.flatnonzero(length > SHORT)
            out[rows] = self._by_edges(block, first.take(rows), last.take(rows))
        return out

    def _by_edges(self, block: U8, first: I64, last: I64) -> Folds:
        if last.max() == len(block):  # a packet may end where the block does: there is no byte
            block = np.append(block, np.uint8(0))
        # Edges in turn: every other stretch is one of ours, the rest lies between two of them.
        edges = np.empty(2 * len(first), np.int64)
        edges[::2], edges[1::2] = first, last
        out: Folds = self.fold.reduceat(block, edges, dtype=self._kind)[::2]
        length = last - first
        return out if length.min() > 0 else np.where(length > 0, out, self._kind(0))


def _xor(data: bytes) -> int:
    return functools.reduce(operator.xor, data, 0)


COMPLEMENT_SUM: Final = Checksum(
    "~(sum of the bytes) & 0xFF", sum, np.add, np.subtract, lambda s: ~s & 0xFF
)
"""mightyZAP. Source: user manual v1.02, (2) Packet Description, Check Sum."""

XOR7: Final = Checksum(
    "XOR of the bytes & 0x7F", _xor, np.bitwise_xor, np.bitwise_xor, lambda s: s & 0x7F
)
"""wCK. Source: user manual 1.07, command tables, CHECKSUM rows."""

XOR8: Final = Checksum("XOR of the bytes", _xor, np.bitwise_xor, np.bitwise_xor, lambda s: s)
"""RS30x. Source: RS305CR manual, packet format, Sum."""

XOR_EVEN: Final = Checksum(
    "XOR of the bytes & 0xFE", _xor, np.bitwise_xor, np.bitwise_xor, lambda s: s & 0xFE
)
"""Checksum 1 of HerkuleX. Source: DRS-0101 user manual, 6-1, CHECKSUM1 formula."""

COMPLEMENT_EVEN: Final = Checksum(
    "~(XOR of the bytes) & 0xFE", _xor, np.bitwise_xor, np.bitwise_xor, lambda s: ~s & 0xFE
)
"""Checksum 2 of HerkuleX, of its checksum 1. Source: as above, and its examples."""

SUM8: Final = Checksum("sum of the bytes & 0xFF", sum, np.add, np.subtract, lambda s: s)
"""Of many: UBTech's and others'."""

SUM16: Final = Checksum("sum of the bytes & 0xFFFF", sum, np.add, np.subtract, lambda s: s, width=2)
"""The same in two bytes."""
