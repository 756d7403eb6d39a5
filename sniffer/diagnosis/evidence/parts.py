"""In which of several equal parts of the time something was: what grows is told part by part.

Quantities of a bus go on as they were for a while, so that a line through them rises by chance.
What grows from part to part does not; what changes once, as a program that does something else, is
one step, or two where it does so within a part.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from sniffer.ground.model import F64, I64

MOSTLY: Final = 0.75
"""Part of the steps from one part to the next that rise where something grows."""

QUARTERS: Final = 4
STRETCHES: Final = 20
IN_ORDER: Final = 0.8
"""In how many stretches of the time moments are counted, and from which correlation of the ranks
of these counts with the time on they become more. Moments come in clusters, so that single ones
tell nothing; a bad while of a quarter of the time, with none before and behind, has 0.75 at most.
"""


def part_of(t_ns: I64, first_ns: int, last_ns: int, count: int) -> I64:
    """Return the number of the part that each moment is in; one outside is in the nearest."""
    found: I64 = (t_ns - first_ns) * count // max(last_ns + 1 - first_ns, 1)
    return np.clip(found, 0, count - 1)


def grows(parts: F64, rise: float, least: float) -> bool:
    """Tell whether a quantity grows from part to part of the time.

    Args:
        parts: what it is in each of them, in order.
        rise: by which part of what it was before most steps rise, and none falls.
        least: a quantity below that is as good as none: what rises is held against that then.
    """
    steps = np.diff(parts) / np.maximum(parts[:-1], least)
    return bool((steps >= rise).mean() >= MOSTLY and (steps >= -rise).all())


def more_and_more(times: I64, first_ns: int, last_ns: int) -> tuple[int, ...]:
    """Return how many of some moments lie in each quarter of a time where these become more.

    Nothing is returned where they do not, or where the last quarter does not have the most.
    """
    stretch = np.bincount(part_of(times, first_ns, last_ns, STRETCHES), minlength=STRETCHES)
    counts = stretch.reshape(QUARTERS, -1).sum(axis=1).tolist()
    if counts[-1] != max(counts) or not stretch.std():
        return ()
    in_order = np.corrcoef(_ranks(stretch), np.arange(STRETCHES))[0, 1]
    return tuple(counts) if in_order >= IN_ORDER else ()


def _ranks(counts: I64) -> F64:
    """Return the rank of each count; equal ones have the middle of theirs."""
    _, which, many = np.unique(counts, return_inverse=True, return_counts=True)
    ranks: F64 = (np.cumsum(many) - (many - 1) / 2)[which]
    return ranks
