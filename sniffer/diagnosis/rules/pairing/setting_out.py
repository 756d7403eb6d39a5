"""Outages that begin as motors set out: a supply that does not bear what they take."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import sureness
from sniffer.diagnosis.evidence.goal_steps import BEHIND_NS, set_out
from sniffer.diagnosis.evidence.placed import silent
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.model import Finding
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "outages-behind-steps",
        "A servo goes away just after goals jump, and hardly ever else.",
        "Five outages and more, nine in ten of which begin within three quarters of a second behind a step of goals that stands alone, in which part of the time chance puts so many once in a thousand times; none before.",
        settle="Measure the supply at this servo with an oscilloscope as it sets out, and send it there slowly: what goes away no more was short of current.",
    ),
)

ENOUGH: Final = 1e-5
"""How likely so many are there by chance, where they count in full."""


def outages_behind_steps(case: Case) -> Iterator[Finding]:
    """Find servos that are away behind steps of goals."""
    for servo in case.answering:
        if (found := set_out(case, servo)) is not None:
            yield silent(
                "outages-behind-steps",
                servo,
                found.runs,
                f"{found.behind} of {len(found.runs)} outages of servo {servo} begin within "
                f"{BEHIND_NS / NS:.2f} s behind steps of goals, which is {found.share:.0%} of the time",
                sureness(found.chance, ENOUGH),
            )


RULES: Final[tuple[Rule, ...]] = (outages_behind_steps,)
"""The rules of this file."""
