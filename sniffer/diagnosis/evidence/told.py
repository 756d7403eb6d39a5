"""What a servo was told: by itself, or with all others."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.events import Happenings


def told_to(case: Case, servo: int, *quantities: str) -> Happenings:
    """Return the settings of a servo, in order, with what all were told before it was known.

    What all are told stands for each servo whose setting is known as its own (``Settings``); of the
    others the frame to all tells alone.

    Args:
        case: what is known of a bus.
        servo: the servo.
        quantities: quantities, names or effects of registers, as ``Case.settings`` takes them.
    """
    h = case.settings(*quantities)
    own = h.servo_id == servo
    to_all = np.isin(h.servo_id, case.everyone) & ~np.isin(h.at, h.at[own])
    mine = h.take(np.flatnonzero(own | to_all))
    return mine.take(np.argsort(mine.at, kind="stable"))
