"""The distinct numbers of a column, found by counting where they lie close together.

Ids, commands and combinations of them are small numbers; ``np.unique`` sorts or hashes them all,
which takes ten times as long.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from typing import Any

    from sniffer.ground.model import I64, Mask

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


def among(column: Any, few: Iterable[int]) -> Mask:
    """Tell of each number whether it is one of a few.

    ``np.isin`` weighs first how to look, which takes longer than to look in a short column.
    """
    found = np.zeros(len(column), bool)
    for number in few:
        found |= column == number
    return found


def within(column: Any, others: Any) -> Mask:
    """Tell of each number whether it is one of others, which may be many.

    ``np.isin`` finds these with ``np.unique``, which loads ``numpy.ma``: see ``FEW``.
    """
    ordered = np.sort(others)
    if not len(ordered):
        return np.zeros(len(column), bool)
    place = np.searchsorted(ordered, column)
    found: Mask = ordered[np.minimum(place, len(ordered) - 1)] == column
    return found


def groups_of(keys: I64, few: int) -> Iterator[I64]:
    """Yield the row numbers of each distinct key, in order within a key.

    A bus repeats itself: ``few`` comparisons find all keys sooner than sorting them would.
    """
    # In the example of ``by_shape``, whose keys are those of five values: [0 1 2 4] are as the
    # first, [3] are as the first that is left. Each comparison is over what is left, so the order
    # of keys does not matter; only where a few were not enough, many different ones are to be
    # expected, and the rest is sorted.
    left = np.arange(len(keys))
    for _ in range(few):
        if not len(left):
            return
        same = keys == keys[0]
        yield left[same]
        keys, left = keys[~same], left[~same]
    if len(left):
        _, which, count = distinct(keys)
        small = which.astype(np.uint16) if len(count) < 1 << 16 else which  # radix sort below 64 Ki
        yield from np.split(left[np.argsort(small, kind="stable")], np.cumsum(count[:-1]))
