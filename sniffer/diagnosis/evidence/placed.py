"""Whose a finding is, and what several damaged places say together."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.model import Finding, Place

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.damage import Damage
    from sniffer.diagnosis.ledger.silences import Silence

SHOWN: Final = 3
"""Places that a finding shows of many."""


HOLDS: Final = 0.02
"""Part of the bytes that were said which frames hold, at least: where next to nothing holds, what
looks like a torn frame is none, and the rate is another one, or the protocol."""


def is_talk(case: Case) -> bool:
    """Tell whether enough holds that what is torn can be a frame, too."""
    total = case.ledger.bytes
    in_frames = total - int(case.line["gap_bytes"].sum())
    return in_frames >= HOLDS * (total - case.held_bytes)


def single(case: Case, servo: int) -> int | None:
    """Return a servo, None where all or several are meant."""
    known = servo in case.answering or bool((case.writes["servo_id"] == servo).any())
    return servo if known and servo not in case.everyone else None


def silent(code: str, servo: int, runs: Sequence[Silence], what: str, strength: float) -> Finding:
    """Return a finding of stretches in which a servo answered nothing, without places."""
    return Finding(
        code, servo, runs[0].first_ns, runs[-1].back_ns or 0, len(runs), what, strength=strength
    )


def finding_of(
    damages: Sequence[Damage],
    code: str,
    servo_id: int | None,
    what: str,
    seen: str,
    *,
    strength: float = 1.0,
    brief: str = "",
    values: tuple[tuple[str, float], ...] = (),
) -> Finding:
    """Return what several places say together; ``seen`` is what each of them shows."""
    return Finding(
        code,
        servo_id,
        damages[0].t_ns,
        damages[-1].t_ns,
        len(damages),
        what,
        tuple(Place(d.at, d.length, d.t_ns, seen) for d in damages[:SHOWN]),
        strength=strength,
        brief=brief,
        values=values,
    )
