"""Servos behind whose torn answers the next request to them is missing: it was said into these.

Two answers at once look much the same as an answer and a request to that servo: both name it. But
a second servo of the same id takes no request away.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.evidence.order import Order
from sniffer.ground.codes import DAMAGED

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.exchanges import Failed

LEAST: Final = 5

NEARLY: Final = 0.8
"""Part of a servo's torn answers behind which the request must be missing."""


def swallowing(case: Case) -> Mapping[int, Sequence[Failed]]:
    """Return the torn exchanges of each servo that is asked no more behind them, as others are."""
    return case.once(_swallowing)


def _swallowing(case: Case) -> Mapping[int, Sequence[Failed]]:
    order = case.once(Order)
    torn: dict[int, list[Failed]] = {}
    for f in case.ledger.exchanges.failed:
        if f.outcome == DAMAGED and f.kind >= 0:
            torn.setdefault(f.servo_id, []).append(f)
    lacking = {
        s: [f for f in some if order.leaves_servo(f.kind, f.next_kind)] for s, some in torn.items()
    }
    return {
        s: some for s, some in lacking.items() if len(some) >= max(LEAST, NEARLY * len(torn[s]))
    }
