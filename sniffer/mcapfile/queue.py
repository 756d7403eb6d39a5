"""Message records that wait, and are put in order when they are written."""

from __future__ import annotations

import operator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.mcapfile.rows import LOG_AT, U16, Loose, MessageRows
from sniffer.messages import TOPICS

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Sequence

    from sniffer.ground.model import I64, Mask

CHUNK: Final = 1 << 20
"""A chunk's messages, in bytes: larger ones compress no better, smaller ones worse."""


@dataclass(frozen=True, slots=True)
class Sorted:
    """Message records side by side in ``data``, in the order of their log times.

    ``listed``: whether an index names it.
    """

    data: memoryview
    log: I64
    channel: U16
    start: I64
    end: I64
    listed: Mask

    @classmethod
    def of(cls, rows: list[tuple[int, int, bytes]]) -> Sorted:
        """Return records that come with their log times and channels."""
        rows.sort(key=operator.itemgetter(0))
        log, channel, records = zip(*rows, strict=True)
        widths = np.fromiter(map(len, records), np.int64, len(records))
        end = np.cumsum(widths)
        ids = np.array(channel, np.uint16)
        data, listed = memoryview(b"".join(records)), np.ones(len(records), bool)
        return cls(data, np.array(log, np.int64), ids, end - widths, end, listed)

    def only(self, rows: Mask) -> Sorted | None:
        """Return some of the records, None where there are none."""
        if rows.all():
            return self
        if not rows.any():
            return None
        spans = zip(self.start[rows].tolist(), self.end[rows].tolist(), strict=True)
        data = b"".join([self.data[a:b] for a, b in spans])
        widths = self.end[rows] - self.start[rows]
        end = np.cumsum(widths)
        log, channel, listed = self.log[rows], self.channel[rows], self.listed[rows]
        return Sorted(memoryview(data), log, channel, end - widths, end, listed)

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
                self.listed[rows],
            )
            a = b


@dataclass(frozen=True, slots=True)
class Unsorted:
    """Message records that were taken out of a queue; nothing changes them any more."""

    parts: Sequence[MessageRows | Loose]

    @property
    def last(self) -> int:
        """The latest log time."""
        return max(int(part.heads.log.max()) for part in self.parts)

    @property
    def size(self) -> int:
        """Bytes of the records."""
        return sum(int(part.widths.sum()) for part in self.parts)

    def sorted(self, floor: int) -> Sorted:
        """Return them in the order of their log times, none of which is below ``floor``."""
        parts = self.parts
        log = np.concatenate([p.heads.log for p in parts])
        channel = np.concatenate([p.heads.channel for p in parts])
        widths = np.concatenate([p.widths for p in parts])
        order = np.lexsort((np.concatenate([p.heads.rank for p in parts]), log))
        where = np.empty(len(order), np.int64)
        where[order] = np.arange(len(order))
        log, listed = np.maximum(log[order], floor), np.ones(len(order), bool)
        return _laid(parts, where, log, channel[order], widths[order], listed)


@dataclass(frozen=True, slots=True)
class _Lot:
    """Records that were queued together; their ranks are the ``count`` ones from ``first`` on.

    ``listed`` has one entry a rank, None: an index names all of them.
    """

    topic: str
    parts: tuple[MessageRows | Loose, ...]
    first: int
    count: int
    listed: Mask | None


class Queue:
    """Message records that wait to be written, in the order of their log times or as they came.

    Args:
        topics: what is taken, by the last part of a topic's name; None: what is usual.
    """

    def __init__(self, topics: Collection[str] | None = None) -> None:
        self._lots: list[_Lot] = []
        self._topics = TOPICS if topics is None else topics
        self._ranks = 0
        self.size = 0

    def wants(self, topic: str) -> bool:
        """Tell whether records of a topic are taken: others need not be encoded."""
        return topic in self._topics

    def ranks(self, n: int) -> I64:
        """Return the ranks of the next ``n`` records: of one time, the first to come is first."""
        self._ranks += n
        return np.arange(self._ranks - n, self._ranks)

    def add(self, topic: str, *parts: MessageRows | Loose, listed: Mask | None = None) -> None:
        """Take records of one bus and topic; all that ``ranks`` returned in one call together.

        ``listed``: which of them, by rank, the index of a live recording names, None: all.
        """
        if parts:
            count = sum(len(part.heads.rank) for part in parts)
            first = min(int(part.heads.rank.min()) for part in parts)
            self._lots.append(_Lot(topic, parts, first, count, listed))
            self.size += sum(int(part.widths.sum()) for part in parts)

    def take(self, until: int | None) -> Unsorted | None:
        """Return what is not later than ``until``, None: all; None where there is nothing."""
        lots, self._lots, self.size = self._lots, [], 0
        if until is not None:
            for lot in lots:
                masks = [part.heads.log > until for part in lot.parts]
                later = zip(lot.parts, masks, strict=True)
                self.add(lot.topic, *(p.take(mask) for p, mask in later if mask.any()))
        parts = [part for lot in lots for part in lot.parts]
        if until is not None:
            masks = [part.heads.log <= until for part in parts]
            now = zip(parts, masks, strict=True)
            parts = [p if mask.all() else p.take(mask) for p, mask in now if mask.any()]
        return Unsorted(parts) if parts else None

    def lots(self, topics: Sequence[str]) -> Sorted | None:
        """Return what waits of some topics, lot by lot, nothing sorted: each is in order in itself.

        Records of one kind side by side are also what packs best.
        """
        mine = sorted((x for x in self._lots if x.topic in topics), key=lambda x: x.topic)
        if not mine:
            return None
        self._lots = [lot for lot in self._lots if lot.topic not in topics]
        begin = np.cumsum([lot.count for lot in mine]) - [lot.count for lot in mine]
        total = sum(lot.count for lot in mine)
        log, channel = np.empty(total, np.int64), np.empty(total, np.uint16)
        widths, listed = np.empty(total, np.int64), np.ones(total, bool)
        parts: list[MessageRows | Loose] = []
        places: list[I64] = []
        for lot, at in zip(mine, begin.tolist(), strict=True):
            if lot.listed is not None:
                listed[at : at + lot.count] = lot.listed
            for part in lot.parts:
                place = part.heads.rank + (at - lot.first)
                log[place], channel[place] = part.heads.log, part.heads.channel
                widths[place] = part.widths
                self.size -= int(part.widths.sum())
                parts.append(part)
                places.append(place)
        return _laid(parts, np.concatenate(places), log, channel, widths, listed)


def _laid(
    parts: Sequence[MessageRows | Loose],
    where: I64,
    log: I64,
    channel: U16,
    widths: I64,
    listed: Mask,
) -> Sorted:
    """Write records side by side: row n of all parts joined goes to place ``where[n]``.

    ``log`` and all behind it are by place.
    """
    end = np.cumsum(widths)
    start = end - widths
    at = start[where]
    out = np.empty(int(end[-1]), np.uint8).data  # not zeroed: every byte is written
    begin = 0
    for part in parts:
        n = len(part.data)
        part.place(out, at[begin : begin + n])
        begin += n
    np.ndarray((len(out) - LOG_AT - 7,), "<i8", out, LOG_AT, (1,))[start] = log
    return Sorted(out, log, channel, start, end, listed)
