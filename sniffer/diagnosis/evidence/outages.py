"""Stretches in which one servo answered nothing, and which are no chance among single losses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.evidence.gone import gone_at_once
from sniffer.diagnosis.evidence.questions import is_one_question
from sniffer.diagnosis.evidence.told import told_to_start
from sniffer.diagnosis.ledger.excused import START_NS
from sniffer.diagnosis.ledger.silences import ENOUGH, LEAST
from sniffer.ground.model import NEVER_NS, NS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence, Set

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.silences import Silence

AGAIN: Final = 3
"""Silences that are a habit."""

JUST_NS: Final = NS // 4
"""A silence that has not ended, of a few requests, is told from so long on."""

TOGETHER: Final = 4
"""So many times fewer stretches of losses than single ones make are no chance, however much is
lost."""

CHANCE: Final = 3.0
"""So many times as often as chance would have it, requests in a row are lost for a reason."""


def outages(case: Case, servo: int) -> Sequence[Silence]:
    """Return the silences of a servo that were over, and are no chance among single losses."""
    return case.once(_outages)[servo]


def _outages(case: Case) -> Mapping[int, Sequence[Silence]]:
    return {servo: _no_chance(case, servo) for servo in case.answering}


def _no_chance(case: Case, servo: int) -> Sequence[Silence]:
    kept = case.ledger.silences
    lengths = kept.lengths(servo)
    runs, asked = sum(lengths), case.total("asked", servo)
    if not runs:
        return []
    late = kept.late(servo)
    missing = case.total("missing", servo) - (late.missed if late else 0)
    share = min(missing / max(asked, 1), 1.0)
    several = lengths[1] + lengths[2]
    if lengths[1] and several > max(CHANCE * runs * share, 2 * lengths[0]):
        return [s for s in kept.runs(servo) if s.missed > 1]
    by_chance = asked * share * (1 - share)  # stretches, if each request were lost by itself
    if lengths[2] > CHANCE * runs * share**2 or (lengths[2] and TOGETHER * runs < by_chance):
        return [s for s in kept.of(servo) if s.back_ns is not None]
    return []


def ending(case: Case, servo: int) -> Silence | None:
    """Return the silence of a servo until the end, of two requests where it lost no other one."""
    return case.once(_endings)[servo]


def _endings(case: Case) -> Mapping[int, Silence | None]:
    return {servo: _no_chance_to_the_end(case, servo) for servo in case.answering}


def _no_chance_to_the_end(case: Case, servo: int) -> Silence | None:
    last = case.ledger.silences.ending(servo)
    if last is None or last.missed < 2 or is_one_question(case, servo, last):
        return None
    has_begun = case.has_clock and case.last_ns - last.first_ns < JUST_NS
    if has_begun and last.missed < ENOUGH:
        return None  # the next request may be answered
    is_alone = not case.ledger.silences.runs(servo)
    return last if last.missed >= LEAST or is_alone else None


def seldom_away(case: Case, servo: int) -> Sequence[Silence]:
    """Return the outages of a servo that was away once or twice, while most others were there.

    None where it loses more besides, was told to start anew, or is gone for good.
    """
    last = ending(case, servo)
    away = [*outages(case, servo), *((last,) if last else ())]
    lost = len(case.ledger.silences.runs(servo)) + (last is not None)
    is_told = bool(told_to_start(case, servo, away)) or servo in gone_at_once(case)
    if not away or lost >= AGAIN or is_told or (last and is_for_good(case, last)):
        return ()
    others = len(case.answering) - 1
    if any(2 * len(away_too(case, servo, one)) > others for one in away):
        return ()
    return away


def is_for_good(case: Case, last: Silence) -> bool:
    """Tell whether a silence until the end is no accident, by the requests in it.

    Or by its time, where it is longer than any start takes.
    """
    is_long = case.has_clock and case.last_ns - last.first_ns >= START_NS
    return last.missed >= (LEAST if is_long else ENOUGH)


def away_too(case: Case, servo: int, one: Silence) -> Set[int]:
    """Return the other servos that were away in some moment of a silence of a servo."""
    until = one.back_ns or NEVER_NS
    out = set()
    for other in case.answering:
        silences = [s for s in case.ledger.silences.runs(other) if s.missed > 1]
        last = ending(case, other)
        silences += [last] if last else []
        is_away = any(
            s.first_ns <= until and (s.back_ns or NEVER_NS) >= one.first_ns for s in silences
        )
        if other != servo and is_away:
            out.add(other)
    return out


def answered_meanwhile(case: Case, servo: int, one: Silence) -> Set[int]:
    """Return the other servos that were asked in a silence of a servo, and answered all of it."""
    a, until = case.answers, one.back_ns or case.last_ns
    is_within = [(a[t] >= one.first_ns) & (a[t] <= until) for t in ("t_first", "t_last")]
    answered = (is_within[0] | is_within[1]) & (a["ok"] > 0) & (a["ok"] == a["asked"])
    others = {*case.answering} - {servo}
    return others & set(a["servo_id"][answered].tolist())


def away_with(case: Case, servo: int) -> Sequence[int]:
    """Return the servos that were away in just the same moments as a servo, itself among them."""
    return next(group for group in case.once(_groups) if servo in group)


def _groups(case: Case) -> Sequence[Sequence[int]]:
    """Return all servos that were away, those of the same moments together."""
    away = {servo: found for servo in case.answering if (found := outages(case, servo))}
    groups: list[list[int]] = []
    for servo, mine in away.items():
        with_it = next((g for g in groups if _are_the_same(away[g[0]], mine)), None)
        if with_it is None:
            groups.append([servo])
        else:
            with_it.append(servo)
    return groups


def _are_the_same(some: Sequence[Silence], others: Sequence[Silence]) -> bool:
    return len(some) == len(others) and all(
        a.first_ns <= (b.back_ns or NEVER_NS) and b.first_ns <= (a.back_ns or NEVER_NS)
        for a, b in zip(some, others, strict=True)
    )


def gone_with(case: Case, servo: int, last: Silence) -> Mapping[int, Silence]:
    """Return the servos that fell silent for good when a servo did, itself among them.

    Each of them went between the last request that it had and the first one that it missed.
    """
    return {
        who: one
        for who in case.answering
        if (one := ending(case, who)) is not None
        if who == servo or (one.before_ns < last.first_ns and last.before_ns < one.first_ns)
    }
