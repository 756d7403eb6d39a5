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
DEVIATIONS: Final = 4.0
"""How far beyond chance what becomes more lies behind the middle of the time."""

STRETCHES: Final = 20
HELD: Final = 4
"""In so many of so many stretches of the time, at least, is what becomes more: a bad while is in
few, however much it holds."""


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

    Moments that come at any time lie in the middle of it on average, give or take what chance
    leaves: the more there are, the less. Nothing is returned where they do not become more.
    """
    if not len(times):
        return ()
    place = (times - first_ns) / max(last_ns - first_ns, 1)
    beyond = (place.mean() - 0.5) * (12 * len(place)) ** 0.5
    held = len(np.unique(part_of(times, first_ns, last_ns, STRETCHES)))
    counts = np.bincount(part_of(times, first_ns, last_ns, QUARTERS), minlength=QUARTERS).tolist()
    is_more = beyond > DEVIATIONS and held >= HELD and counts[-1] == max(counts)
    return tuple(counts) if is_more else ()
