"""What to do next about an incident, in the words of the bus at hand."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.anomalies.catalogue import CATALOGUE
from sniffer.diagnosis.causes import CAUSES, DELAY
from sniffer.diagnosis.rules import FINDINGS
from sniffer.protocols.base import reply_delay_ns

if TYPE_CHECKING:
    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.weighing import Explained
    from sniffer.ground.register import Register

SURE: Final = 0.8
"""From this confidence on the next step is the remedy, below it what settles the matter."""

OF_ALL: Final[dict[str, str]] = {
    "servo-dead": "Look at what all of them share: the supply, its switch and fuse, the cable.",
}
"""The remedy where it happens to every servo that ever answered: none of them is to blame then."""

OF_THE_TAP: Final = frozenset(code for code, entry in CATALOGUE.items() if entry.group == "capture")
"""What a tap met itself: codes of anomalies that have their own remedy."""


def next_of(case: Case, explained: Explained) -> str:
    """Return the remedy of the first cause where it is sure, else what tells it from the second."""
    first, *others = explained.causes
    cause = CAUSES[first.cause]
    code = explained.key.code
    sign = FINDINGS.get(code)
    # what the tap itself told knows better than its cause what became of it
    told = CATALOGUE[code].remedy if code in OF_THE_TAP else ""
    concern = cause.concerns if sign is None or sign.concerns is None else sign.concerns
    where = _where(case, concern, explained.servo_ids)
    of_all = OF_ALL.get(first.cause, "")
    if of_all and len(case.answering) > 1 and set(case.answering) <= set(explained.servo_ids):
        return of_all
    may_be = [f"that of servo {servo}" for servo in explained.key.may_be]
    may_be += [CAUSES[others[0].cause].title] if others else []
    its_own = sign.settle if sign else ""
    if first.confidence < SURE and (may_be or its_own):
        instead = f" (It may be {may_be[0]} instead.)" if may_be else ""
        return f"{its_own or cause.settle}{where}{instead}"
    known = (sign and sign.remedy) or told
    return (known or (cause.remedy if first.confidence >= SURE else cause.settle)) + where


def _where(case: Case, concern: str, servo_ids: tuple[int, ...]) -> str:
    """Name the register that it is about as the table of the servos' model has it."""
    known = {case.ledger.models.get(servo, ("", 0))[0] for servo in servo_ids}
    for r in case.protocol.registers if concern else ():
        if r.address >= 0 and known <= {"", r.model} and _is_of(case, r, concern):
            return f" (Register `{r.name}`, address 0x{r.address:02X}.)"
    return ""


def _is_of(case: Case, register: Register, concern: str) -> bool:
    if concern == DELAY:
        return reply_delay_ns(case.protocol, register, 1) is not None
    return concern in (register.quantity, register.effect)
