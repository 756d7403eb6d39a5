"""Sound frames of late: what should have stood where something is torn.

Nothing is done for sound traffic but to hold on to the last batches, and, in a stretch of frames
now and then, to remember which answers a request has had: a servo whose answers are all torn from
some time on is compared with what it said before.
"""

from __future__ import annotations

import operator
from collections import deque
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.ground.codes import REQUEST, RESPONSE

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sniffer.ground.model import I64, Batch, Frames

BEFORE: Final = 256
"""Frames before a place in which its like is looked for: some cycles of a bus."""

NEAR: Final = 20
"""Frames before a place among which whoever was asked before is looked for."""

ASKED: Final = 8
"""Requests before a place that are remembered with it."""

MOST: Final = 4
"""Sound frames that are returned for one place."""

EVERY: Final = 8192
AT_ONCE: Final = 256
"""Of every so many frames so many are looked at for answers: enough for a cycle of many servos."""

KNOWN: Final = 512
"""Requests whose answers are remembered."""


class Asking(NamedTuple):
    """A request by what makes its kind: whom it asks, and for what."""

    servo_id: int
    op: int
    address: int


class RequestBefore(NamedTuple):
    """A request: whom it asked, when it was over, its kind, and when its answer began (ns).

    ``answer_ns`` is -1 where no sound answer came.
    """

    servo_id: int
    t_ns: int
    asking: Asking
    answer_ns: int

    @property
    def is_answered(self) -> bool:
        """Whether a sound answer came."""
        return self.answer_ns >= 0


def asking_of(f: Frames, row: int) -> Asking:
    """Return whom the request in a row asks, and for what."""
    return Asking(int(f.servo_id[row]), int(f.op[row]), int(f.address[row]))


