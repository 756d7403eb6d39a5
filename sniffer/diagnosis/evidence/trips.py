"""Away and back within a few values: jumps that the order of values tells, without a clock."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.ground.milli import MILLI

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.diagnosis.case import Case, Series
    from sniffer.diagnosis.ledger.steps import Leap

AWAY: Final = 8
"""So many values in a row may stand where one jumped to: what is there for longer went there."""

GAP: Final = 1.5
"""Who is so many usual distances behind the value before it has others missing between the two."""

STAYS: Final = 0.25
"""What is away moves by no more than this part of the jump meanwhile."""

RETURNS: Final = 0.5
"""... and is back if no more than this part is left: what moves has moved on."""

BEYOND: Final = 4.0
"""What moves in small steps has none several times beyond all others."""

HISTORY: Final = 48
"""Values whose steps tell what is usual."""

SHARE: Final = 0.05
"""What goes away and back with more of its values does so by plan."""


class Trip(NamedTuple):
    """The step away and the step back."""

    out: Leap
    back: Leap


def trips(case: Case, servo_id: int, p: Series) -> tuple[Sequence[Trip], float]:
    """Return the trips of one series in order, and the greatest of all its other steps.

    Distances are bytes: where no clock tells, they are all that lies between two values.
    """
    stated = int(p.n.sum())
    leaps = case.ledger.steps.of(servo_id, p.index)
    if stated < HISTORY or not leaps:
        return (), 0.0
    byte_ns = max(case.ledger.byte_ns, 1)
    usual = (case.last_ns - case.first_ns) / byte_ns / stated
    near = [s for s in leaps if s.took_ns <= GAP * usual * byte_ns]
    found: list[Trip] = []
    for k, s in enumerate(near):
        if found and found[-1].back is s:
            continue
        soon = [b for b in near[k + 1 :] if b.at - s.at <= (AWAY + 0.5) * usual]
        back = next((b for b in soon if _is_back(s, b)), None)
        if back is not None:
            found.append(Trip(s, back))
    ways = {s.at for trip in found for s in trip}
    greatest = max((s.size for s in leaps if s.at not in ways), default=0)
    found = [t for t in found if min(s.size for s in t) >= BEYOND * greatest]
    if not greatest or len(found) > SHARE * stated:
        return (), 0.0
    return found, greatest / MILLI


def _is_back(s: Leap, b: Leap) -> bool:
    stays = abs(b.before - s.after) <= STAYS * s.size
    return stays and abs(b.after - s.before) <= RETURNS * s.size
