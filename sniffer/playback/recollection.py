"""Which recorded exchange a request is answered by."""

from __future__ import annotations

import bisect
import collections
import enum
from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.playback.exchanges import RecordedExchange, RequestKey

LATELY: Final = 64
"""Requests that tell what a controller is doing now: more than one asks in a cycle."""


class Ground(enum.Enum):
    """On what grounds an exchange answers a request."""

    SAME = enum.auto()
    """The recording has the very bytes."""
    ALIKE = enum.auto()
    """It has them of the same servo, command and registers, with other contents."""


class Recalled(NamedTuple):
    """An exchange, and why it is the one."""

    exchange: RecordedExchange
    ground: Ground


class Recollection:
    """Goes through a recording as a controller asks.

    - A request whose bytes are recorded gets its next exchange behind the last one that was
      answered: who asks in the recorded order is told what was told then, and who leaves requests
      out goes on at the same place in time.
    - Where there is none behind it, the last one before it answers, and the place stays.
    - Once nothing of what was asked lately comes later, the recording is over, and goes round.
    - A request of the same servo, command and registers with other bytes gets the reply that was
      the last one by then, or else the first. The place stays.
    """

    def __init__(self, exchanges: Sequence[RecordedExchange]) -> None:
        self._exchanges = exchanges
        self._same: dict[bytes, list[int]] = {}
        self._alike: dict[RequestKey, list[int]] = {}
        for nth, one in enumerate(exchanges):
            self._same.setdefault(one.raw, []).append(nth)
            self._alike.setdefault(one.key, []).append(nth)
        self._place = -1
        self._lately: collections.deque[bytes] = collections.deque(maxlen=LATELY)

    def find(self, raw: bytes, key: RequestKey) -> Recalled | None:
        """Return what answers a request; None: nothing like it was ever asked."""
        rows = self._same.get(raw)
        if rows is not None:
            self._lately.append(raw)
            return Recalled(self._exchanges[self._next(rows)], Ground.SAME)
        rows = self._alike.get(key)
        if rows is None:
            return None
        told = [row for row in rows if self._exchanges[row].replies] or rows
        nth = bisect.bisect_right(told, self._place) - 1
        return Recalled(self._exchanges[told[max(nth, 0)]], Ground.ALIKE)

    def _next(self, rows: Sequence[int]) -> int:
        nth = bisect.bisect_right(rows, self._place)
        if nth < len(rows):
            self._place = rows[nth]
        elif all(self._same[raw][-1] <= self._place for raw in {*self._lately}):
            self._place = rows[0]
        else:
            return rows[-1]
        return self._place
