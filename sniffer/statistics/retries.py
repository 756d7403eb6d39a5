"""Requests that were said again because the one before them failed."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.codes import DAMAGED, MISMATCHED, NO_RESPONSE, REQUEST
from sniffer.ground.model import ECHO

if TYPE_CHECKING:
    from sniffer.ground.model import Batch

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
            shown = batch.shows("transactions", len(t))[rows]
            answer = t.response[rows]
            place = np.where(answer >= 0, f.start[np.maximum(answer, 0)], asked.start[which])
            for k in np.argsort(place, kind="stable").tolist():
                row = int(which[k])
                start, end = int(asked.start[row]), int(asked.end[row])
                at = batch.base + start
                said = self._open.get(at, b"") if start < 0 else batch.data[start:end]
                servo = int(asked.servo_id[row])
                if self._is_again(servo, at, said, failed[k]) and shown[k]:
                    self.counts[servo, int(asked.op[row])] += 1
        self._remember(batch)

    def _is_again(self, servo: int, at: int, said: bytes, failed: bool) -> bool:
        before = self._failed.pop(servo, None)
        if failed:
            self._failed[servo] = at, said
        return before is not None and before[0] != at and before[1] == said

    def _remember(self, batch: Batch) -> None:
        """Keep the bytes of requests that are answered in a later batch."""
        f = batch.frames
        told = np.zeros(len(f), bool)
        mine = batch.transactions.request
        told[mine[mine >= 0]] = True
        for row in np.flatnonzero((f.kind == REQUEST) & (f.flags & ECHO == 0) & ~told).tolist():
            start, length = int(f.start[row]), int(f.length[row])
            self._open[batch.base + start] = batch.data[start : start + length]
        for start in list(self._open)[:-OPEN]:
            del self._open[start]
