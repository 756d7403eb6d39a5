"""A series that is thinned as it grows: every row, every second one, every fourth ..."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

KEPT: Final = 4096
"""Rows that are kept at most, at least half of them once there were more: enough to tell a
correlation of 0.1 from chance."""


class Thinned:
    """Keeps each row whose number is a multiple of a power of two, so the cut does not matter."""

    def __init__(self, kept: int = KEPT) -> None:
        self.count = 0
        self._kept = kept
        self._stride = 1
        self._rows = 0
        self._parts: list[tuple[Any, ...]] = []

    def add(self, *columns: Any) -> None:
        """Add rows, a column each of what they hold."""
        first = -self.count % self._stride
        self.count += len(columns[0])
        part = tuple(column[first :: self._stride] for column in columns)
        self._parts.append(part)
        self._rows += len(part[0])
        while self._rows > self._kept:
            self._stride *= 2
            self._parts = [tuple(column[::2] for column in self.columns())]
            self._rows = len(self._parts[0][0])

    def values(self) -> Any:
        """Return the first column of the rows that are kept; it may be empty."""
        return self.columns()[0] if self._parts else np.empty(0)

    def columns(self) -> Sequence[Any]:
        """Return the columns of the rows that are kept; there must have been one."""
        if len(self._parts) > 1:
            self._parts = [tuple(map(np.concatenate, zip(*self._parts, strict=True)))]
        return self._parts[0]
