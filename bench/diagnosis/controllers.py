"""Scenarios of controllers at fault: in haste, hung, trembling, overfull, asking for the wrong."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Final

from bench.diagnosis.played import loops, mixtures, orders

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bench.diagnosis.scenario import Scenario

ROOMS: Final = (loops.CASES, orders.CASES, mixtures.OF_CONTROLLERS)


def controllers(variants: Sequence[int] = range(1)) -> tuple[Scenario, ...]:
    """Return the scenarios; each variant is another setting, and another course of the fault."""
    return tuple(itertools.chain.from_iterable(room.scenarios(variants) for room in ROOMS))


CONTROLLERS: Final = controllers()
