"""How often a wire was looked at, where the file does not say: as far as its edges tell.

Dumps and tables name times in nanoseconds, whatever the analyser's rate was. Their edges lie on the
grid of its samples, and are as late as a sample is long.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.model import NS

if TYPE_CHECKING:
    from sniffer.ground.model import I64

FEWEST: Final = 32
"""Pulses from which on it is no chance that all lie on a grid."""

ENOUGH: Final = 1 << 14
"""So many are looked at."""

_DIVIDED: Final = (*(1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48), *(10, 20, 25, 50, 100))
_HALVED: Final = (1.5625, 3.125, 6.25, 12.5)
RATES: Final = tuple(sorted(mega * 1e6 for mega in (*_DIVIDED, *_HALVED)))
"""Rates of analysers in Hz, ascending: what clocks of 48, 96 and 100 MHz are divided into, and 100
MHz halved time and again. They are tried where rounded times have no common divisor."""

LEAST: Final = 8
"""Ticks of a sample at least: of fewer, times that were rounded lie on any grid."""


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
