"""Durations by key: how often each was met, in fixed memory, whatever the cut of the stream."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.decoding.durations import Bounds
from sniffer.diagnosis.ledger.buckets import in_groups

if TYPE_CHECKING:
    from sniffer.ground.model import I64

PER_OCTAVE: Final = 16
"""Durations are known to 4 %: no verdict here turns on less."""

OCTAVES: Final = 44
"""From 1 ns to 5 hours."""

KEYS: Final = 1024
"""Keys that are told apart, the first ones met; a bus has some servos and some commands."""


class Histograms:
    """Counts of durations by key, each known within bounds, in ns.

    ``per_octave`` says how fine they are told apart.
    """

    def __init__(self, per_octave: int = PER_OCTAVE) -> None:
        self.per_octave = per_octave
        self._bins = per_octave * OCTAVES
        self._row: dict[int, int] = {}
        self._low = np.zeros((0, self._bins), np.int64)
        self._high = np.zeros((0, self._bins), np.int64)

    def add(self, key: I64, low: I64, high: I64) -> None:
        """Count durations that are at least ``low`` and at most ``high``."""
        if not len(key):
            return
        order, begins = in_groups(key)
        first = order[begins]
        for k in key[np.sort(first)].tolist():
            if k not in self._row and len(self._row) < KEYS:
                self._row[k] = len(self._row)
        if len(self._low) < len(self._row):
            more = ((0, len(self._row) - len(self._low)), (0, 0))
            self._low, self._high = np.pad(self._low, more), np.pad(self._high, more)
        row = np.array([self._row.get(k, -1) for k in key[first].tolist()])
        rows = np.empty(len(key), np.int64)
        rows[order] = np.repeat(row, np.diff(begins, append=len(order)))
        if len(self._row) == KEYS:
            known = rows >= 0
            exact = high is low
            rows, low = rows[known], low[known]
            high = low if exact else high[known]
        counted = self._counted(rows, low)
        self._low += counted
        self._high += counted if high is low else self._counted(rows, high)

    def _counted(self, rows: I64, bound: I64) -> I64:
        """Return by row and bin how many durations there are."""
        at = (np.log2(np.maximum(bound, 1)) * self.per_octave).astype(np.int64)
        at = rows * self._bins + np.minimum(at, self._bins - 1)
        return np.bincount(at, minlength=self._low.size).reshape(self._low.shape)

    @property
    def keys(self) -> tuple[int, ...]:
        """The keys met, in the order of their first duration."""
        return tuple(self._row)

    def count(self, key: int) -> int:
        """Return how many durations a key has."""
        return int(self._low[self._row[key]].sum()) if key in self._row else 0

    def total(self, key: int) -> int:
        """Return how long all durations of a key are, one behind the other, in ns."""
        return int(self.counts(key) @ 2 ** (np.arange(self._bins) / self.per_octave))

    def at(self, key: int, share: float) -> Bounds | None:
        """Return the duration that ``share`` of a key's stay below, within bounds; None: no one."""
        count = self.count(key)
        if not count:
            return None
        row = self._row[key]
        out = []
        for k, counts in enumerate((self._low[row], self._high[row])):
            bin_ = int(np.searchsorted(np.cumsum(counts), share * count))
            out.append(int(2 ** ((bin_ + k) / self.per_octave)))
        return Bounds(*out)

    def above(self, key: int, ns: float) -> int:
        """Return how many durations of a key are surely longer."""
        if key not in self._row:
            return 0
        first = int(np.log2(max(ns, 1)) * self.per_octave) + 1
        return int(self._low[self._row[key]][first:].sum())

    def counts(self, key: int) -> I64:
        """Return how many durations of a key are in each bin, by their lower bounds.

        Bin ``k`` begins at ``2 ** (k / per_octave)`` ns.
        """
        out: I64 = self._low[self._row[key]]
        return out
