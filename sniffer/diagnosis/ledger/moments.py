"""When each kind of request was said: the first moments and the last ones, as they came."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from sniffer.ground.model import I64

KEPT: Final = 1 << 13
"""So many first requests and so many last ones: a minute or two of a busy bus each."""


class RequestMoments:
    """Keeps the beginnings of requests with their kinds."""

    def __init__(self) -> None:
        self._first: list[tuple[I64, I64]] = []
        self._count = 0
        self._last: list[tuple[I64, I64]] = []
        self._held = 0

    def add(self, t_start: I64, kind: I64) -> None:
        """Take requests in order."""
        room = max(KEPT - self._count, 0)
        if room:
            self._first.append((t_start[:room], kind[:room]))
        self._count += len(kind)
        if len(kind) > room:
            self._last.append((t_start[room:], kind[room:]))
            self._held += len(kind) - room
        while self._last and self._held - len(self._last[0][0]) >= KEPT:
            self._held -= len(self._last.pop(0)[0])

    def stretches(self) -> list[tuple[I64, I64]]:
        """Return the first ones and the last ones: when each began, and its kind."""
        out = []
        for parts in (self._first, self._last):
            if parts:
                t, kind = (np.concatenate(column)[-KEPT:] for column in zip(*parts, strict=True))
                out.append((t, kind))
        return out