class Likes:
    """Finds sound frames that are like torn ones."""

    def __init__(self) -> None:
        self._recent: deque[Batch] = deque()
        self._seen = 0
        self._known: dict[bytes, tuple[bytes, ...]] = {}
        self.asked: dict[bytes, int] = {}
        """Whom the requests in ``known`` ask."""

    @property
    def known(self) -> Mapping[bytes, tuple[bytes, ...]]:
        """Requests that were answered, each with some of its answers, the latest first."""
        return self._known

    def add(self, batch: Batch) -> None:
        """Take the frames of a batch, once its torn places have been looked up."""
        n = len(batch.frames)
        if not n:
            return
        self._learn(batch)
        self._seen += n
        self._recent.append(batch)
        later = sum(len(b.frames) for b in self._recent)
        while later - len(self._recent[0].frames) >= BEFORE:
            later -= len(self._recent.popleft().frames)

    def _learn(self, batch: Batch) -> None:
        """Remember the answers in those frames whose turn it is."""
        n, seen = len(batch.frames), self._seen
        first = seen // EVERY * EVERY
        for begin in range(first, seen + n, EVERY):
            a, b = max(begin - seen, 0), min(begin + AT_ONCE - seen, n)
            if a < b:
                self._answers(batch, a, b)

    def _answers(self, batch: Batch, a: int, b: int) -> None:
        f = batch.frames
        kind, start, end, who = f.kind[a:b], f.start[a:b], f.end[a:b], f.servo_id[a:b]
        pairs = np.flatnonzero(
            (kind[:-1] == REQUEST)
            & (kind[1:] == RESPONSE)
            & (end[:-1] == start[1:])
            & ((who[1:] < 0) | (who[1:] == who[:-1]))
        )
        for k in pairs.tolist():
            request = batch.data[int(start[k]) : int(end[k])]
            answer = batch.data[int(start[k + 1]) : int(end[k + 1])]
            before = self._known.pop(request, ())
            if before:
                del self.asked[request]
            if len(self._known) >= KNOWN:
                first = next(iter(self._known))
                del self._known[first], self.asked[first]
            self.asked[request] = int(who[k])
            self._known[request] = (answer, *(x for x in before if x != answer))[:MOST]

    def last(self, batch: Batch | None, row: int) -> bytes:
        """Return the bytes of a row; of the last frame known where there is no batch, or row -1."""
        held, k = self._at(batch, row)
        at = int(held.frames.start[k])
        return held.data[at : at + int(held.frames.length[k])]

    def times(self, batch: Batch | None, row: int) -> tuple[int, int]:
        """Return when the frame of such a row began and ended, in ns."""
        held, k = self._at(batch, row)
        return int(held.frames.t_start[k]), int(held.frames.t_end[k])

    def _at(self, batch: Batch | None, row: int) -> tuple[Batch, int]:
        if batch is not None and row >= 0:
            return batch, row
        return self._recent[-1], -1

    def asked_before(self, batch: Batch | None, row: int) -> tuple[RequestBefore, ...]:
        """Return the last few requests up to a row, the latest first."""
        out: list[RequestBefore] = []
        behind_ns = -1
        for held, rows in self._backwards(batch, row, NEAR):
            f = held.frames
            for k, kind in zip(rows[::-1].tolist(), f.kind[rows][::-1].tolist(), strict=True):
                if kind == REQUEST:
                    asking = asking_of(f, k)
                    t_ns = int(f.t_end[k])
                    out.append(RequestBefore(asking.servo_id, t_ns, asking, behind_ns))
                    if len(out) == ASKED:
                        return tuple(out)
                behind_ns = int(f.t_start[k]) if kind == RESPONSE else -1
        return tuple(out)

    def answers(self, batch: Batch | None, row: int, asked: bytes) -> tuple[bytes, ...]:
        """Return answers to the same request before a row of a batch, the latest first.

        ``row`` is that of the request; where the batch is None it is the last frame known.
        """
        out: dict[bytes, None] = {}
        for held, rows in self._backwards(batch, row):
            f = held.frames
            same = (f.kind[rows[:-1]] == REQUEST) & (f.kind[rows[1:]] == RESPONSE)
            same &= f.length[rows[:-1]] == len(asked)
            same &= f.start[rows[:-1]] + len(asked) == f.start[rows[1:]]
            # an answer that bears another id holds by chance, or is another's
            same &= (f.servo_id[rows[1:]] < 0) | (f.servo_id[rows[1:]] == f.servo_id[rows[:-1]])
            for k in rows[:-1][same][::-1].tolist():
                at = int(f.start[k])
                if held.data[at : at + len(asked)] == asked:
                    at += len(asked)
                    out[held.data[at : at + int(f.length[k + 1])]] = None
                    if len(out) >= MOST:
                        return tuple(out)
        return tuple(out)

    def requests(self, batch: Batch | None, row: int, got: bytes) -> tuple[bytes, ...]:
        """Return requests before a row that are nearest to torn bytes, and of their length.

        What differs in more than half of the bytes is not alike.
        """
        n = len(got)
        alike: dict[bytes, int] = {}
        for held, rows in self._backwards(batch, row):
            f, said = held.frames, held.data
            mine = rows[(f.kind[rows] == REQUEST) & (f.length[rows] == n)]
            for data in dict.fromkeys([said[at : at + n] for at in f.start[mine][::-1].tolist()]):
                if data not in alike:
                    alike[data] = sum(map(operator.ne, data, got))
        near = [data for data, differ in alike.items() if differ <= n // 2]
        return tuple(sorted(near, key=lambda data: alike[data])[:MOST])

    def _backwards(
        self, batch: Batch | None, row: int, most: int = BEFORE
    ) -> list[tuple[Batch, I64]]:
        """Return the batches before a row with their rows, the latest first; so many in all."""
        out: list[tuple[Batch, I64]] = []
        left = most
        if batch is not None and row >= 0:
            a = max(row + 1 - left, 0)
            out.append((batch, np.arange(a, row + 1)))
            left -= row + 1 - a
        for held in reversed(self._recent):
            if left <= 0:
                break
            n = len(held.frames)
            out.append((held, np.arange(max(n - left, 0), n)))
            left -= min(n, left)
        return out
