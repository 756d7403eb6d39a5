"""How busy a bus is over time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from sniffer.statistics.grid import Grid

SLICES: Final = 64
"""Slices of time that are told at most: a line on a terminal has room for them."""

SHORTEST_NS: Final = 50_000_000
"""A slice is no shorter than 50 ms: a frame counts where it ends, so it must be short beside it."""


@dataclass(frozen=True, slots=True)
class Slices:
    """Sums of a curve in slices of one width; slice k begins at ``first_ns + k * width_ns``."""

    first_ns: int
    width_ns: int
    sums: list[float]


def profile(grid: Grid, curve: int) -> Slices:
    """Return the sums of a curve over time, in few slices."""
    width = grid.width_ns
    first = grid.first_ns
    last = first + grid.size * width
    while width < SHORTEST_NS or (last - 1) // width - first // width >= SLICES:
        width *= 2
    begin = first // width
    sums = np.zeros(max((last - 1) // width - begin + 1, 1))
    trace = grid.trace(curve)
    if len(trace):
        at = (first + trace.at * grid.width_ns) // width - begin
        np.add.at(sums, at, trace.mean * trace.n)
    return Slices(begin * width, width, np.round(sums, 3).tolist())
