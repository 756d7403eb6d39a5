"""Durations that are known within bounds, and their quantiles in fixed memory."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.ground.model import I64, MS, NEVER_NS

if TYPE_CHECKING:
    from collections.abc import Mapping

PER_OCTAVE: Final = 32
"""Bins of an octave: 2 % each."""

BINS_SHOWN: Final = 8
"""Bins of an octave in a histogram that is shown."""

BINS: Final = 64 * PER_OCTAVE
"""Bins of all times that there can be."""

FIGURES: Final[Mapping[str, float]] = MappingProxyType({"p50": 0.5, "p99": 0.99, "max": 1.0})
"""The figures that are told of response times, and the share of all that stay below."""

POINT: Final = 0.1
"""A figure is told as a point if its bounds are no further from it than this share of it."""


LONG_MS: Final = 100
"""From so many on a duration that is not known to a millisecond is told in whole ones."""


class Bounds(NamedTuple):
    """A duration as far as the stamps tell it: at least and at most, in ns."""

    low: int
    high: int

    @property
    def point(self) -> int | None:
        """The duration where the bounds are close enough to call it one; None elsewhere."""
        middle = (self.low + self.high) // 2
        return middle if self.high - self.low <= 2 * POINT * middle else None

    def ms(self) -> str:
        """Return it in ms: a point, an upper bound, or both bounds."""
        if self.point is not None:
            digits = 0 if self.high - self.low >= MS <= self.point / LONG_MS else 2
            return f"{self.point / 1e6:.{digits}f}"
        high = f"{self.high / 1e6:.2f}"
        return f"{self.low / 1e6:.2f}-{high}" if 2 * self.low > self.high else f"<{high}"


def bins_of(ns: I64) -> I64:
    """Return the bins of durations; 0 is in the first one, as 1 is."""
    return (np.log2(np.maximum(ns, 1)) * PER_OCTAVE).astype(np.int64)


def edge_of(row: int, side: int, least: int, most: int) -> int:
    """Return the lower (0) or the upper (1) edge of a bin, in ns, within the ends of all."""
    edge = int(2 ** ((row + side) / PER_OCTAVE)) if row or side else 0
    return min(max(edge, least), most)


class Quantiles:
    """Quantiles of durations that are known within bounds, in fixed memory.

    Two histograms of logarithms, to 2 %: where each duration lies between its bounds, each quantile
    lies between the same quantile of the lower bounds and that of the upper ones.
    """

    def __init__(self) -> None:
        self._bins = np.zeros((2, BINS), np.int64)
        self._least = [NEVER_NS, NEVER_NS]
        self._most = [0, 0]
        self.count = 0

    def add(self, ns: I64, spread: I64) -> None:
        """Count durations, in ns, each known to ``spread``; negative ones are not known at all."""
        known = ns >= 0
        ns, spread = ns[known], np.maximum(spread[known], 0)
        if not len(ns):
            return
        self.count += len(ns)
        for k, bound in enumerate((np.maximum(ns - spread, 0), ns + spread)):
            self._bins[k] += np.bincount(bins_of(bound), minlength=BINS)
            self._least[k] = min(self._least[k], int(bound.min()))
            self._most[k] = max(self._most[k], int(bound.max()))

    def copy(self) -> Quantiles:
        """Return the same durations, to which others can be added."""
        out = Quantiles()
        out._bins, out.count = self._bins.copy(), self.count
        out._least, out._most = list(self._least), list(self._most)
        return out

    def join(self, more: Quantiles) -> None:
        """Add other durations."""
        self._bins += more._bins
        self.count += more.count
        self._least = [*map(min, self._least, more._least)]
        self._most = [*map(max, self._most, more._most)]

    def histogram(self) -> tuple[I64, I64]:
        """Return how many lower and how many upper bounds lie in each eighth of an octave.

        Bin k begins at ``2 ** (k / BINS_SHOWN)`` ns; the first one also has those that are 0.
        """
        least, most = self._bins.reshape(2, -1, PER_OCTAVE // BINS_SHOWN).sum(axis=2)
        return least, most

    def longest(self) -> Bounds | None:
        """Return the longest duration, as exact as the stamps are; None: no one."""
        return Bounds(*self._most) if self.count else None

    def figure(self, share: float) -> Bounds | None:
        """Return a figure as people are told it: the longest is exact, all others are to 2 %.

        JSON lines have all of them by ``at``, which tells of the longest the edge of its bin.
        """
        return self.longest() if share >= 1 else self.at(share)

    def at(self, share: float) -> Bounds | None:
        """Return the duration that ``share`` of all stay below; None: no one.

        0 is the shortest, 1 the longest.
        """
        if not self.count:
            return None
        if share <= 0:
            return Bounds(*self._least)
        out = []
        for k, bins in enumerate(self._bins):
            row = int(np.searchsorted(np.cumsum(bins), share * self.count))
            out.append(edge_of(row, k, self._least[k], self._most[k]))
        return Bounds(*out)
