"""Checksums that are wrong in one way: a controller computes them so, or a clock ends them so."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING, Final

from sniffer.decoding.sums import wrong_sums
from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import at_least, sureness
from sniffer.diagnosis.evidence.placed import finding_of
from sniffer.diagnosis.ledger.damage import IN_REPLY
from sniffer.diagnosis.model import Finding, Place

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.damage import Damage
    from sniffer.diagnosis.rules import Rule
    from sniffer.protocols.base import BusProtocol

FINDINGS: Final = (
    FindingCode(
        "sums-wrong",
        "Packets fail their checksum, and all in one way: it is computed wrongly.",
        "Four fifths of the packets that are whole but for their checksum have what another formula gives: "
        "inverted or not, negated, XOR for sum, over other bytes; or always the same value.",
    ),
)

FIRST_BITS: Final = 0x07
"""Bits that a clock has right which is off by a tenth. A sum or an XOR of bytes whose first bits are
right has them right as well: it carries nothing from the last bits to the first ones."""

BY_CHANCE: Final = 1 / (FIRST_BITS + 1)

LEAST: Final = 8
"""Torn answers, no two alike, that tell."""

WAYS: Final = 3
"""Ways in which their checksums must be wrong: what alters one bit and no other is no clock."""

PURE: Final = 0.9
"""Part of a servo's torn answers that must end wrong so, and part of all that do which must be its."""

CONTROLLER: Final = -1


def sums_wrong(case: Case) -> Iterator[Finding]:
    """Look whether the checksums that fail were computed in another way."""
    if case.lost_ns is None:
        return
    holds = case.ledger.frames > 0
    found = wrong_sums(case.ledger.head, case.protocol if holds else None)
    if found is None:
        return
    first_ns, last_ns = case.lost_ns
    yield Finding(
        "sums-wrong",
        None,
        first_ns,
        last_ns,
        found.packets,
        str(found),
        tuple(Place(at, length, first_ns, "its checksum is wrong") for at, length in found.at),
        brief="checksums are computed wrongly",
    )


def sums_end_wrong(case: Case) -> Iterator[Finding]:
    """Find the servo whose torn answers have checksums that are right but for their last bits.

    That tells which bits were misread where no answer of it was ever whole.
    """
    torn: dict[int, dict[bytes, Damage]] = defaultdict(dict)
    for d in case.damages:
        if d.length == len(d.got):
            torn[d.servo_id if d.turn == IN_REPLY else CONTROLLER].setdefault(d.got, d)
    ending = {
        sender: [d for d in some.values() if _ends_wrong(_wrong_bits(case.protocol, d.got))]
        for sender, some in torn.items()
    }
    of_all = sum(map(len, ending.values()))
    for servo in case.servos:
        mine, read = ending.get(servo, []), len(torn[servo])
        ways = {_wrong_bits(case.protocol, d.got) for d in mine}
        if len(mine) < max(LEAST, PURE * read, PURE * of_all) or len(ways) < WAYS:
            continue
        yield finding_of(
            mine,
            "last-bits",
            servo,
            f"in {len(mine)} of {read} torn answers of servo {servo} the checksum is right but for its "
            "last bits",
            "its checksum ends wrong",
            strength=sureness(at_least(len(mine), read, BY_CHANCE)),
            brief=f"the last bits of servo {servo} are misread",
        )


def _ends_wrong(wrong: int) -> bool:
    """Tell whether a checksum is right in its first bits, and wrong behind them."""
    return wrong > FIRST_BITS and not wrong & FIRST_BITS


def _wrong_bits(protocol: BusProtocol, got: bytes) -> int:
    """Return in which bits the checksum of torn bytes is wrong; 0 where they have none."""
    checksum = protocol.checksum_of(got)
    if checksum is None:
        return 0
    how, counted, sent = checksum
    return how(counted) ^ sent


RULES: Final[tuple[Rule, ...]] = (sums_wrong, sums_end_wrong)
"""The rules of this file."""
