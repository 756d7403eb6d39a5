"""A stretch in which something else is spoken: a loader's blocks, another program, another rate."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.ground.distinct import numbers
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from sniffer.diagnosis.case import Case

LASTS_NS: Final = NS
"""A stretch at least: what is plugged in, or starts, disturbs the line for moments."""

SAID: Final = 1024
"""Bytes in it at least."""

PIECE: Final = 16
"""Bytes in a row on average where somebody speaks: a pulse makes one or two."""

BUSY: Final = 0.9
"""Part of the time for which the line is busy where it babbles: who speaks waits for others."""

BY_CHANCE: Final = 0.02
"""Part of what is said then that may be frames of this protocol by chance."""

SOUND: Final = 4
"""Quarters of a second with frames in them before the stretch, and behind it."""


class Interlude(NamedTuple):
    """From when to when (ns) what holds no frame was said, from which byte on, and how much."""

    first_ns: int
    last_ns: int
    at: int
    size: int


def interlude(case: Case) -> Interlude | None:
    """Return the one stretch in which nothing holds, where nothing is torn before it or behind."""
    return case.once(_interlude)


def _interlude(case: Case) -> Interlude | None:
    line, lost_ns = case.line, case.lost_ns
    if not case.has_clock or lost_ns is None:
        return None
    torn = line["gap_bytes"] > 0
    first, last = int(line["bucket"][torn].min()), int(line["bucket"][torn].max())
    size, pieces = int(line["gap_bytes"].sum()), int(line["gaps"].sum())
    # in the first quarter of a second and the last one frames of before and behind stand as well
    within = (line["bucket"] > first) & (line["bucket"] < last)
    said, held = int(line["bytes"][within].sum()), int(line["gap_bytes"][within].sum())
    took_ns = lost_ns[1] - lost_ns[0]
    heard = numbers(line["bucket"][line["bytes"] > 0])
    sound = min(np.count_nonzero(heard < first), np.count_nonzero(heard > last))
    if took_ns < LASTS_NS or size < SAID or said - held > BY_CHANCE * said:
        return None
    is_talk = size >= PIECE * pieces and size * case.ledger.byte_ns < BUSY * took_ns
    if not is_talk or case.held_bytes or sound < SOUND:
        return None
    return Interlude(*lost_ns, int(line["at"][torn].min()), size)
