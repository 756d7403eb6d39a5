"""Torn frames that hold: a checksum lets pass what is misread twice in the same bit.

An XOR does so for any bit, a sum for the last one: both ways of it cancel, and 80 twice is 100::

    48 12 7F D4 .. 5B       sound
    48 92 FF D4 .. 5B       bit 7 of two bytes, and the sum is the same

So where many answers of a servo are torn, some of those that hold are not as they were sent, and
where it is always the same bit, as many as are torn; where requests are, some of those.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.ledger.damage import IN_REPLY, IN_REQUEST

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.model import Finding

LEAST: Final = 4
"""Torn frames that make a pattern."""

PURE: Final = 0.9
"""Part of them that must be torn in that bit."""

SHARE: Final = 0.02
"""Part of a sender's frames that must be torn: with fewer, hardly one is hit twice."""

BY_CHANCE: Final = 1 / 64
"""Part of torn frames that hold whatever tears them: its check has seven or eight bits."""

TWICE: Final = 1 / 8
"""Part of those hit twice that an XOR lets pass: the second hit falls on the bit of the first."""

CONTROLLER: Final = -1

MEASURED: Final = frozenset(
    {"voltage-sag", "position-jumps", "temperature-high", "torque-gone", "back-at-defaults"}
)
"""Findings that few values make, which answers state."""

COMMANDED: Final = frozenset(
    {"writes-part", "writes-read-only", "torque-gone", "goals-without-torque", "goal-beyond-limits"}
    | {"position-jumps", "goal-beyond-range", "goal-jump", "writes-unnamed"}
)
"""Those that few requests make."""


def misread_senders(case: Case) -> Mapping[int, int]:
    """Return how many frames of a sender may be torn and hold, where they may (-1: requests)."""
    bits: dict[int, Counter[int]] = {}
    for m in case.misreads:
        hit = bits.setdefault(m.servo_id, Counter())
        if m.bit >= 0:
            hit[m.bit] += 1
    out = {}
    for sender, hit in bits.items():
        turn = case.damage["turn"]
        if sender == CONTROLLER:
            rows = turn == IN_REQUEST
            said = int(case.traffic["requests"].sum())
        else:
            rows = (turn == IN_REPLY) & (case.damage["servo_id"] == sender)
            said = case.total("ok", sender)
        torn, total = int(case.damage["n"][rows].sum()), hit.total()
        share = torn / max(torn + said, 1)
        if torn < LEAST or share < SHARE:
            continue
        is_one_bit = total >= LEAST and hit.most_common(1)[0][1] >= PURE * total
        out[sender] = torn if is_one_bit else int(1 + torn * (BY_CHANCE + TWICE * share))
    return out


def without_passed(case: Case, found: Sequence[Finding]) -> list[Finding]:
    """Return findings without those that torn frames which hold may make, by how many those are."""
    passed = misread_senders(case)
    if not passed:
        return list(found)

    def may_be_torn(f: Finding) -> bool:
        asked = passed.get(CONTROLLER, 0) if f.code in COMMANDED else 0
        said = passed.get(CONTROLLER if f.servo_id is None else f.servo_id, 0)
        return f.count <= max(asked, said if f.code in MEASURED else 0)

    return [f for f in found if not may_be_torn(f)]
