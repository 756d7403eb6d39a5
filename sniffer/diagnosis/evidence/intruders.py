"""Requests that stand torn where answers are due: somebody speaks into them."""

from __future__ import annotations

import operator
from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.physics.comparing import alike, header_of, is_altered
from sniffer.diagnosis.physics.misread import alike_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.damage import Damage

OVERLAPS: Final = 3
"""Times that are no rounding."""


def torn_requests(case: Case, places: Sequence[Damage]) -> list[Damage]:
    """Return places of answers that are torn requests which are torn there oftener than whole.

    Noise tears one now and then; whose end is spoken into each time is said while another speaks.
    """
    kinds, known = case.ledger.exchanges.kinds, case.ledger.damages.likes.known
    header = header_of(kinds.requests)
    # in a protocol of one header an answer to a short question looks like a request by half
    due = {d.at: _most_equal(d.got, alike_of(d, known)) for d in places}
    out: dict[int, Damage] = {}
    for k, whole in enumerate(kinds.example):
        mine = [
            d
            for d in places
            if whole != d.asked and header < alike(d.got, whole) and is_altered(d.got, whole)
            if _most_equal(d.got, (whole,)) > due[d.at]
        ]
        if len(mine) >= OVERLAPS and len(mine) > int(kinds.n[k]):
            out |= {d.at: d for d in mine}
    return list(out.values())


def _most_equal(got: bytes, frames: Sequence[bytes]) -> int:
    """Return how many bytes are as one of some frames has them at their place."""
    return max((sum(map(operator.eq, got, one)) for one in frames), default=0)
