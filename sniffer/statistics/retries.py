"""Requests that were said again because the one before them failed."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.ground.codes import DAMAGED, MISMATCHED, NO_RESPONSE, REQUEST
from sniffer.ground.model import ECHO

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sniffer.ground.model import I64, Batch, Mask

FAILED: Final = (NO_RESPONSE, MISMATCHED, DAMAGED)
"""Outcomes after which a controller asks again."""

OPEN: Final = 256
"""Requests that wait for their outcome, the latest ones: no bus has more under way."""


class Retries:
    """Counts requests with the same bytes as the one before them to the same servo, which failed.

    A write of another value behind a failure is a new order, and no retry. Of a selection those
    that are selected are counted, whatever stands before them.
    """

    def __init__(self) -> None:
        self.counts: Counter[tuple[int, int]] = Counter()
        """By servo and command."""
        self._failed: dict[int, tuple[int, bytes]] = {}
        self._open: dict[int, bytes] = {}

    def add(self, batch: Batch) -> None:
        """Take the exchanges of a batch in the order in which they end."""
        f, t = batch.frames, batch.transactions
        rows = np.flatnonzero(t.request != -1)
        failed = np.isin(t.outcome[rows], FAILED)
        if failed.any() or self._failed:
            asked, which = batch.asking(t.request[rows])
            answer = t.response[rows]
            place = np.where(answer >= 0, f.start[np.maximum(answer, 0)], asked.start[which])
            servo = asked.servo_id[which].astype(np.int64)
            order = np.lexsort((place, servo))  # of one servo side by side, as they end
            shown = batch.shows("transactions", len(t))[rows[order]]
            said = _Said(batch, asked.start, asked.length, which[order], self._open)
            self._count(said, servo[order], asked.op[which[order]], failed[order], shown)
        self._remember(batch)

    def _count(self, said: _Said, servo: I64, op: I64, failed: Mask, shown: Mask) -> None:
        """Look at those that come behind one that failed; others are no retries."""
        if not len(servo):
            return
        begins = np.append(True, servo[1:] != servo[:-1])
        behind = np.append(False, failed[:-1]) & ~begins & shown
        for k in np.flatnonzero(behind).tolist():
            if _is_again(said.of(k - 1), said.of(k)):
                self.counts[servo.item(k), op.item(k)] += 1
        ends = np.append(np.flatnonzero(begins)[1:], len(servo)) - 1
        for first, last in zip(np.flatnonzero(begins).tolist(), ends.tolist(), strict=True):
            who = servo.item(first)
            before = self._failed.pop(who, None)
            if before is not None and shown[first] and _is_again(before, said.of(first)):
                self.counts[who, op.item(first)] += 1
            if failed[last]:
                self._failed[who] = said.of(last)

    def _remember(self, batch: Batch) -> None:
        """Keep the bytes of requests that are answered in a later batch."""
        f = batch.frames
        told = np.zeros(len(f), bool)
        mine = batch.rows_of(batch.transactions.request)
        told[mine[mine >= 0]] = True
        for row in np.flatnonzero((f.kind == REQUEST) & (f.flags & ECHO == 0) & ~told).tolist():
            start, length = int(f.start[row]), int(f.length[row])
            self._open[batch.base + start] = batch.data[start : start + length]
        for start in list(self._open)[:-OPEN]:
            del self._open[start]


def _is_again(before: tuple[int, bytes], now: tuple[int, bytes]) -> bool:
    """Tell whether a request repeats the one before; one that was answered twice is no other."""
    return before[0] != now[0] and before[1] == now[1]


class _Said(NamedTuple):
    """The requests of exchanges: those of this batch, and of earlier ones that were open."""

    batch: Batch
    start: I64
    length: I64
    which: I64
    open: Mapping[int, bytes]

    def of(self, k: int) -> tuple[int, bytes]:
        """Return where in the stream the request of an exchange stands, and its bytes."""
        row = self.which.item(k)
        start, length = self.start.item(row), self.length.item(row)
        at = self.batch.base + start
        if start < 0:
            return at, self.open.get(at, b"")
        return at, self.batch.data[start : start + length]
