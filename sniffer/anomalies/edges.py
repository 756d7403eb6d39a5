"""States that last are reported when they begin and when they end, not with every reply."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sniffer.ground.memory import Remembering

if TYPE_CHECKING:
    from sniffer.ground.model import I64, Mask


class Edges(Remembering):
    """Remembers one state a key (0..size-1) across batches: a flag, or a number; 0 is none."""

    LASTING = ("_last",)

    def __init__(self, size: int, kind: type = bool) -> None:
        self._last: Mask | I64 = np.zeros(size, kind)

    def feed(self, key: I64, state: Mask | I64) -> tuple[Mask, Mask]:
        """Return where each key's state becomes another one, and where it ends; rows are in time.

        A number that follows another one begins, and does not end it.
        """
        if not state.any() and not self._last[key].any():
            return np.zeros(len(key), bool), np.zeros(len(key), bool)
        order = np.argsort(key, kind="stable")
        k, now = key[order], state[order]
        first = np.ones(len(k), bool)
        first[1:] = k[1:] != k[:-1]
        before = np.empty_like(now)
        before[1:] = now[:-1]
        before[first] = self._last[k[first]]
        last = np.ones(len(k), bool)
        last[:-1] = first[1:]
        self._last[k[last]] = now[last]
        rise, fall = np.empty(len(k), bool), np.empty(len(k), bool)
        rise[order] = (now != 0) & (now != before)
        fall[order] = (now == 0) & (before != 0)
        return rise, fall
