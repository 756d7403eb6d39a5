"""Questions to all servos at once: their answers lie over each other."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.placed import finding_of
from sniffer.diagnosis.ledger.damage import HELD, REST
from sniffer.ground.codes import REQUEST

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.model import Finding
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "all-asked-at-once",
        "All servos are asked at once, and what comes back is torn: several answer together.",
        "Nine tenths of what is torn begin right behind questions to all, five times and more, where hardly a question to one servo has a torn answer.",
        settle="Ask one servo by its own id: its answer is whole.",
        remedy="Ask servo after servo by their ids: a question to all is for a line with one servo on it.",
    ),
)

LEAST: Final = 5
NEARLY: Final = 0.9
"""Torn places behind questions to all, and their part of those that begin behind a frame."""


def all_asked(case: Case) -> Iterator[Finding]:
    """Torn bytes behind questions to all servos, and nowhere else."""
    ends: set[int] = set()
    torn = []
    for d in case.damages:  # pieces of one heap begin where the one before ends
        if d.at not in ends and d.turn not in (HELD, REST):
            torn.append(d)
        ends.add(d.at + d.length)
    behind = [d for d in torn if d.behind == REQUEST and d.asked_id in case.everyone]
    if len(behind) < LEAST or len(behind) < NEARLY * len(torn):
        return
    asked = sum(case.count("damaged-response", servo_id=servo) for servo in case.everyone)
    if 2 * asked < len(behind):
        return  # what states goals for all asks for no answer
    yield finding_of(
        behind,
        "all-asked-at-once",
        None,
        f"{len(behind)} of {len(torn)} torn places stand right behind questions to all servos: "
        "several answer at once",
        "torn, behind a question to all",
        strength=min(0.6 + len(behind) / 25, 1.0),
        brief="all are asked at once, and answer together",
    )


RULES: Final[tuple[Rule, ...]] = (all_asked,)
"""The rules of this area."""
