"""CRCs of frames of any length, for one frame and for all frames of a block at once.

Two ways in columns, with the same result:

- *By steps*: the n-th byte of all frames at once, so as many steps as the longest frame has bytes.
  Each byte of each frame is looked at. Frames that hold do not overlap, but candidates may: in a
  block of nothing but headers the sum of their lengths grows with the square of the block.
- *By prefixes*: the CRC of the block up to each byte, a table look-up a byte however candidates
  overlap. A CRC with seed 0 is linear, so that of ``a..b`` is prefix(b) XOR prefix(a) with b - a
  zero bytes appended.

Both run in 16 bits, the high bit first, from zero. Every other kind is one of these, dressed::

    seed         the seed with as many zero bytes appended as there are, XORed: linear, as above
    reflected    each byte turned round before, the result after
    eight bits   the polynomial in the high byte: the low one stays zero
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.model import I64, U8, U16, Mask

CHUNK: Final = 256
"""Bytes that prefixes are computed along, one step a byte for all chunks of the block."""

OVERLAP: Final = 2
"""By steps while candidates sum up to this many times the block."""


TURNED: Final[U8] = np.packbits(
    np.unpackbits(np.arange(256, dtype=np.uint8)[:, None], axis=1)[:, ::-1], axis=1
).ravel()
"""Each byte with its bits the other way round."""


class Crc16:
    """A CRC of 16 bits; see ``checksums.Sum``. Which byte of it comes first, its field says.

    Args:
        polynomial: without its highest bit, as manuals print it: 0x1021, 0x8005.
        seed: what it begins with: 0, or FFFF as Modbus has it; the high bit first, always.
        reflected: the low bit of each byte comes first, also in the result.
        out: what the result is XORed with.
    """

    bits: ClassVar[int] = 16

    def __init__(
        self, polynomial: int, seed: int = 0, *, reflected: bool = False, out: int = 0
    ) -> None:
        digits = self.bits // 4
        kind = f"polynomial {polynomial:0{digits}X}, seed {seed:X}"
        kind += ", reflected" * reflected + (f", XOR {out:X}" if out else "")
        self.formula = f"CRC-{self.bits} ({kind})"
        self._is_reflected, self._out = reflected, out
        self._shift = 16 - self.bits
        self._seed = seed << self._shift
        table: U16 = (np.arange(256) << 8).astype(np.uint16)
        for _ in range(8):
            high = table & 0x8000 > 0
            table = (table << np.uint16(1)) ^ (high * np.uint16(polynomial << self._shift)).astype(
                np.uint16
            )
        self._table: U16 = table
        self._plain: list[int] = table.tolist()
        # What appending 2**k zero bytes makes of a CRC, by its high and by its low byte.
        self._zeros = [(table, np.arange(256, dtype=np.uint16) << 8)]

    @property
    def width(self) -> int:
        """Bytes of it."""
        return self.bits // 8

    def __call__(self, data: bytes) -> int:
        """Return the CRC of ``data``."""
        crc = self._seed
        for byte in data.translate(TURNED.tobytes()) if self._is_reflected else data:
            crc = (crc << 8 & 0xFFFF) ^ self._plain[crc >> 8 ^ byte]
        return (_turned(crc) if self._is_reflected else crc >> self._shift) ^ self._out

    def good(self, block: U8, first: I64, at: I64) -> Mask:
        """Tell where the CRC of ``block[first:at]`` stands at ``at``, the low byte first."""
        if not len(first):
            return np.zeros(0, bool)
        got = block[at].astype(np.uint16)
        if self.width > 1:
            got |= block[at + 1].astype(np.uint16) << 8
        return np.asarray(self.over(block, [(first, at)]) == got)

    def over(self, block: U8, spans: Sequence[tuple[I64, I64]]) -> U16:
        """Return the CRCs of packets, each of the stretches ``block[first:last]`` in order."""
        if self._is_reflected:
            block = TURNED[block]
        out = np.full(len(spans[0][0]), self._seed, np.uint16)
        for k, (first, last) in enumerate(spans if len(out) else ()):
            mine = self._of(block, first, last)
            # Nothing was there before the first one, and zeros behind nothing are nothing.
            out = mine ^ self._appended(out, last - first) if k or self._seed else mine
        if self._is_reflected:
            out = TURNED[out >> 8].astype(np.uint16) | TURNED[out & 0xFF].astype(np.uint16) << 8
        else:
            out >>= np.uint16(self._shift)
        return out ^ np.uint16(self._out)

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


class Crc8(Crc16):
    """A CRC of 8 bits: 0x07 of many, 0x31 reflected as Maxim has it."""

    bits: ClassVar[int] = 8


def _turned(number: int) -> int:
    """Return 16 bits the other way round."""
    return int(TURNED[number >> 8]) | int(TURNED[number & 0xFF]) << 8
