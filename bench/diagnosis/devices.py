"""Scenarios of servos at fault: gone, restarting, limp, held, hot, slow, renamed, talkative."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Final

from bench.diagnosis.played import joints, mixtures, presence, words

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bench.diagnosis.scenario import Scenario

ROOMS: Final = (presence.CASES, joints.CASES, words.CASES, mixtures.CASES)


def devices(variants: Sequence[int] = range(1)) -> tuple[Scenario, ...]:
    """Return the scenarios; each variant is another setting, and another course of the fault."""
    return tuple(itertools.chain.from_iterable(room.scenarios(variants) for room in ROOMS))


DEVICES: Final = devices()
