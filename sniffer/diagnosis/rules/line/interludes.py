"""What is spoken for a while that is not this protocol, on a line that is sound before and behind."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.interlude import interlude
from sniffer.diagnosis.model import Finding, Place

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule

WHOSE: Final = (
    "Ask who spoke then: a loader that updates a servo, another program, this one at another rate. "
    "If it was meant nothing is to be mended; decode that part by itself to know it."
)

FINDINGS: Final = (
    FindingCode(
        "spoken-between",
        "For one stretch of the time something is spoken that is no frame, and before and behind it all is sound.",
        "All bytes that are in no frame lie in one stretch of a second and more, a thousand at least, in rows as long as packets and with pauses between; hardly a frame holds in it. Needs times.",
        remedy=WHOSE,
        settle=WHOSE,
    ),
)


def spoken_between(case: Case) -> Iterator[Finding]:
    """Find the stretch in which another protocol, or at another rate, is spoken."""
    found = interlude(case)
    if found is None:
        return
    since, until = case.since(found.first_ns), case.since(found.last_ns)
    yield Finding(
        "spoken-between",
        None,
        found.first_ns,
        found.last_ns,
        1,
        f"from {since} to {until} {found.size} bytes are in no frame, and not one byte before "
        "and behind",
        (Place(found.at, 1, found.first_ns, "the first byte that is in no frame"),),
        brief=f"something else is spoken from {since} to {until}",
    )


RULES: Final[tuple[Rule, ...]] = (spoken_between,)
"""The rules of this file."""
