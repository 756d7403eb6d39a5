"""Positions that lack their highest bit: they follow goals that are so much beyond them.

A bare answer has no checksum. Of a servo whose clock is slow a tap samples the last data bit early
and reads the one before it: places above 127 are told as if they were 128 lower::

    goal      131  140  158  120
    position  130  139  157  120
    heard     2    11   29   120
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.evidence.tracks import LAG_NS, in_force

if TYPE_CHECKING:
    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.evidence.tracks import JointTrack

LAST_BIT: Final = 1 << 7
"""What the last data bit of a byte on the line is worth."""

LEAST: Final = 4
"""Looks at it while its goals are beyond that bit."""

FOLLOWS: Final = 0.9
"""Part of these in which it is where its goals are, but for that bit."""


def lacks_last_bit(case: Case, one: JointTrack) -> bool:
    """Tell whether a joint follows its goals but for a bit that is never heard of it.

    Who hangs somewhere does not move with them.
    """
    p, bit = one.position, LAST_BIT * one.position.scale
    if case.has_checksum or p.high.max() >= bit:
        return False
    low, high = in_force(one.goal, p.t_first - LAG_NS, p.t)
    beyond = low >= bit
    if np.count_nonzero(beyond) < LEAST or np.ptp(p.last[beyond]) <= one.far:
        return False
    place = p.last[beyond] + bit
    near = (place >= low[beyond] - one.far) & (place <= high[beyond] + one.far)
    return bool(near.mean() >= FOLLOWS)
