"""Checksums that are wrong in one way: the controller computes them so."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.decoding.sums import wrong_sums
from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.model import Finding, Place

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "sums-wrong",
        "controller",
        "Packets fail their checksum, and all in one way: it is computed wrongly.",
        "Four fifths of the packets that are whole but for their checksum have what another formula gives: "
        "inverted or not, negated, XOR for sum, over other bytes; or always the same value.",
    ),
)


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


RULES: Final[tuple[Rule, ...]] = (sums_wrong,)
"""The rules of this file."""
