"""Message records that wait, and are put in order when they are written."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.mcapfile.encoder import LOG_AT, U16, Loose, MessageRows

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.ground.model import I64

CHUNK: Final = 1 << 20
"""A chunk's messages, in bytes: larger ones compress no better, smaller ones worse."""


@dataclass(frozen=True, slots=True)
class Sorted:
    """Message records side by side in ``data``, in the order of their log times."""

    data: memoryview
    log: I64
    channel: U16
    start: I64
    end: I64

    def pieces(self, size: int = CHUNK) -> Iterator[Sorted]:
        """Yield it in pieces of about ``size`` bytes."""
        a, n = 0, len(self.log)
        while a < n:
            begin = int(self.start[a])
            b = max(a + 1, int(np.searchsorted(self.end, begin + size, "right")))
            rows = slice(a, b)
            yield Sorted(
                self.data[begin : int(self.end[b - 1])],
                self.log[rows],
                self.channel[rows],
                self.start[rows] - begin,
                self.end[rows] - begin,
            )
            a = b


class Queue:
    """Message records that wait to be put in order."""

    def __init__(self) -> None:
        self._parts: list[MessageRows | Loose] = []
        self._ranks = 0
        self.size = 0

    def ranks(self, n: int) -> I64:
        """Return the ranks of the next ``n`` records: of one time, the first to come is first."""
        self._ranks += n
        return np.arange(self._ranks - n, self._ranks)

    def add(self, *parts: MessageRows | Loose) -> None:
        """Take records."""
        for part in parts:
            self._parts.append(part)
            self.size += int(part.widths.sum())

    def take(self, until: int | None, floor: int) -> Sorted | None:
        """Return what is not later than ``until`` (None: all), no log time below ``floor``."""
        parts = self._parts
        self._parts, self.size = [], 0
        if until is not None:
            masks = [part.heads.log <= until for part in parts]
            self.add(*(p.take(~m) for p, m in zip(parts, masks, strict=True) if not m.all()))
            parts = [p.take(m) for p, m in zip(parts, masks, strict=True) if m.any()]
        if not parts:
            return None
        log = np.concatenate([p.heads.log for p in parts])
        channel = np.concatenate([p.heads.channel for p in parts])
        widths = np.concatenate([p.widths for p in parts])
        order = np.lexsort((np.concatenate([p.heads.rank for p in parts]), log))
        log, channel, widths = np.maximum(log[order], floor), channel[order], widths[order]
        end = np.cumsum(widths)
        start = end - widths
        at = np.empty(len(order), np.int64)
        at[order] = start
        out = bytearray(int(end[-1]))
        begin = 0
        for part in parts:
            n = len(part.data)
            part.place(out, at[begin : begin + n])
            begin += n
        np.ndarray((len(out) - LOG_AT - 7,), "<i8", out, LOG_AT, (1,))[start] = log
        return Sorted(memoryview(out), log, channel, start, end)
