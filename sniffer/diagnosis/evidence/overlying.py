"""A servo whose answers come when others are asked already, and lie over theirs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sniffer.diagnosis.evidence.overdue import overdue
from sniffer.diagnosis.evidence.twins import twins

if TYPE_CHECKING:
    from sniffer.diagnosis.case import Case


def lies_over(case: Case) -> int:
    """Return the servo whose answers are overdue and, by their bytes, lie over another's; -1."""
    late = overdue(case)
    twin = None if late is None else twins(case).get(late.servo_id)
    return -1 if twin is None or twin.over < 0 else twin.servo_id
