"""Scenarios of controllers at fault: in haste, hung, trembling, overfull, asking for the wrong."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Final

from bench.diagnosis.played import loops, mixtures, orders

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bench.diagnosis.scenario import Scenario

ROOMS: Final = (loops.CASES, orders.CASES, mixtures.OF_CONTROLLERS)


def scenarios(draw: int = 0) -> Iterator[Scenario]:
    """Yield the scenarios; each draw is another setting, and another course of each fault."""
    return itertools.chain.from_iterable(room.scenarios(draw) for room in ROOMS)
