"""States that last are reported when they begin and when they end, not with every reply."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sniffer.ground.memory import Remembering

if TYPE_CHECKING:
    from sniffer.ground.model import I64, Mask


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
