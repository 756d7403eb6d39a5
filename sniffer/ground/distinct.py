"""The distinct numbers of a column, found by counting where they lie close together.

Ids, commands and combinations of them are small numbers; ``np.unique`` sorts or hashes them all,
which takes ten times as long.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from typing import Any

    from sniffer.ground.model import I64

SPARE: Final = 1024
"""So wide a range is counted however few numbers there are."""

FEW: Final = 64
"""So many are sorted as they are. ``np.unique`` would also load ``numpy.ma``, to look whether they
are masked: it costs more than all else that is done with a small capture."""


def distinct(column: Any) -> tuple[I64, I64, I64]:
    """Return the distinct numbers in order, the place of each row's among them, and how often."""
    if len(column):
        low = int(column.min())
        size = int(column.max()) - low + 1
        if size <= max(SPARE, 2 * len(column)):
            shifted = column.astype(np.int64) - low
            times = np.bincount(shifted, minlength=size)
            found = np.flatnonzero(times)
            place = np.zeros(size, np.int64)
            place[found] = np.arange(len(found))
            return found + low, place[shifted], times[found]
    values, which, counts = np.unique(column, return_inverse=True, return_counts=True)
    return values.astype(np.int64), which.astype(np.int64), counts.astype(np.int64)


def numbers(column: Any) -> I64:
    """Return the distinct numbers in order."""
    if len(column) <= FEW:
        return np.array(sorted({*column.tolist()}), np.int64)
    return distinct(column)[0]
