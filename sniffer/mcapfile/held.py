"""What is held between calls: arrival times, the counts of a second."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.distinct import distinct
from sniffer.ground.model import NS
from sniffer.messages.recording_pb2 import Stats

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from sniffer.ground.model import I64, Mask

FRAMES, GAPS, ANOMALIES = 1, 2, 3
_NAMES: Final = ("bytes", "frames", "gaps", "anomalies")


MOST: Final = 1 << 17
"""Chunks whose arrival is remembered: nobody may ever decode what a bus says."""


LATE: Final = 1 << 12
"""Chunks that may wait to become columns."""


class Arrivals:
    """When each byte of the stream arrived, as long as no batch has accounted for it.

    Args:
        start: offset of the first byte.
    """

    def __init__(self, start: int = 0) -> None:
        self._start = start
        self._end = np.empty(0, np.int64)
        self._log = np.empty(0, np.int64)
        self._timed = np.empty(0, bool)
        self._late: list[tuple[int, int, bool]] = []  # not among these yet

    def add(self, end: I64, log: I64, timed: npt.NDArray[np.bool_]) -> None:
        """Take chunks: the offset behind each, its log time, and whether it came with a clock."""
        self._add_late()
        self._put(end, log, timed)

    def note(self, chunks: Sequence[tuple[int, int, bool]]) -> None:
        """Take the same of a few chunks at a time: they become columns when somebody asks."""
        self._late += chunks
        if len(self._late) > LATE:
            self._add_late()

    def _add_late(self) -> None:
        if self._late:
            rows, self._late = np.array(self._late, np.int64), []
            self._put(rows[:, 0], rows[:, 1], rows[:, 2] != 0)

    def _put(self, end: I64, log: I64, timed: npt.NDArray[np.bool_]) -> None:
        self._end = np.concatenate([self._end, end])
        self._log = np.concatenate([self._log, log])
        self._timed = np.concatenate([self._timed, timed])
        if len(self._end) > MOST:
            self.forget(int(self._end[-MOST // 2]))

    def of(self, end: I64, otherwise: I64) -> I64:
        """Return when the byte before each offset arrived, ``otherwise`` where nothing tells."""
        self._add_late()
        if not len(self._end):
            return otherwise
        k, known = self._chunk(end)
        return np.where(known, self._log[k], otherwise)

    def read(self, end: I64) -> I64:
        """Return the offset behind the chunk that the byte before each offset came in.

        -1 where nobody knows, or it came without a clock.
        """
        self._add_late()
        if not len(self._end):
            return np.full(len(end), -1)
        k, known = self._chunk(end)
        return np.where(known, self._end[k], -1)

    def _chunk(self, end: I64) -> tuple[I64, Mask]:
        """Return the place of the chunk that a byte came in, and whether it tells when."""
        k = np.minimum(np.searchsorted(self._end, end, "left"), len(self._end) - 1)
        return k, self._timed[k] & (end <= self._end[-1]) & (end > self._start)

    def forget(self, offset: int) -> None:
        """Drop what lies before ``offset``."""
        self._add_late()
        keep = int(np.searchsorted(self._end, offset, "right"))
        if keep:
            self._start = int(self._end[keep - 1])
        self._end, self._log = self._end[keep:], self._log[keep:]
        self._timed = self._timed[keep:]


class Seconds:
    """Counts by the second, as rows of the statistics."""

    def __init__(self) -> None:
        self._open: dict[int, list[int]] = {}
        self._last: int | None = None

    def count(self, column: int, times: I64, lengths: I64 | None = None) -> None:
        """Count records of one kind, and their bytes.

        What is known late of a second that is written counts in the oldest that is not: an answer
        that never came is missed when no more may come.
        """
        if not len(times):
            return
        if self._last is not None:
            behind = self._last + 1
            oldest = min(self._open, default=behind)
            times = np.where(times < behind * NS, oldest * NS, times)
        seconds, which, counts = distinct(times // NS)
        size = np.bincount(which, lengths) if lengths is not None else np.zeros(len(seconds))
        for second, n, b in zip(seconds.tolist(), counts.tolist(), size.tolist(), strict=True):
            row = self._open.setdefault(second, [0, 0, 0, 0])
            row[0] += int(b)
            row[column] += n

    def over(self, *, final: bool) -> list[Stats]:
        """Return the seconds that are over; of a silence only its first and its last."""
        out: list[Stats] = []
        now = max(self._open, default=0)
        for second in sorted(self._open):
            if second == now and not final:
                break
            last = self._last
            if last is not None and second > last + 1:
                out += [Stats(t_ns=s * NS) for s in sorted({last + 1, second - 1})]
            row = zip(_NAMES, self._open.pop(second), strict=True)
            out.append(Stats(t_ns=second * NS, **dict(row)))
            self._last = second
        return out
