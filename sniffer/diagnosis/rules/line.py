"""What happens to bytes on the line: who is damaged, where, in which bits, and when."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.damage import IN_REPLY, IN_REQUEST
from sniffer.diagnosis.model import Finding, Place

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "damage-everywhere",
        "line",
        "Frames of several senders are damaged, in about the share of what each says.",
        "At least three damaged places, of two senders or more, and no sender has far more than its share.",
    ),
    FindingCode(
        "damage-one-servo",
        "line",
        "The answers of one servo are damaged, and those of others hardly ever.",
        "Three damaged answers or more, and a share of its answers that is ten times that of all others.",
    ),
)

LEAST: Final = 3
"""Damaged places that make a pattern."""

AHEAD: Final = 10.0
"""How many times its share a servo must have to be the only one."""


def who_is_damaged(case: Case) -> Iterator[Finding]:
    """Tell whether one servo's answers are damaged, or everybody's frames."""
    d = case.damage
    torn = np.isin(d["turn"], (IN_REPLY, IN_REQUEST))
    total = int(d["n"][torn].sum())
    if total < LEAST or not case.ledger.frames:
        return
    replies = d["turn"] == IN_REPLY
    answered = {s: case.total("ok", s) + case.total("damaged", s) for s in case.servos}
    by_servo = {
        s: int(d["n"][replies & (d["servo_id"] == s)].sum()) for s in case.servos if answered[s]
    }
    rates = {s: n / max(answered[s], 1) for s, n in by_servo.items()}
    one = max(rates, key=lambda s: rates[s], default=None)
    if one is not None and by_servo[one] >= LEAST:
        others_n = total - by_servo[one]
        others = others_n / max(case.ledger.frames - answered[one], 1)
        if rates[one] >= AHEAD * max(others, 1e-9) and len(case.answering) > 1:
            rows = np.flatnonzero(replies & (d["servo_id"] == one))
            yield _damage(
                case,
                rows,
                "damage-one-servo",
                one,
                f"{by_servo[one]} of {answered[one]} answers of servo {one} are damaged, and "
                f"{others_n} of all {case.ledger.frames - answered[one]} other frames",
                f"answers of servo {one} damaged",
            )
            return
    senders = sum(n > 0 for n in by_servo.values()) + bool(d["n"][d["turn"] == IN_REQUEST].sum())
    if senders > 1:
        yield _damage(
            case,
            np.flatnonzero(torn),
            "damage-everywhere",
            None,
            f"{total} damaged places among {case.ledger.frames} frames, of {senders} senders",
            "frames of all senders damaged",
        )


def _damage(
    case: Case, rows: np.ndarray, code: str, servo: int | None, what: str, brief: str
) -> Finding:
    d = case.damage
    n = int(d["n"][rows].sum())
    return Finding(
        code,
        servo,
        int(d["t_first"][rows].min()),
        int(d["t_last"][rows].max()),
        n,
        what,
        tuple(
            Place(int(d["at"][r]), int(d["length"][r]), int(d["t_first"][r]), "damaged")
            for r in rows[:3]
        ),
        strength=min(0.5 + n / 20, 1.0),
        brief=brief,
    )


RULES: Final[tuple[Rule, ...]] = (who_is_damaged,)
"""The rules of this area."""
