"""Servos whose clock is off, by what a tap hears of their answers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.placed import finding_of
from sniffer.diagnosis.ledger.damage import IN_REPLY, IN_REQUEST
from sniffer.diagnosis.physics.clocks import LEAST as SHORTEST
from sniffer.diagnosis.physics.clocks import LOOKED, clock_of
from sniffer.diagnosis.physics.misread import alike_of
from sniffer.diagnosis.rules.line.bits import APART, SAME
from sniffer.ground.codes import REQUEST
from sniffer.protocols.base import answer_begins

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.damage import Damage
    from sniffer.diagnosis.model import Finding
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "clock-off",
        "The torn answers of a servo are what a tap hears of a clock that is so much off.",
        "Its sound answers (where none was sound, with what the request has an answer begin), played at bits 2.5 to 10 % longer or shorter into a UART, give what was heard, in three of five torn ones.",
    ),
)


def clocks(case: Case) -> Iterator[Finding]:
    """Find servos whose torn answers are those of a clock that is off."""
    known = case.ledger.damages.likes.known
    like: dict[bytes, tuple[bytes, ...]] = {}
    for servo in case.servos:
        torn = [d for d in case.damages if d.turn == IN_REPLY and d.servo_id == servo]
        share = len(torn) / max(case.total("ok", servo) + len(torn), 1)
        # what stands behind a request to it, and need not be answered, may be its answer as well
        own = sum(
            d.turn == IN_REQUEST and d.behind == REQUEST and d.asked_id == servo
            for d in case.damages
        )
        rest = (len(case.damages) - len(torn) - own + 1) / max(case.ledger.frames, 1)
        if len(torn) < SAME or share < APART / 2 * rest:
            continue
        told = [(d.got, sound) for d in torn if (sound := _sound(case, d, known, like))]
        # it wanders while it warms up
        spread = told[:: -(-len(told) // LOOKED)] if told else ()
        found = clock_of(tuple(spread))
        if found is None or found.explained < SAME:
            continue
        slow = "slower" if found.off > 0 else "faster"
        yield finding_of(
            torn,
            "clock-off",
            servo,
            f"{found.explained} of {found.tried} torn answers of servo {servo} are what a tap hears "
            f"of a clock that is {abs(found.off):.1%} {slow}",
            "a torn answer",
            strength=min(0.5 + found.explained / 16, 1.0),
            brief=f"the clock of servo {servo} is {abs(found.off):.0%} {slow}",
            values=(("off", found.off),),
        )


def _sound(
    case: Case,
    d: Damage,
    known: Mapping[bytes, tuple[bytes, ...]],
    like: dict[bytes, tuple[bytes, ...]],
) -> tuple[bytes, ...]:
    """Return what a torn answer may have been: what was heard sound, else what must begin one.

    Nothing where that is too short to be compared. ``like`` keeps what others were told of the same
    request.
    """
    if not d.alike and d.asked in like:
        return like[d.asked]
    found = alike_of(d, known)
    if not found and d.asked:
        found = (answer_begins(case.protocol, d.asked),)
    found = found if min(map(len, found), default=0) >= SHORTEST else ()
    if not d.alike:
        like[d.asked] = found
    return found


RULES: Final[tuple[Rule, ...]] = (clocks,)
"""The rules of this area."""
