"""Frames that nobody drives at their beginning or their end: drivers that are on or off at the wrong time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import sureness
from sniffer.diagnosis.evidence.placed import finding_of
from sniffer.diagnosis.evidence.undriven import CONTROLLER, undriven

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.evidence.undriven import Undriven
    from sniffer.diagnosis.ledger.damage import Damage
    from sniffer.diagnosis.model import Finding
    from sniffer.diagnosis.rules import Rule

_KNOWN_BY: Final = (
    "Three torn frames or more of one sender, half of those that are torn, hold with {} put back, and "
    "what was heard is what a UART makes of them while the line is high there; "
    "hardly any lack the other end, which chance would take as often; the other side's do not. Not of answers without a header and a checksum."
)

FINDINGS: Final = (
    FindingCode(
        "answers-begin-undriven",
        "Nobody drives the line for the first bits of answers: the servo's driver is on too late, or the controller's off too late.",
        _KNOWN_BY.format("their first bits"),
        is_manner=True,
        remedy="Where all lose it that answer soon, switch the controller's driver off right after its last stop bit, or raise the return delay; where one servo alone does, its own driver is on too late.",
    ),
    FindingCode(
        "answers-end-undriven",
        "Nobody drives the line for the last bits of answers: the servo's driver is off too early.",
        _KNOWN_BY.format("their last bits"),
        is_manner=True,
        remedy="The driver of the servo lets the line go before its last byte is over: update its firmware or replace it; bias resistors that pull the line high do not help.",
        concerns="",
    ),
    FindingCode(
        "requests-begin-undriven",
        "Nobody drives the line for the first bits of requests: the controller's driver is on too late.",
        _KNOWN_BY.format("their first bits"),
        is_manner=True,
        remedy="Switch the controller's driver on a bit or two before its first byte.",
        concerns="",
    ),
    FindingCode(
        "requests-end-undriven",
        "Nobody drives the line for the last bits of requests: the controller's driver is off too early.",
        _KNOWN_BY.format("their last bits"),
        is_manner=True,
        remedy="Keep the controller's driver on until its last stop bit is over: wait for the UART to be empty (transmission complete), not for its buffer.",
        concerns="",
    ),
)

LEAST: Final = 3

MOST: Final = 0.5
"""Part of one sender's torn frames that must lack the same end: noise tears others beside."""

CHANCE: Final = 1e-2
"""What is as likely as that by chance is no driver: lost bytes may be the first ones of three."""

ENOUGH: Final = 1e-3
"""How likely it may be by chance where it counts in full."""


class _End(NamedTuple):
    """One end of what one side says: in codes, and in words."""

    code: str
    what: str
    brief: str


_BEGIN: Final = _End("begin", "first bits", "nobody drives the first bits of")
_END: Final = _End("end", "last bits", "nobody drives the last bits of")


def undriven_ends(case: Case) -> Iterator[Finding]:
    """Find senders whose frames lack the bits at one end."""
    senders = undriven(case)
    begins = {s: (one.begins, one.chance_of_begins()) for s, one in senders.items()}
    ends = {s: (one.ends, one.chance_of_ends()) for s, one in senders.items()}
    for end, lacking in ((_BEGIN, begins), (_END, ends)):
        told = [
            _told(sender, senders[sender], end, *of)
            for sender, of in lacking.items()
            if _is_no_chance(senders[sender], *of)
        ]
        # what is lost of whoever speaks is lost by who listens
        if len({f.servo_id is None for f in told}) == 1:
            yield from told


def _is_no_chance(one: Undriven, lacking: Sequence[Damage], chance: float) -> bool:
    return len(lacking) >= max(LEAST, MOST * one.torn) and chance <= CHANCE


def _told(
    sender: int, one: Undriven, end: _End, lacking: Sequence[Damage], chance: float
) -> Finding:
    by_controller = sender == CONTROLLER
    side = "requests" if by_controller else "answers"
    whose = "requests" if by_controller else f"answers of servo {sender}"
    return finding_of(
        lacking,
        f"{side}-{end.code}-undriven",
        None if by_controller else sender,
        f"{len(lacking)} of {one.torn} torn {whose} are what is heard where nobody drives their "
        f"{end.what}",
        "a frame that lacks bits at one end",
        strength=sureness(chance, ENOUGH),
        brief=f"{end.brief} {whose}",
    )


RULES: Final[tuple[Rule, ...]] = (undriven_ends,)
"""The rules of this area."""
