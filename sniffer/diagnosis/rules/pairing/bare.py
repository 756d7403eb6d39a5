"""A device that speaks unasked where answers are bare bytes: what it says is noise by its looks."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import at_least
from sniffer.diagnosis.evidence.placed import finding_of
from sniffer.diagnosis.evidence.tracks import in_force
from sniffer.diagnosis.ledger.damage import IN_REPLY
from sniffer.diagnosis.rules.pairing.unasked import ALONE, EITHER, UNASKED, unlikely
from sniffer.ground.codes import RESPONSE
from sniffer.ground.gaps import NOISE
from sniffer.ground.medians import median
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.damage import Damage
    from sniffer.diagnosis.model import Finding
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import F64

FINDINGS: Final = (
    FindingCode(
        "seconds-follow-another",
        "What stands behind a servo's answers tells where another one is, and goes with that one as it moves.",
        "Bare pieces of an answer's length behind the exchanges of one servo, of which seven tenths tell where another servo was last, within twelve steps; every other servo is twice as far from them. They go over twelve steps and more, and come and go beside this one half as much again. By a clock.",
    ),
)

BARE_SHARE: Final = 0.7
"""Of bytes that are noise by their looks so many fit one servo if they are its: by chance a tenth."""

NEAR_RAW: Final = 3
"""Steps that a joint may have moved since its last answer."""

FARTHER: Final = 2.0
"""How many times as far they must be from where every other servo is."""

APART: Final = 1.5
"""How many times as much they must come and go beside the servo behind whose answers they are."""

MOVED: Final = 4 * NEAR_RAW
"""Steps over which what goes with a joint is its own: by chance a few pieces are near it at one place."""


def _mostly_behind(pieces: Sequence[Damage]) -> tuple[list[Damage], int]:
    """Return those right behind an answer of the servo behind which most are, and which it is."""
    behind = [d for d in pieces if d.behind == RESPONSE and d.asked_id >= 0]
    count = Counter(d.asked_id for d in behind)
    whose = max(count, key=lambda servo: count[servo], default=-1)
    return [d for d in behind if d.asked_id == whose], whose


class _BareWords(NamedTuple):
    """What may be bare answers between the frames.

    ``behind`` are those behind answers of the servo ``whose``, behind which most are; ``theirs``
    those that go with the servo ``other`` instead, none where no other is plain.
    """

    alike: Sequence[Damage]
    behind: Sequence[Damage]
    whose: int
    other: int
    theirs: Sequence[Damage]


def _heard(case: Case) -> _BareWords:
    alike = _words(case)
    behind, whose = _mostly_behind(alike)
    return _BareWords(alike, behind, whose, *_followed(case, whose, alike))


def _words(case: Case) -> list[Damage]:
    """Return what stands between the frames and may be bare answers; none where more is torn."""
    size = case.ledger.answer_length
    if not case.has_bare_answers or not size:
        return []
    # what stands in the place of an answer was asked for, though the request may be torn
    ends = {d.at + d.length for d in case.damages if d.kind != NOISE}
    stray = [d for d in case.damages if d.kind == NOISE and d.turn != IN_REPLY and d.at not in ends]
    alike = [d for d in stray if len(d.got) == d.length == size]
    return alike if len(alike) >= max(UNASKED, BARE_SHARE * len(stray)) else []


def said_by_another(case: Case) -> int:
    """Return the servo behind whose answers another one says where it is; -1: none."""
    words = case.once(_heard)
    return words.whose if words.theirs else -1


def chatty_bare(case: Case) -> Iterator[Finding]:
    """A device that speaks unasked where answers are bare bytes: they are noise by their looks."""
    size = case.ledger.answer_length
    alike, behind, whose, other, theirs = case.once(_heard)
    if not alike:
        return
    told: dict[int, Sequence[Damage]] = {
        s: mine for s in case.answering if (mine := _would_be_answers(case, s, alike, size))
    }
    chance = at_least(len(behind), len(alike), case.total("asked", whose) / case.total("asked"))
    # all of it behind one servo's answers may as well be that one's second answers
    is_either = chance < ALONE
    if is_either and whose in told:
        told = {whose: told[whose]}  # two joints may be near each other: not both have a second one
        yield finding_of(
            behind,
            "behind-its-own-alone",
            whose,
            f"{len(behind)} of {len(alike)} such pieces came right behind an answer of servo {whose}",
            "the second of two answers",
            strength=unlikely(chance),
            brief=f"a second servo {whose} answers now and then",
        )
    if theirs and whose not in told:
        # a second one of that other one, late, says the same: prompt stamps tell how late
        told, is_either = {other: theirs}, not case.has_prompt_stamps
        if behind:
            yield finding_of(
                behind,
                "seconds-follow-another",
                whose,
                f"{len(behind)} pieces behind answers of servo {whose} tell where servo {other} is, "
                "and go with it",
                "tells where another servo is",
                brief=f"what stands behind servo {whose} is another's",
            )
    for servo, fits in told.items():
        yield finding_of(
            fits,
            "speaks-unasked",
            servo,
            f"{len(fits)} times {size} bytes stand between the frames that would be an answer of "
            f"servo {servo}, where it is at the moment",
            "would be an answer",
            strength=min(0.5 + len(fits) / 25, 0.9) * (EITHER if is_either else 1.0),
            brief=f"servo {servo} speaks unasked",
        )


def _followed(case: Case, whose: int, pieces: Sequence[Damage]) -> tuple[int, Sequence[Damage]]:
    """Return with which servo pieces go that stand behind another's answers, and those that do.

    A second one of that other one moves as it does, at some distance. None: as well with two.
    """
    away = {s: x for s in case.answering if pieces and len(x := _away(case, s, pieces))}
    if not case.has_clock or len(away) < 2:
        return -1, ()
    far = {s: float(median(np.abs(x))) for s, x in away.items()}
    servo, next_one = sorted(far, key=lambda s: far[s])[:2]
    near = max(far[servo], 1.0)
    beside = away[whose] - median(away[whose]) if whose in away else away[next_one]
    if servo == whose or far[next_one] < FARTHER * near:
        return -1, ()
    fits = [d for d, x in zip(pieces, away[servo].tolist(), strict=True) if abs(x) <= MOVED + near]
    said = np.array([d.got[k] for d in fits for k in (0, -1)]).reshape(-1, 2)
    moved = float(np.ptp(said, axis=0).max()) if len(fits) >= UNASKED else 0.0
    if moved < MOVED or median(np.abs(beside)) < APART * near:
        return -1, ()
    return servo, fits if len(fits) >= BARE_SHARE * len(pieces) else ()


def _away(case: Case, servo: int, pieces: Sequence[Damage]) -> F64:
    """Return how far each piece is from where a servo was when it said so last, in steps."""
    p = case.series(servo, "position")
    if p is None:
        return np.zeros(0)
    row = np.maximum(np.searchsorted(p.t_first, [d.t_ns for d in pieces], "right") - 1, 0)
    at = (p.mean[row] / p.register.scale).tolist()
    return np.array([min((b - a for b in d.got), key=abs) for d, a in zip(pieces, at, strict=True)])


def _would_be_answers(case: Case, servo: int, pieces: Sequence[Damage], size: int) -> list[Damage]:
    """Return pieces that tell where a servo is; none if as many would by chance."""
    p = case.series(servo, "position")
    if p is None or p.register.width != 1:
        return []
    t = np.array([d.t_ns for d in pieces])
    low, high = (x / p.register.scale for x in in_force(p, t - NS // 4, t))
    fits = [
        d
        for d, a, b in zip(pieces, low.tolist(), high.tolist(), strict=True)
        if any(a - NEAR_RAW <= byte <= b + NEAR_RAW for byte in d.got)
    ]
    chance = float(np.mean(high - low + 2 * NEAR_RAW)) * size / 256
    enough = max(UNASKED, BARE_SHARE * len(pieces), 2 * chance * len(pieces))
    return fits if len(fits) >= enough else []


RULES: Final[tuple[Rule, ...]] = (chatty_bare,)
"""The rules of this file."""
