"""Requests said into bare answers: what is left of one stands where a second answer would.

Answer and request begin together, and both are heard as one; behind the answer stands the end of
the request. Bare bytes are an answer by their looks, but these end as the request that is next::

    answer of 1             15 34
    request to 9      FF A9 00 29
    heard             15 34 0D 29
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.evidence.chances import at_least
from sniffer.diagnosis.ledger.damage import AT_TURN, IN_IDLE
from sniffer.ground.codes import RESPONSE

if TYPE_CHECKING:
    from collections.abc import Set

    from sniffer.diagnosis.case import Case

LEAST: Final = 3

PART: Final = 0.5
"""Part of what stands behind a servo's answers that must end as the next request does."""

USUAL: Final = 0.25
"""What follows an exchange in so many cases is due next."""

CHANCE: Final = 1e-6


def ends_of_requests(case: Case) -> Set[int]:
    """Return where ends of requests stand that were said into bare answers."""
    return case.once(_ends_of_requests)


def _ends_of_requests(case: Case) -> Set[int]:
    size = case.ledger.answer_length
    if not case.has_bare_answers or not size:
        return set()
    kinds, f = case.ledger.exchanges.kinds, case.ledger.exchanges.followers()
    last: dict[int, Counter[int]] = {}
    for kind, after, n in zip(*(f[c].tolist() for c in ("kind", "next", "n")), strict=True):
        if min(kind, after) >= 0:
            last.setdefault(kinds.servo_id[kind], Counter())[kinds.example[after][-1]] += n
    out: set[int] = set()
    for servo, ends in last.items():
        due = {byte for byte, n in ends.items() if n >= USUAL * ends.total()}
        behind = [
            d
            for d in case.damages
            if d.turn in (AT_TURN, IN_IDLE) and d.behind == RESPONSE and d.asked_id == servo
        ]
        fits = {d.at for d in behind if len(d.got) == d.length <= size and d.got[-1] in due}
        chance = at_least(len(fits), len(behind), len(due) / 256)
        if len(fits) >= max(LEAST, PART * len(behind)) and chance < CHANCE:
            out |= fits
    return out
