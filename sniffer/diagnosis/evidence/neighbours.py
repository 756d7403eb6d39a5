"""Whose second answers lie over torn ones of the servo that is asked next.

Answers of two servos differ at their beginning in the id alone, so what the second one of the servo
before makes of them looks much as two of their own would; but not in every place.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.evidence.chances import at_least
from sniffer.diagnosis.physics.mixing import LEAST as SURE_BYTES
from sniffer.diagnosis.physics.mixing import Mix, mix_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence, Set

    from sniffer.diagnosis.ledger.damage import Damage

LEAST: Final = 3

NEARLY: Final = 0.75
"""Part of the torn answers before which the one servo must be asked."""

SOMETIMES: Final = 0.01
"""How often two answers of one servo are taken for one of another's, by the places that tell."""


def spoken_over(
    tried: Sequence[tuple[Damage, bytes]], own: Set[int], begins: Mapping[int, bytes]
) -> tuple[int, list[tuple[Damage, Mix]]]:
    """Return whose second answers lie over torn ones of another servo, and over which; -1: none.

    They are of the servo asked before, if these make more of the torn ones than two of their own.
    """
    ((one, count),) = Counter(d.earlier_id for d, _ in tried).most_common(1) or [(-1, 0)]
    theirs = begins.get(one, b"")
    if count < NEARLY * len(tried) or len(own) < LEAST or len(theirs) < SURE_BYTES:
        return -1, []
    pairs = [(d, mix_of(d.got, theirs, b) or mix_of(d.got, b, theirs)) for d, b in tried]
    mixed = [(d, mix) for d, mix in pairs if mix is not None]
    places = {d.at for d, _ in mixed}
    more, less = len(places - own), len(own - places)
    return (one, mixed) if at_least(more, more + less, 0.5) < SOMETIMES else (-1, [])
