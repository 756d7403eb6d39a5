"""Behind whose exchanges all that is torn stands, whatever it is: a question of order, not of time.

A second answer that comes late tears what follows, now the next request, now the next servo's
answer, now both of the exchange after that. Read one by one these are three faults; told by who
answered last, or last but one, they are one servo's::

    3 answers   request to 4 torn
    3 answers   4 asked   its answer torn
    3 answers   4 asked and answers   request to 1 torn

It holds for a host that holds bytes back, and where nobody knows any time.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.diagnosis.evidence.chances import at_least
from sniffer.diagnosis.evidence.signs import is_anothers, named_within
from sniffer.diagnosis.ledger.damage import IN_REPLY, IN_REQUEST
from sniffer.ground.codes import RESPONSE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.damage import Damage

DEPTH: Final = 2
"""How many answers back the servo is looked for: a second answer is no later than an exchange."""

NEARLY: Final = 0.9
"""Part of the torn places that must stand behind one servo's answers; noise may tear a few."""

AHEAD: Final = 0.1
"""Part of them behind which no other's stand: in a fixed order one goes before the other."""

WHOLE: Final = 3
"""Second answers that say themselves whose they are: whole ones, or within what is torn."""

LEAST: Final = 10
"""Torn requests behind answers that must be among them: a fault of the servo asked tears none."""

USUAL: Final = 0.55
"""Part of the exchanges that may be a servo's for what stands behind them to be its alone."""

CHANCE: Final = 1e-6


class Followed(NamedTuple):
    """A servo behind whose answers all that is torn stands, and what does."""

    servo_id: int
    requests: tuple[Damage, ...]
    replies: tuple[Damage, ...]


def followed(case: Case) -> Followed | None:
    """Return the servo that all torn places follow; None where there is none, or more than one."""
    found = case.once(_followed)
    if found is None:
        return None
    places = (d.at for d in (*found.requests, *found.replies))
    return None if is_anothers(case, places, found.servo_id) else found


def _followed(case: Case) -> Followed | None:
    if case.has_bare_answers:
        return None  # any bytes are an answer, and of whoever was asked
    # a request some bits of which are wrong was hit by a pulse, not by an answer
    requests = [d for d in case.damages if d.turn == IN_REQUEST and d.behind == RESPONSE]
    requests = [d for d in requests if not d.alike]
    places = [*requests, *(d for d in case.damages if d.turn == IN_REPLY and not d.is_answered)]
    named = _named(case, places)
    if named is not None and len(requests) >= LEAST and not _mostly_behind(named, requests):
        return None  # the torn answers are the servo's that is asked next, in a fixed order
    if named is not None and Counter(named_within(case).values())[named] >= WHOLE:
        mine = [d for d in places if named in _answered(d, DEPTH)]
        return _of(named, mine) if len(mine) <= case.total("ok", named) else None
    if sum(d.length > _longest(case) for d in requests) > (1 - NEARLY) * len(requests):
        return None  # what two that know nothing of this protocol say to each other
    if 2 * sum(d.got[:1] in _first_bytes(case) for d in requests) < len(requests):
        return None  # neither of two that collide began: one of them mostly is first
    exchanges = max(sum(case.total("ok", s) for s in case.servos), 1)
    for depth in range(1 if named is None else DEPTH, DEPTH + 1):
        whose = _one(places, depth) if named is None else named
        if whose is None:
            continue
        mine = [d for d in places if whose in _answered(d, depth)]
        crossed = [d for d in requests if whose in _answered(d, depth)]
        if len(crossed) < LEAST or depth * case.total("ok", whose) > USUAL * exchanges:
            return None
        if len(mine) > case.total("ok", whose):
            return None  # more than a second answer to each request
        # noise would tear requests behind anybody's answers
        last, count = Counter(s for d in requests for s in _answered(d, 1)).most_common(1)[0]
        if at_least(count, len(requests), case.total("ok", last) / exchanges) > CHANCE:
            return None
        return _of(whose, mine)
    return None


def _mostly_behind(servo: int, places: Sequence[Damage]) -> bool:
    """Tell whether a servo's answer is among the last two before nearly all places."""
    return sum(servo in _answered(d, DEPTH) for d in places) >= NEARLY * len(places)


def _of(servo: int, places: Sequence[Damage]) -> Followed:
    replies = tuple(d for d in places if d.turn == IN_REPLY)
    return Followed(servo, tuple(d for d in places if d.turn != IN_REPLY), replies)


def _longest(case: Case) -> int:
    """Return how many bytes a request and an answer that runs into it have at most."""
    answers = (len(a) for known in case.ledger.damages.likes.known.values() for a in known)
    return max(answers, default=0) + max(map(len, case.ledger.exchanges.kinds.requests), default=0)


def _first_bytes(case: Case) -> set[bytes]:
    """Return with what requests and answers begin."""
    known = case.ledger.damages.likes.known
    answers = {a[:1] for some in known.values() for a in some}
    return answers | {q[:1] for q in case.ledger.exchanges.kinds.requests}


def _named(case: Case, places: Sequence[Damage]) -> int | None:
    """Return the one servo that answered twice, as its bytes say, before nearly all places."""
    within = Counter(named_within(case).values())
    twice = [
        s
        for s in case.servos
        if max(len(case.anomalies("duplicate-response", servo_id=s)), within[s]) >= WHOLE
        and _mostly_behind(s, places)
    ]
    return twice[0] if len(twice) == 1 else None


def _one(places: Sequence[Damage], depth: int) -> int | None:
    """Return the servo whose answer is among the last so many before nearly all places."""
    counts = Counter(s for d in places for s in _answered(d, depth))
    ranked = counts.most_common(2)
    if not ranked or ranked[0][1] < NEARLY * len(places):
        return None
    rival = ranked[1][1] if len(ranked) > 1 else 0
    if ranked[0][1] - rival < max(LEAST, AHEAD * len(places)):
        return None
    return ranked[0][0]


def _answered(d: Damage, depth: int) -> set[int]:
    """Return whose sound answers the last so many before a place are."""
    answered = [a.servo_id for a in d.asked_before if a.is_answered]
    return set(answered[:depth])
