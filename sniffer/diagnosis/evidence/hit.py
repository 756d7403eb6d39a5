"""Servos whose answers are torn far oftener than those of others."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.ledger.damage import IN_REPLY

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.damage import Damage

LEAST: Final = 3
"""Torn answers that are no accident."""

AHEAD: Final = 3.0
"""How many times the others' share of torn answers a servo must have to be looked at."""

LOOKED: Final = 100
"""Torn answers of a servo that are looked at."""


def torn_answers(case: Case) -> dict[int, Sequence[Damage]]:
    """Return the torn answers of each servo that has far more of them than others."""
    out: dict[int, list[Damage]] = {}
    for d in case.damages:
        if d.turn == IN_REPLY and d.servo_id >= 0:
            out.setdefault(d.servo_id, []).append(d)
    frames = max(case.ledger.frames, 1)
    total = sum(len(torn) for torn in out.values())
    return {
        s: torn[:LOOKED]
        for s, torn in sorted(out.items())
        if len(torn) >= LEAST
        and len(torn) / (case.total("ok", s) + len(torn)) >= AHEAD * (total - len(torn)) / frames
    }
