"""A ledger with what it withholds: requests that are excused as long as an answer may come yet."""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sniffer.diagnosis.ledger.ledger import Ledger


def with_withheld(ledger: Ledger) -> Ledger:
    """Return what is known by now: with requests that are excused if they are answered yet."""
    held = ledger.excused.withheld()
    if held is None:
        return ledger
    out = copy.copy(ledger)
    out.answers, out.alarms = ledger.answers.copy(), ledger.alarms.copy()
    out.events = ledger.events.copy()
    out.silences = copy.deepcopy(ledger.silences)
    out.count_in_vain(held)
    return out
