"""Outages of one servo that are too few for a habit: what is known of them, and nothing besides."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.outages import answered_meanwhile, seldom_away
from sniffer.diagnosis.model import Finding, Place
from sniffer.ground.wording import counted

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.silences import Silence
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "away-seldom",
        "One servo was away once or twice, for requests in a row, and most others were there.",
        "One or two outages of three requests in a row or more (two, where single ones are not lost), however often it is asked, one loss beside them at most; less than half of the others are away meanwhile. One that lasts until the end is of fewer than five requests, and longer than a quarter of a second, shorter than the longest start of these servos, three seconds.",
    ),
)


def seldom(case: Case) -> Iterator[Finding]:
    """Find servos that were away once or twice, while others were there."""
    for servo in case.answering:
        away = seldom_away(case, servo)
        if away:
            yield Finding(
                "away-seldom",
                servo,
                away[0].first_ns,
                away[-1].back_ns or case.last_ns,
                len(away),
                f"servo {servo} was away {('once', 'twice')[len(away) - 1]}, and lost hardly "
                f"anything else of {counted(case.total('asked', servo), 'answer')}; "
                f"{_meanwhile(case, servo, away)}",
                tuple(
                    Place(s.at, s.length, s.first_ns, "the first request without an answer")
                    for s in away
                ),
                episodes=tuple((s.first_ns, s.back_ns or case.last_ns) for s in away),
            )


def _meanwhile(case: Case, servo: int, away: Sequence[Silence]) -> str:
    """Return what others did meanwhile, in words."""
    others = len(case.answering) - 1
    if not others:
        return "nobody else is there"
    answered = set.union(*(set(answered_meanwhile(case, servo, one)) for one in away))
    if not answered:
        return "no other was asked meanwhile"
    return (
        f"{len(answered)} of {counted(others, 'other')} answered all that they were asked meanwhile"
    )


RULES: Final[tuple[Rule, ...]] = (seldom,)
"""The rules of this file."""
