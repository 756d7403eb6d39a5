"""Frames that are torn at one end: the first byte of answers, the last one of requests."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import at_least, sureness
from sniffer.diagnosis.evidence.fronts import EITHER, IN_FRONT, is_hit, torn_in_front
from sniffer.diagnosis.evidence.signs import BARE
from sniffer.diagnosis.ledger.damage import IN_IDLE, IN_REPLY
from sniffer.diagnosis.physics.misread import BACK, BITS_FEW, FRONT, OTHER
from sniffer.diagnosis.physics.uart import FALLS
from sniffer.diagnosis.rules.line.bits import bits_finding

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.model import Finding
    from sniffer.diagnosis.physics.misread import Misread
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "first-byte-torn",
        "It is the first byte of answers that is torn or missing.",
        "At least three torn answers, three quarters of them with nothing wrong but the first byte or two; "
        "not what begins with the first byte of requests, which is another one; "
        "it counts as much as chance seldom does so.",
        is_manner=True,
    ),
    FindingCode(
        "answers-torn-anywhere",
        "Answers are torn at any of their bytes, and not at their beginning or end.",
        "Of eight torn answers and more whose wrong bytes are known half have them behind the second byte and before the last one.",
        is_manner=True,
    ),
    FindingCode(
        "last-byte-torn",
        "It is the last byte of requests that is torn or missing.",
        "At least three torn requests, three quarters of them with nothing wrong but the last byte; "
        "it counts as much as chance seldom does so.",
        is_manner=True,
    ),
)

LEAST: Final = 3

MOST: Final = 0.75
"""Part of the torn frames that must be torn at one end."""

MANY: Final = 8
HALF: Final = 0.5
"""Torn answers, and the part of them that is wrong within, where it is not their ends that are."""

KNOWN: Final = 0.25
"""Part of the torn frames at least of which one must know where they are torn."""


ENOUGH: Final = 1e-3
"""How likely it may be by chance where it counts in full."""


def ends(case: Case) -> Iterator[Finding]:
    """Tell whether frames are torn at one end only."""
    answers = [m for m in case.misreads if m.damage.turn == IN_REPLY]
    requests = [m for m in case.misreads if m.damage.turn != IN_REPLY]
    first = case.once(torn_in_front)
    if _mostly(first, answers):
        yield bits_finding(
            "first-byte-torn",
            first,
            f"{len(first)} of {len(answers)} torn answers lack their first byte, or it is wrong",
            "the first byte of answers is torn",
            _strength(first, answers, IN_FRONT),
        )
    last = [
        m for m in requests if _cut(m) or (is_hit(m) and min(m.bytes_hit) == m.damage.length - 1)
    ]
    if _mostly(last, requests):
        yield bits_finding(
            "last-byte-torn",
            last,
            f"{len(last)} of {len(requests)} torn requests lack their last byte, or it is wrong",
            "the last byte of requests is torn",
            _strength(last, requests, 1),
        )


def torn_anywhere(case: Case) -> Iterator[Finding]:
    """Tell whether answers are torn at any of their bytes: a change of direction tears their ends."""
    known = [m for m in case.misreads if m.damage.turn == IN_REPLY and is_hit(m)]
    within = [
        m for m in known if min(m.bytes_hit) >= IN_FRONT and max(m.bytes_hit) < m.damage.length - 1
    ]
    if len(within) >= MANY and len(within) >= HALF * len(known):
        yield bits_finding(
            "answers-torn-anywhere",
            within,
            f"{len(within)} of {len(known)} torn answers whose wrong bytes are known have these neither "
            "at their beginning nor at their end",
            "wrong within an answer",
            1.0,
        )


def strays_before(case: Case) -> Iterator[Finding]:
    """Find bare answers with a stray byte before them: there is no header that tells the two apart."""
    answers = [m for m in case.misreads if m.damage.turn == IN_REPLY and m.damage.alike]
    before = [
        m
        for m in answers
        if 1 <= m.damage.length - len(m.damage.expected) <= 2
        and m.damage.got[0] in FALLS
        and len(m.damage.expected) <= BARE
    ]
    alone = len({m.servo_id for m in before}) == 1 and len(case.answering) > 1
    alone = alone or len(before) < LEAST * sum(d.turn == IN_IDLE for d in case.damages)
    if len(before) >= 2 * LEAST and len(before) >= MOST * len(answers) and not alone:
        yield bits_finding(
            "strays-at-turn",
            before,
            f"{len(before)} of {len(answers)} torn answers have a stray byte more at their beginning",
            "stray bytes before answers",
            min(0.4 + 0.1 * len(before), 1.0),
        )


def may_be_cut(m: Misread) -> bool:
    """Tell whether it may be the last byte alone that is torn: it is, or nobody knows which one."""
    if m.shape == BITS_FEW:
        return not m.bytes_hit or max(m.bytes_hit) == m.damage.length - 1
    if m.shape == OTHER:  # as long as it was meant to be: the sum of what it states may be torn
        return m.damage.length == len(m.damage.expected) == len(m.damage.got)
    return _cut(m)


def _mostly(some: Sequence[Misread], torn: Sequence[Misread]) -> bool:
    """Tell whether most of the torn frames of which one knows where they are torn are these."""
    known = sum(m in some or m.shape in (FRONT, BACK) or is_hit(m) for m in torn)
    return len(some) >= max(LEAST, MOST * known, KNOWN * len(torn))


def _strength(some: Sequence[Misread], torn: Sequence[Misread], at_end: int) -> float:
    """Return how much it counts: by its chance, and little where one does not know of most where they are torn.

    Noise hits the bytes at one end, ``at_end`` of them, as often as any others.
    """
    known = [m for m in torn if m in some or m.shape in (FRONT, BACK) or is_hit(m)]
    chances = [at_end / max(m.damage.length, at_end) if is_hit(m) else EITHER for m in known]
    chance = at_least(len(some), len(known), sum(chances) / len(known))
    return sureness(chance, ENOUGH) * min(len(some) / (MOST * len(torn)), 1.0)


def _cut(m: Misread) -> bool:
    return m.shape == BACK and len(m.damage.expected) - m.damage.length == 1


RULES: Final[tuple[Rule, ...]] = (ends, torn_anywhere, strays_before)
"""The rules of this area."""
