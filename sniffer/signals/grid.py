"""How often a wire was looked at, where the file does not say: as far as its edges tell.

Dumps and tables name times in nanoseconds, whatever the analyser's rate was. Their edges lie on the
grid of its samples, and are as late as a sample is long.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.model import NS

if TYPE_CHECKING:
    from sniffer.ground.model import F64, I64

FEWEST: Final = 32
"""Pulses from which on it is no chance that all lie on a grid."""

ENOUGH: Final = 1 << 14
"""So many are looked at."""

_DIVIDED: Final = (*(1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48), *(10, 20, 25, 50, 100))
_HALVED: Final = (1.5625, 3.125, 6.25, 12.5)
RATES: Final = tuple(sorted(mega * 1e6 for mega in (*_DIVIDED, *_HALVED)))
"""Rates of analysers in Hz, ascending: what clocks of 48, 96 and 100 MHz are divided into, and 100
MHz halved time and again. They are tried where rounded times have no common divisor, and too few
pauses or too many samples a bit to tell it."""

LEAST: Final = 8
"""Ticks of a sample at least: of fewer, times that were rounded lie on any grid."""

DENSEST: Final = 256
"""Samples a bit at most that are looked for among all rates: of more, a sample is nothing beside
the 2 % that a sender is off."""

SURE: Final = 1e-6
"""Chance at most that pauses lie on one of the grids that were tried."""

OFF: Final = 1.25
"""Ticks that a pulse may be off: both its ends are rounded, and so is what is fitted to all."""

_PAUSE: Final = 10.5  # bits: what is longer is no part of a byte, and as long as it happens to be


def grid_in(edges: I64, tick_ns: float, bit: float, least: float) -> float:
    """Return how many ticks a sample lasts that these edges lie on; 0 where they do not tell.

    ``bit``: ticks of a bit, which has ``least`` samples at least; what is longer is the wire's own.
    """
    pulses = np.diff(edges[: ENOUGH + 1])
    if len(pulses) < FEWEST:
        return 0
    whole = int(np.gcd.reduce(pulses))
    if whole > 1:
        return whole if whole * least <= bit else 0
    # the coarsest first: what lies on it lies on finer ones, too
    if found := _any_grid(np.unique(pulses).astype(np.float64), bit, least):
        return found
    for rate in RATES:
        sample = NS / rate / tick_ns
        if sample * least > bit:
            continue
        if sample < LEAST:
            break
        off = np.abs(pulses - np.rint(pulses / sample) * sample)
        if off.max() <= 1:
            return sample
    return 0


def _any_grid(pulses: F64, bit: float, least: float) -> float:
    """Return the coarsest grid that pulses of different length lie on; 0 where none is sure.

    Bits are multiples of whatever they are divided by. Only pauses tell a grid from the wire's own.
    """
    pulses = pulses[pulses > LEAST]
    pauses = np.count_nonzero(pulses > _PAUSE * bit)
    shortest = float(pulses[0]) if len(pulses) else 0.0
    for parts in range(1, int(DENSEST * shortest / bit) + 1):
        sample = _fitted(pulses, shortest / parts)
        if not sample:
            continue
        chance = parts * ((2 * OFF + 1) / sample) ** pauses
        is_one = LEAST <= sample <= bit / least and chance < SURE
        return sample if is_one else 0
    return 0


def _fitted(pulses: F64, sample: float) -> float:
    """Fit a grid to ascending pulses, the short ones first; 0 where they do not lie on it."""
    reach = float(pulses[0])
    while True:
        reach *= 2
        near = pulses[: int(np.searchsorted(pulses, reach, "right"))]
        samples = np.rint(near / sample)
        sample = float((near * samples).sum() / (samples**2).sum())
        if np.abs(near - samples * sample).max() > OFF:
            return 0
        if len(near) == len(pulses):
            return sample
