"""Bytes that no frame claims, run by run: the first ones, to be read in another way."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.ground.gaps import Gaps

if TYPE_CHECKING:
    from sniffer.ground.model import Batch

KEPT: Final = 1 << 15
"""Bytes kept: some thousand frames of any protocol."""


class UnclaimedRun(NamedTuple):
    """Bytes in a row; ``at`` is absolute, ``t_ns`` when the last of them came."""

    at: int
    t_ns: int
    data: bytes


class Unclaimed:
    """Keeps runs batch after batch; gaps that touch are one."""

    def __init__(self) -> None:
        self.runs: list[UnclaimedRun] = []
        self._size = 0

    def add(self, batch: Batch) -> None:
        """Take the gaps of a batch."""
        if not len(batch.gaps) or self._size >= KEPT:
            return
        gaps = Gaps.of(batch.gaps)
        start, length, t_ns = gaps.start.tolist(), gaps.length.tolist(), gaps.t_ns.tolist()
        for a, n, t in zip(start, length, t_ns, strict=True):
            left = KEPT - self._size
            if left <= 0:
                return
            data = batch.data[a : a + min(n, left)]
            self._size += len(data)
            last = self.runs[-1] if self.runs else None
            if last is not None and last.at + len(last.data) == a + batch.base:
                self.runs[-1] = UnclaimedRun(last.at, t, last.data + data)
            else:
                self.runs.append(UnclaimedRun(a + batch.base, t, data))

    @property
    def size(self) -> int:
        """How many bytes are kept."""
        return self._size


def first_low(data: bytes) -> list[int]:
    """Return how long the line was low at the beginning of each byte, in bits of the receiver.

    That is the start bit and the zeros behind it: 1 for a byte whose first bit is set. Bytes
    of nothing but zeros are left out: nobody knows where they end.
    """
    values = np.frombuffer(data, np.uint8)
    values = values[values != 0].astype(np.int64)
    lowest = values & -values
    return (np.log2(lowest).astype(np.int64) + 1).tolist() if len(values) else []
