"""Curves in bounded memory: buckets of time whose width doubles as the time goes on.

All curves share one grid, so that one axis serves them all. A width is 2^k ms, and buckets begin at
multiples of it: what a grid holds at its end does not depend on how the stream was cut.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.ledger.buckets import Buckets
from sniffer.ground.milli import MILLI, in_milli

if TYPE_CHECKING:
    from sniffer.ground.model import F64, I64

BUCKETS: Final = 1024
"""Buckets of a curve at most, at least half of them once the time is long: a chart is some 1000
pixels wide."""

FINEST_NS: Final = 1_000_000
"""Width of a bucket at the beginning: stamps of files are good to that."""

CURVES: Final = 1024
"""Curves that are kept, the first ones met; 128 servos with eight curves each."""

_PLACE: Final = 45
_ORIGIN: Final = 1 << (_PLACE - 1)
"""A key is a curve, and in the low bits a bucket counted from the epoch, with room for all times
that an input can have, in ms."""

_COLUMNS: Final = {"n": "sum", "low": "min", "high": "max", "total": "sum", "last": "last"}


@dataclass(frozen=True, slots=True)
class Trace:
    """What is left of one curve: a row for each bucket that holds anything.

    ``at`` counts buckets from the grid's first; the others are in the unit of the values.
    """

    at: I64
    n: I64
    low: F64
    high: F64
    mean: F64
    last: F64

    def __len__(self) -> int:
        return len(self.at)


class Grid:
    """Collects curves."""

    def __init__(self) -> None:
        self.width_ns = FINEST_NS
        self._rows = Buckets(_COLUMNS)
        self._span: tuple[int, int] | None = None
        self._curves = 0

    def curve(self) -> int:
        """Return the number of a new curve; -1: there are too many, it is not kept."""
        if self._curves == CURVES:
            return -1
        self._curves += 1
        return self._curves - 1

    def add(self, curve: int, t_ns: I64, value: F64 | I64) -> None:
        """Add values of a curve at their times."""
        if curve < 0 or not len(t_ns):
            return
        self._reach(int(t_ns.min()), int(t_ns.max()))
        milli = in_milli(value)
        key = (curve << _PLACE) + t_ns // self.width_ns + _ORIGIN
        n = np.ones(len(key), np.int64)
        self._rows.add(key, n=n, low=milli, high=milli, total=milli, last=milli)

    @property
    def first_ns(self) -> int:
        """When the first bucket begins."""
        return 0 if self._span is None else self._span[0] // self.width_ns * self.width_ns

    @property
    def size(self) -> int:
        """How many buckets there are from the first to the last one that holds anything."""
        if self._span is None:
            return 0
        return self._span[1] // self.width_ns - self._span[0] // self.width_ns + 1

    def curves(self) -> dict[int, Trace]:
        """Return the curves by number."""
        return {curve: self.trace(curve) for curve in range(self._curves)}

    def trace(self, curve: int) -> Trace:
        """Return one curve by its number; one that was not kept is empty."""
        key, columns = self._rows.table()
        edges = np.array([curve, curve + 1], np.int64) << _PLACE
        mine = slice(*np.searchsorted(key, edges).tolist())
        at = key[mine] - edges[0] - _ORIGIN - self.first_ns // self.width_ns
        n = columns["n"][mine]
        low, high, total, last = (
            columns[c][mine] / MILLI for c in ("low", "high", "total", "last")
        )
        return Trace(at, n, low, high, total / np.maximum(n, 1), last)

    def _reach(self, first_ns: int, last_ns: int) -> None:
        """Take a span of time in; where it is too long, buckets are joined two by two."""
        if self._span is not None:
            first_ns, last_ns = min(first_ns, self._span[0]), max(last_ns, self._span[1])
        self._span = first_ns, last_ns
        before = self.width_ns
        while last_ns // self.width_ns - first_ns // self.width_ns >= BUCKETS:
            self.width_ns *= 2
        key, _ = self._rows.table() if self.width_ns != before else (np.empty(0, np.int64), {})
        if len(key):
            which = key >> _PLACE
            at = key - (which << _PLACE) - _ORIGIN
            self._rows.rekey((which << _PLACE) + at * before // self.width_ns + _ORIGIN)
