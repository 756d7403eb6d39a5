"""What other registers of a servo say of a joint that seems to stand: it moves, or it runs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.medians import quantile

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case, Series
    from sniffer.ground.model import I64

FAST: Final = 0.2
"""Of the speed that a joint shows at its fastest: one that hangs, or pushes in vain, shows none."""

FASTEST: Final = 0.9
"""Quantile of its speeds that counts as its fastest: one speed beyond may be a misread one."""

LOOKS: Final = 2
"""So many looks at its speed say that it runs; between two of its ways any joint stands."""

STEPS: Final = 4
"""Speeds below so many steps of the register are flicker of a joint at rest."""


def moves_elsewhere(
    case: Case, servo_id: int, position: Series, span: tuple[int, int], far: float
) -> bool:
    """Tell whether another register of its place moves by ``far``, in its unit, within a span (ns).

    Who looks once a second at what moves once a second sees it stand.
    """
    return any(way > far for way, _ in _ways_elsewhere(case, servo_id, position, span))


def stands_elsewhere(
    case: Case, servo_id: int, position: Series, span: tuple[int, int], far: float
) -> bool:
    """Tell whether another register of its place, looked at oftener, stands within a span (ns)."""
    looks = int(position.n[_within(position, span)].sum())
    ways = _ways_elsewhere(case, servo_id, position, span)
    return any(way <= far and n > looks for way, n in ways)


def _ways_elsewhere(
    case: Case, servo_id: int, position: Series, span: tuple[int, int]
) -> Iterator[tuple[float, int]]:
    """Yield how far other registers of its place go within a span (ns), and how many looks tell."""
    for other in case.every(servo_id, "position"):
        if other.index == position.index or other.unit != position.unit:
            continue
        rows = _within(other, span)
        if len(rows):
            way = float(other.high[rows].max() - other.low[rows].min())
            yield way, int(other.n[rows].sum())


def runs(case: Case, servo_id: int, span: tuple[int, int]) -> bool:
    """Tell whether a servo's speed has it running each time it is asked for within a span (ns).

    A joint that is slower than its goals runs to and fro below them; whoever asks seldom where it
    is meets it near one place.
    """
    for speed in case.every(servo_id, "speed"):
        amount = np.maximum(np.abs(speed.low), np.abs(speed.high))
        fastest = float(quantile(amount, FASTEST)) if len(amount) else 0.0
        rows = _within(speed, span)
        least = max(FAST * fastest, STEPS * speed.scale)
        if len(rows) >= LOOKS and float(amount[rows].min()) >= least:
            return True
    return False


def _within(s: Series, span: tuple[int, int]) -> I64:
    return np.flatnonzero((s.t_first >= span[0]) & (s.t <= span[1]))
