"""What a servo was told: by itself, or with all others; its silences by orders to start anew."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.distinct import within
from sniffer.ground.model import MS
from sniffer.protocols.base import RESTARTS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.events import Happenings
    from sniffer.diagnosis.ledger.silences import Silence
    from sniffer.ground.model import I64

NEAR_NS: Final = 10 * MS
"""How long a request may take that is an order itself, and is answered."""


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
    to_all = within(h.servo_id, case.everyone) & ~within(h.at, h.at[own])
    mine = h.take(np.flatnonzero(own | to_all))
    return mine.take(np.argsort(mine.at, kind="stable"))


def told_to_start(case: Case, servo: int, some: Sequence[Silence]) -> Sequence[Silence]:
    """Return those of a servo's silences that begin with an order to start anew."""
    told = case.order_times(servo, RESTARTS)
    return [s for s in some if _has(told, s.before_ns, s.first_ns + MS)]


def started_behind(case: Case, servo: int, some: Sequence[Silence]) -> Sequence[Silence]:
    """Return those of a servo's silences behind whose first request it was told to start anew."""
    told = case.order_times(servo, RESTARTS)
    return [s for s in some if s.back_ns and _has(told, s.first_ns + MS, s.back_ns + NEAR_NS)]


def _has(times: I64, since_ns: int, until_ns: int) -> bool:
    return bool(((times >= since_ns) & (times <= until_ns)).any())
