"""A servo that answers when others are asked already: what is torn stands behind its requests.

Its requests have no answer, for that comes later: over the next request, over the next servo's
answer, over what follows that. Read in their places these are the faults of those, or second
answers of who answered last; told by whose request was waited with in vain, they are one thing::

    4 asked, nothing    1 asked, its answer torn
    4 asked, nothing    request to 1 torn
    4 asked, nothing    1 asked and answers    request to 2 torn
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.diagnosis.evidence.chances import at_least
from sniffer.diagnosis.evidence.followed import CHANCE, DEPTH, NEARLY
from sniffer.diagnosis.ledger.damage import HELD, IN_REPLY, IN_REQUEST
from sniffer.ground.codes import NO_RESPONSE

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.damage import Damage

LEAST: Final = 10
"""Torn places that show it."""

HARDLY: Final = 0.1
"""Part of its requests that may be answered in time: whose answers mostly come is not overdue."""

HALF: Final = 0.5
"""Part of its requests in vain behind which something must be torn: an answer always comes."""


class Overdue(NamedTuple):
    """A servo whose answers lie over what is said behind its request, and what they tear.

    ``is_sure``: what is torn is not always one servo's answer, or that is whole where no answer is
    overdue, or its own answers are torn, too; else a servo that is not there and a fault of the
    next one look alike.
    """

    servo_id: int
    places: tuple[Damage, ...]
    is_sure: bool


def overdue(case: Case) -> Overdue | None:
    """Return the servo whose answers are overdue; None where there is none, or more than one."""
    return case.once(_overdue)


def is_overdue(case: Case) -> bool:
    """Tell whether what is torn is surely such a servo's doing."""
    late = overdue(case)
    return late is not None and late.is_sure


def _overdue(case: Case) -> Overdue | None:
    if case.has_bare_answers:
        return None  # any bytes are an answer, and of whoever was asked
    failed = case.ledger.exchanges.failed
    vain = {f.t_ns: f.servo_id for f in failed if f.outcome == NO_RESPONSE}
    # exchanges that went wrong are kept up to some moment
    last_ns = failed[-1].t_ns if failed else 0
    places = [d for d in case.damages if d.turn != HELD and d.t_ns <= last_ns]
    if len(places) < LEAST:
        return None
    before = {d.at: _in_vain(d, vain) for d in places}
    counts = Counter(servo for some in before.values() for servo in some)
    if not counts:
        return None
    servo = counts.most_common(1)[0][0]
    behind = [d for d in places if servo in before[d.at]]
    own = [d for d in places if d.turn == IN_REPLY and d.servo_id == servo]
    mine = {d.at: d for d in (*behind, *own)}
    asked, times = case.total("asked", servo), sum(who == servo for who in vain.values())
    if times < (1 - HARDLY) * len(vain) or case.total("ok", servo) > HARDLY * asked:
        return None  # others are not answered either: it is no matter of this one
    if len(mine) < NEARLY * len(places) or len(behind) < HALF * max(len(mine), times):
        return None
    share = DEPTH * asked / max(case.total("asked"), 1)
    if share >= 1 or at_least(len(mine), len(places), share) > CHANCE:
        return None
    is_sure = len(own) >= LEAST or _is_sure(case, behind, len(behind) / times)
    return Overdue(servo, tuple(mine.values()), is_sure)


def _is_sure(case: Case, places: Sequence[Damage], share: float) -> bool:
    """Tell whether more is torn than the answers of one servo that are never whole.

    ``share`` is behind which part of the requests in vain something is torn.
    """
    torn = {d.asked_before[0].servo_id for d in places if d.turn == IN_REPLY}
    requests = sum(d.turn == IN_REQUEST for d in places)
    whole_before = share >= NEARLY and any(case.total("ok", servo) for servo in torn)
    return len(torn) > 1 or requests >= LEAST or whole_before


def _in_vain(d: Damage, vain: Mapping[int, int]) -> set[int]:
    """Return whose requests in vain are the last ones before a place, or before its own request."""
    own = d.turn == IN_REPLY
    return {vain[a.t_ns] for a in d.asked_before[own : DEPTH + own] if a.t_ns in vain}
