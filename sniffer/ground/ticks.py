"""Stamps of few digits: what they show at once, and the chunks that have such a stamp.

Nobody knows whether a writer cut a stamp off or rounded it. So it is taken for the end of its tick,
and the bytes may be older than that by one tick and a half.
"""

from __future__ import annotations

import functools
from typing import Final

from sniffer.ground.limits import TIME_END_NS
from sniffer.ground.model import Chunk, Mark, MarkKind

NANO: Final = 9
"""Digits behind the point of a second that are kept."""

FINE: Final = 5
"""So many digits tell the bytes of a bus apart."""

_BARE: Final = 1


@functools.cache
def tick_ns(places: int) -> int:
    """Return what stamps with so many digits show at once, 0 where that is nothing to speak of.

    One digit alone no clock shows: such numbers are exact ones, without their zeros.
    """
    return 10 ** (NANO - places) if places < FINE and places != _BARE else 0


@functools.cache
def coarse_marks(size: int, tick: int) -> tuple[Mark, ...]:
    """Return what is said of the times of ``size`` bytes that a clock with such ticks stamped."""
    return (Mark(MarkKind.COARSE, 0, size, tick + tick // 2),)


def end_of_tick(t_ns: int, tick: int) -> int:
    """Return the last nanosecond that a stamp can mean."""
    return min(t_ns + tick, TIME_END_NS) - 1


def places_of(chunk: Chunk) -> int:
    """Return how many digits the stamp had of a chunk that was read so."""
    if chunk.marks and chunk.t_ns is not None:
        for places in range(FINE):
            tick = tick_ns(places)
            if tick and chunk.marks == coarse_marks(len(chunk.data), tick):
                return places if (chunk.t_ns + 1) % tick == 0 else NANO
    return NANO
