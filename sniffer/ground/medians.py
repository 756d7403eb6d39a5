"""The median without masked arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


def median(values: ArrayLike, axis: int | None = None, *, keepdims: bool = False) -> Any:
    """Return what ``np.median`` does, which loads ``numpy.ma`` to look whether they are masked.

    Of a small log that is a twentieth of all work.

    Args:
        values: numbers; those that are none (NaN) make all of it none.
        axis: along which they are looked at; None: all of them.
        keepdims: whether that axis stays, of length 1.
    """
    given = np.asarray(values)
    along = -1 if axis is None else axis
    n = given.size if axis is None else given.shape[axis]
    if not n or np.isnan(given).any():
        return np.median(given, axis=axis, keepdims=keepdims)
    middle = np.arange((n - 1) // 2, n // 2 + 1)
    parted = np.partition(given, middle, axis=axis)
    return parted.take(middle, axis=along).mean(axis=along, keepdims=keepdims)
