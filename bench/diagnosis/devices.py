"""Scenarios of servos at fault: gone, restarting, limp, held, hot, slow, renamed, talkative."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Final

from bench.diagnosis.played import joints, mixtures, presence, words

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bench.diagnosis.scenario import Scenario

ROOMS: Final = (presence.CASES, joints.CASES, words.CASES, mixtures.CASES)


def scenarios(draw: int = 0) -> Iterator[Scenario]:
    """Yield the scenarios; each draw is another setting, and another course of each fault."""
    return itertools.chain.from_iterable(room.scenarios(draw) for room in ROOMS)
