"""CRC-16 of frames of any length, for one frame and for all frames of a block at once.

Two ways in columns, with the same result:

- *By steps*: the n-th byte of all frames at once, so as many steps as the longest frame has bytes.
  Each byte of each frame is looked at. Frames that hold do not overlap, but candidates may: in a
  block of nothing but headers the sum of their lengths grows with the square of the block.
- *By prefixes*: the CRC of the block up to each byte, a table look-up a byte however candidates
  overlap. A CRC with seed 0 is linear, so that of ``a..b`` is prefix(b) XOR prefix(a) with b - a
  zero bytes appended.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.model import I64, U8, Mask

U16 = npt.NDArray[np.uint16]

CHUNK: Final = 256
"""Bytes that prefixes are computed along, one step a byte for all chunks of the block."""

OVERLAP: Final = 2
"""By steps while candidates sum up to this many times the block."""


class Crc16:
    """A CRC of 16 bits: high bit first, seed 0, sent low byte first; see ``checksums.Sum``."""

    def __init__(self, polynomial: int) -> None:
        self.formula = f"CRC-16 (polynomial {polynomial:04X}, seed 0, low byte first)"
        table: U16 = (np.arange(256) << 8).astype(np.uint16)
        for _ in range(8):
            high = table & 0x8000 > 0
            table = (table << np.uint16(1)) ^ (high * np.uint16(polynomial)).astype(np.uint16)
        self._table: U16 = table
        self._plain: list[int] = table.tolist()
        # What appending 2**k zero bytes makes of a CRC, by its high and by its low byte.
        self._zeros = [(table, np.arange(256, dtype=np.uint16) << 8)]

    def __call__(self, data: bytes) -> int:
        """Return the CRC of ``data``."""
        crc = 0
        for byte in data:
            crc = (crc << 8 & 0xFFFF) ^ self._plain[crc >> 8 ^ byte]
        return crc

    def good(self, block: U8, first: I64, at: I64) -> Mask:
        """Tell where the CRC of ``block[first:at]`` stands at ``at``, low byte first."""
        if not len(first):
            return np.zeros(0, bool)
        want = self._of(block, first, at)
        got = block[at].astype(np.uint16) | block[at + 1].astype(np.uint16) << 8
        return np.asarray(want == got)

    def over(self, block: U8, spans: Sequence[tuple[I64, I64]]) -> U16:
        """Return the CRCs of packets, each of the stretches ``block[first:last]`` in order."""
        out = np.zeros(len(spans[0][0]), np.uint16)
        for first, last in spans if len(out) else ():
            out = self._appended(out, last - first) ^ self._of(block, first, last)
        return out

    def _of(self, block: U8, first: I64, at: I64) -> U16:
        """Return the CRCs of ``block[first:at]``."""
        if int((at - first).sum()) <= OVERLAP * len(block):
            return self._by_steps(block, first, at)
        run = self._prefixes(block)
        return run[at] ^ self._appended(run[first], at - first)

    def _by_steps(self, block: U8, first: I64, at: I64) -> U16:
        """Take the longest frames first: those that still have a byte are the first rows."""
        length = at - first
        order = np.argsort(-length, kind="stable")
        start, size = first[order], length[order]
        crc = np.zeros(len(first), np.uint16)
        alive = np.searchsorted(-size, -np.arange(int(size[0])), "left")
        for k, m in enumerate(alive.tolist()):
            c = crc[:m]
            crc[:m] = (c << 8) ^ self._table[(c >> 8).astype(np.uint8) ^ block[start[:m] + k]]
        out = np.empty_like(crc)
        out[order] = crc
        return out

    def _prefixes(self, block: U8) -> U16:
        """Return the CRC of the first ``k`` bytes for each ``k``.

        The block is laid in rows of ``CHUNK`` bytes; all rows are computed side by side, as if each
        began anew, then what stands before a row is carried in.
        """
        n = len(block)
        rows = -(-n // CHUNK)
        padded = np.zeros(rows * CHUNK, np.uint8)
        padded[:n] = block
        columns = np.ascontiguousarray(padded.reshape(rows, CHUNK).T)
        out = np.empty((CHUNK, rows), np.uint16)
        crc = np.zeros(rows, np.uint16)
        for k in range(CHUNK):
            crc = (crc << 8) ^ self._table[(crc >> 8).astype(np.uint8) ^ columns[k]]
            out[k] = crc
        carry, step = out[-1].copy(), 1
        while step < rows:  # after the n-th round each holds its last 2**n rows
            far = np.full(rows - step, step * CHUNK)
            carry[step:] ^= self._appended(carry[:-step], far)
            step *= 2
        before = np.concatenate([np.zeros(1, np.uint16), carry[:-1]])
        for k in range(CHUNK):
            before = (before << 8) ^ self._table[before >> 8]
            out[k] ^= before
        return np.concatenate([np.zeros(1, np.uint16), out.T.ravel()[:n]])

    def _appended(self, crc: U16, zeros: I64) -> U16:
        """Return the CRCs with so many zero bytes appended to what each covers."""
        k, most = 0, int(zeros.max(initial=0))
        while most >> k:
            if k == len(self._zeros):
                high, low = self._zeros[-1]
                twice = [high[half >> 8] ^ low[half & 255] for half in (high, low)]
                self._zeros.append((twice[0], twice[1]))
            high, low = self._zeros[k]
            crc = np.where(zeros >> k & 1, high[crc >> 8] ^ low[crc & 255], crc)
            k += 1
        return crc
