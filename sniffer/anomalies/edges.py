"""States that last are reported when they begin and when they end, not with every reply."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sniffer.ground.memory import Remembering

if TYPE_CHECKING:
    from sniffer.ground.model import I64, Mask


class LastNumbers(Remembering):
    """Remembers one number a key (0..size-1) across batches; 0 is none."""

    LASTING = ("_last",)

    def __init__(self, size: int) -> None:
        self._last = np.zeros(size, np.int64)

    def feed(self, key: I64, number: I64) -> tuple[Mask, Mask]:
        """Return where each key's number is another one than before, and where it is none again."""
        order = np.argsort(key, kind="stable")
        k, now = key[order], number[order]
        first = np.ones(len(k), bool)
        first[1:] = k[1:] != k[:-1]
        before = np.empty(len(k), np.int64)
        before[1:] = now[:-1]
        before[first] = self._last[k[first]]
        last = np.ones(len(k), bool)
        last[:-1] = first[1:]
        self._last[k[last]] = now[last]
        rise, fall = np.empty(len(k), bool), np.empty(len(k), bool)
        rise[order] = (now != before) & (now > 0)
        fall[order] = (now == 0) & (before > 0)
        return rise, fall


class Edges(Remembering):
    """Remembers one flag a key (0..size-1) across batches."""

    LASTING = ("_on",)

    def __init__(self, size: int) -> None:
        self._on = np.zeros(size, bool)

    def feed(self, key: I64, flag: Mask) -> tuple[Mask, Mask]:
        """Return where each key's flag rises and falls; rows are in order of time."""
        if not len(key):
            return np.zeros(0, bool), np.zeros(0, bool)
        if not flag.any() and not self._on[key].any():
            return np.zeros(len(key), bool), np.zeros(len(key), bool)
        order = np.argsort(key, kind="stable")
        k, f = key[order], flag[order]
        before = np.empty(len(k), bool)
        before[1:] = f[:-1]
        first = np.ones(len(k), bool)
        first[1:] = k[1:] != k[:-1]
        before[first] = self._on[k[first]]
        last = np.ones(len(k), bool)
        last[:-1] = k[1:] != k[:-1]
        self._on[k[last]] = f[last]
        rise, fall = np.empty(len(k), bool), np.empty(len(k), bool)
        rise[order] = f & ~before
        fall[order] = before & ~f
        return rise, fall
