"""Servos of which two answers come: the traces of the second one, in its own place or others'.

Where the second answer comes late, it runs into the next exchange: what is torn there is not its
servo's fault but the twin's.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.evidence.chances import at_least
from sniffer.diagnosis.evidence.followed import CHANCE, USUAL, followed
from sniffer.diagnosis.evidence.hasty import ends_of_requests
from sniffer.diagnosis.evidence.heard import heard
from sniffer.diagnosis.evidence.hit import torn_answers
from sniffer.diagnosis.evidence.neighbours import spoken_over
from sniffer.diagnosis.evidence.overdue import is_overdue
from sniffer.diagnosis.evidence.owners import JITTER_NS, at_turns, owner
from sniffer.diagnosis.evidence.signs import beginnings, begins_like, is_anothers, named_by_header
from sniffer.diagnosis.evidence.stamps import grid_ns
from sniffer.diagnosis.evidence.swallowing import swallowing
from sniffer.diagnosis.ledger.damage import AT_TURN, IN_IDLE, IN_REPLY, IN_REQUEST
from sniffer.diagnosis.physics.comparing import alike
from sniffer.diagnosis.physics.misread import alike_of
from sniffer.diagnosis.physics.mixing import LEAST as SURE_BYTES
from sniffer.diagnosis.physics.mixing import Mix, beginning, mix_of
from sniffer.ground.codes import RESPONSE
from sniffer.ground.distinct import within
from sniffer.ground.medians import quantile

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence, Set

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.evidence.followed import Followed
    from sniffer.diagnosis.evidence.owners import Owner, TornPlace
    from sniffer.diagnosis.ledger.damage import Damage

LEAST: Final = 3

SHARE: Final = 0.02
"""Part of a servo's answers that must come twice."""

PART: Final = 0.25
"""Part of the torn answers that must be two at once."""


STEADY: Final = 0.3
"""A delay is another servo's if it varies no more than so much of what one's own would."""

STEADILY: Final = 1.0

NEAR_NS: Final = 3_000_000
"""What comes later behind an exchange is not its doing."""

ALONE: Final = 0.75
"""Part of the places that must stand behind one servo's exchanges to be its."""

LEFT: Final = 0.5
"""Part of one servo's traces that another must have of its own to answer twice as well."""

SOME: Final = 10
"""Delays from which on one knows how they vary."""


@dataclass(slots=True)
class Twin:
    """What shows that a servo answers twice.

    ``whole``: second answers that are whole; ``torn``: torn answers before a whole one; ``stray``:
    stray bytes behind its exchanges and nobody else's; ``foreign``: torn bytes that begin like its
    answers where the next servo's is due; ``crossed``: torn requests behind its exchanges and
    hardly any others; ``behind``: whatever else comes a steady time behind its requests; ``mixed``:
    torn answers that are two of its own, with how, or one of its and one of the servo ``over``
    whose answers it lies; ``before``: servos before whose answers its second ones come, so that
    theirs look like second ones.
    """

    servo_id: int
    whole: int = 0
    times: list[int] = field(default_factory=list)
    torn: list[Damage] = field(default_factory=list)
    stray: list[Damage] = field(default_factory=list)
    foreign: list[Damage] = field(default_factory=list)
    crossed: list[Damage] = field(default_factory=list)
    behind: list[TornPlace] = field(default_factory=list)
    mixed: list[tuple[Damage, Mix]] = field(default_factory=list)
    tried: int = 0
    over: int = -1
    before: set[int] = field(default_factory=set)

    @property
    def twice(self) -> int:
        """How many second answers there are."""
        torn = (self.torn, self.stray, self.foreign, self.crossed)
        return self.whole + sum(map(len, torn)) + len(self.behind)


def twins(case: Case) -> Mapping[int, Twin]:
    """Return the servos that answer twice by what was heard."""
    return {} if is_overdue(case) else case.once(_twins)


def _twins(case: Case) -> Mapping[int, Twin]:
    found = {servo: Twin(servo) for servo in case.servos}
    known = case.ledger.damages.likes.known
    begins = beginnings(case)
    requests = case.ledger.exchanges.kinds.requests
    belated, named = {d.at for d in late_answers(case)}, named_by_header(case)
    for d in case.damages:
        mine = found.get(d.servo_id)
        if d.turn == IN_REPLY and d.is_answered and mine is not None and d.at not in belated:
            asks = max((alike(d.got, one) for one in requests), default=0)
            if named.get(d.at, -1) not in (-1, d.servo_id):
                continue  # what names another servo is no answer of this one
            if asks <= alike(d.got, begins.get(d.servo_id, b"")):  # else a request was torn
                mine.torn.append(d)
        earlier = found.get(d.earlier_id)
        if earlier is not None and d.at not in belated and _is_foreign(d, begins, requests):
            earlier.foreign.append(d)
    late = _late_twins(case)
    requests_into = ends_of_requests(case)
    strays = [d for d in case.damages if d.turn == AT_TURN or _is_left_behind(case, d)]
    strays = [d for d in strays if d.at not in requests_into]
    # a request some bits of which are wrong was hit by a pulse, not by an answer; one that is
    # answered was heard whole
    requests_torn = [d for d in case.damages if d.turn == IN_REQUEST]
    answered = heard(case).requests
    torn = [d for d in requests_torn if not d.alike and d.at not in answered]
    one = _behind_one(case, strays, SOME)
    is_turning = len(at_turns(case).get(one, ())) >= LEAST  # before its own answers as well
    if (
        one in found
        and one not in late
        and not is_turning
        and not _begin_with_pulses(case, one, strays[0].t_ns)
    ):
        found[one].stray += strays
    everything = followed(case)
    one = _behind_one(case, torn, SOME) if everything is None else -1
    if one in found:
        crossed = [d for d in torn if _behind_whom(d) == one]
        if not is_anothers(case, (d.at for d in crossed), one):
            found[one].crossed += crossed
    _spare(case, found)
    if everything is not None:
        _give(found, everything)
    ends = {d.at + d.length for d in requests_torn}
    for servo, twin in found.items():
        events = case.anomalies("duplicate-response", servo_id=servo)
        rows = case.alarm_rows("duplicate-response", servo_id=servo)
        whole = int(case.alarms["n"][rows].sum())
        # what stands right behind a torn request is the answer to it
        asked = within(events.at, list(ends))
        asked |= within(events.at + events.length, list(requests_into))
        events, whole = events.take(~asked), 0 if asked.all() else whole - int(asked.sum())
        other = late.get(servo)
        if other is None:
            twin.whole, twin.times = whole, events.t_ns.tolist()
        else:  # they come a steady time behind the request to another one
            whose = found[other]
            whose.before.add(servo)
            whose.stray += [
                d for d in case.damages if d.turn in (AT_TURN, IN_IDLE) and d.earlier_id == other
            ]
    for servo, answers in torn_answers(case).items():
        if servo in swallowing(case):
            continue
        twin = found.setdefault(servo, Twin(servo))
        tried = [(d, b) for d in answers if len(b := beginning(alike_of(d, known))) >= SURE_BYTES]
        twin.tried = len(tried)
        twin.mixed = [(d, mix) for d, b in tried if (mix := mix_of(d.got, b, b)) is not None]
        before, mixed = spoken_over(tried, {d.at for d, _ in twin.mixed}, begins)
        if before in found:
            twin.mixed, twin.tried = [], 0
            found[before].mixed, found[before].tried = mixed, len(tried)
            found[before].over = servo
    steady = owner(case) if everything is None else None
    if steady is not None and (steady.is_proof or any(_is_twin(case, t) for t in found.values())):
        _hand_over(case, found, steady)
    surest = max(found.values(), key=lambda t: t.twice + len(t.mixed), default=None)
    for twin in found.values():
        if twin is not surest:  # what stands at others' places is one twin's, not several's
            twin.stray, twin.foreign, twin.crossed = [], [], []
    out = {s: t for s, t in found.items() if _is_twin(case, t)}
    return {s: t for s, t in out.items() if not _is_neighbour(t, surest)}


def _give(found: dict[int, Twin], all_torn: Followed) -> None:
    """Give all that stands behind one servo's answers to that one."""
    places = {d.at for d in (*all_torn.requests, *all_torn.replies)}
    for twin in found.values():
        twin.torn, twin.stray, twin.foreign, twin.crossed = (
            [d for d in some if d.at not in places]
            for some in (twin.torn, twin.stray, twin.foreign, twin.crossed)
        )
    whose = found.setdefault(all_torn.servo_id, Twin(all_torn.servo_id))
    for servo, twin in list(found.items()):
        if twin is not whose and twin.twice < LEFT * len(places):  # what it did to those behind it
            found[servo] = Twin(servo)
    whose.crossed += all_torn.requests
    whose.foreign += [d for d in all_torn.replies if d.servo_id != whose.servo_id]


def _hand_over(case: Case, found: dict[int, Twin], one: Owner) -> None:
    """Give what comes a steady time behind one servo's requests to that one, wherever it stands."""
    whose = found[one.servo_id]
    places = {t.at for t in one.traces}
    told = {d.at for d in (*whose.torn, *whose.stray, *whose.foreign, *whose.crossed)}
    for servo, twin in list(found.items()):
        if twin is whose:
            continue
        events = case.anomalies("duplicate-response", servo_id=servo)
        # the second stands behind the first
        its = int((~within(events.at + events.length, list(places))).sum())
        if 2 * its < len(events):
            twin.whole, twin.times = 0, []
        twin.torn, twin.stray, twin.foreign, twin.crossed = (
            [d for d in some if d.at not in places]
            for some in (twin.torn, twin.stray, twin.foreign, twin.crossed)
        )
        twin.mixed = [(d, mix) for d, mix in twin.mixed if d.at not in places]
        if twin.twice + len(twin.mixed) < LEFT * len(places):  # what it did to those behind it
            found[servo] = Twin(servo)
        if not found[servo].whole:
            whose.before.add(servo)
    whose.behind = [t for t in one.elsewhere if t.at not in told]


def late_answers(case: Case) -> Sequence[Damage]:
    """Return torn places that begin as the answer to the request before the last one, or name it.

    That one stands right before the last, with nothing between: it is its one and only answer.
    """
    begins, requests = beginnings(case), case.ledger.exchanges.kinds.requests
    ends = {f.at + f.length: f for f in case.ledger.exchanges.failed}
    named = named_by_header(case)
    out = []
    for d in case.damages:
        first = ends.get(d.at - len(d.asked)) if d.turn == IN_REPLY and d.asked else None
        if first is not None and first.servo_id == d.earlier_id:
            is_named = d.earlier_id == named.get(d.at, -1) != d.servo_id
            out += [d] if is_named or _is_foreign(d, begins, requests) else []
    return out


def _is_foreign(d: Damage, begins: Mapping[int, bytes], requests: Sequence[bytes]) -> bool:
    """Tell whether damage in another one's place begins as answers of the servo asked before."""
    if d.earlier_id == d.servo_id or d.turn in (AT_TURN, IN_IDLE):
        return False
    others = [b for s, b in begins.items() if s != d.earlier_id]
    return begins_like(d.got, begins.get(d.earlier_id, b""), [*others, *requests])


def _spare(case: Case, found: Mapping[int, Twin]) -> None:
    """Forget torn answers, and pieces of them, where others have them or requests are torn."""
    total = sum(len(t.torn) for t in found.values())
    pieces = sum(len(t.foreign) for t in found.values())
    exchanges = max(sum(case.total("ok", s) for s in case.servos), 1)
    rest = sum(d.turn == IN_REQUEST and d.behind != RESPONSE for d in case.damages)
    asked = max(int(case.traffic["requests"].sum()), 1)
    for servo, twin in found.items():
        usual = case.total("ok", servo) / exchanges
        mine, n = len(twin.torn), case.total("ok", servo)
        alone = usual >= 1.0 or at_least(mine, total, usual) < CHANCE or mine == total
        if not alone or at_least(mine, n, (rest + 1) / asked) > CHANCE:
            twin.torn = []
        if usual < 1.0 and at_least(len(twin.foreign), pieces, usual) > CHANCE:
            twin.foreign = []


def _is_twin(case: Case, t: Twin) -> bool:
    answers = case.total("ok", t.servo_id) + case.total("damaged", t.servo_id)
    twice = answers > 0 and t.twice >= max(LEAST, SHARE * case.total("ok", t.servo_id))
    return twice or len(t.mixed) >= max(LEAST, PART * t.tried)


def _is_neighbour(t: Twin, surest: Twin | None) -> bool:
    """Tell whether a servo's torn answers stand behind exchanges of one that surely answers twice.

    What lies over them is the second answer of that one, which looks like theirs but for the id.
    """
    if surest is None or t is surest or surest.twice < LEAST or t.twice >= LEAST:
        return False
    behind = sum(d.earlier_id == surest.servo_id for d, _ in t.mixed)
    return behind >= ALONE * len(t.mixed)


def of_twins(case: Case, d: Damage) -> bool:
    """Tell whether a torn place is a twin's, or in the exchange behind a twin's."""
    found = twins(case)
    behind = d.behind == RESPONSE and d.asked_id in found
    behind |= d.at in torn_by_twins(case)
    return behind or d.servo_id in found or d.earlier_id in found


def torn_by_twins(case: Case) -> Set[int]:
    """Return where torn places stand that are second answers to requests before their own."""
    return case.once(_torn_by_twins)


def _torn_by_twins(case: Case) -> Set[int]:
    found = twins(case).values()
    over = {(twin.over, twin.servo_id) for twin in found}
    lain_over = {
        d.at for d in case.damages if d.turn == IN_REPLY and (d.servo_id, d.earlier_id) in over
    }
    behind = {t.at for twin in found for t in twin.behind}
    return lain_over | behind | {d.at for twin in found for d in twin.foreign}


def _is_left_behind(case: Case, d: Damage) -> bool:
    """Tell whether bytes stand right behind a bare answer: what a second one has more than that.

    Behind a torn request stands its own answer.
    """
    behind = case.has_bare_answers and d.turn == IN_IDLE and d.behind == RESPONSE
    return behind and d.length <= case.ledger.answer_length and d.at not in heard(case).answers


def _begin_with_pulses(case: Case, servo: int, since_ns: int) -> bool:
    """Tell whether bare answers of a servo took a pulse for their first byte, and leave their last.

    The first is the load; a line that falls low for a moment makes a byte of one rising edge.
    """
    load = case.series(servo, "load") if case.has_bare_answers else None
    if load is None:
        return False
    said = load.first[load.t_first >= since_ns] / load.register.scale
    low = np.rint(said).astype(np.int64) ^ 0xFF
    return 2 * int(np.count_nonzero(low & low + 1 == 0)) > len(low)


def _behind_whom(d: Damage) -> int:
    """Return behind whose exchange a torn request, or a stray byte, stands."""
    return d.asked_id if d.behind == RESPONSE else d.earlier_id


def _behind_one(case: Case, places: Sequence[Damage], least: int) -> int:
    """Return the servo behind whose exchanges such places stand, and behind nobody else's; -1."""
    if len(places) < least:
        return -1
    # what stands behind a request that nobody answers is behind the exchange before, if it comes
    # steadily behind that one; else it is that request's
    others = [d for d in places if d.behind != RESPONSE]
    if others and not _steady(
        [d.earlier_ns for d in others], [d.asked_ns for d in others], STEADILY, grid_ns(case)
    ):
        places = [d for d in places if d.behind == RESPONSE]
        if len(places) < max(least, ALONE * (len(places) + len(others))):
            return -1
    whose = [_behind_whom(d) for d in places]
    near = [s for s, d in zip(whose, places, strict=True) if 0 <= d.since_ns <= NEAR_NS]
    if not near:
        return -1
    one, count = Counter(near).most_common(1)[0]
    exchanges = sum(case.total("ok", s) for s in case.servos)
    usual = case.total("ok", one) / max(exchanges, 1) if one >= 0 else 1.0
    alone = count >= ALONE * len(places) and usual <= USUAL
    return one if alone and at_least(count, len(places), usual) < CHANCE else -1


def _late_twins(case: Case) -> Mapping[int, int]:
    """Return servos behind whose answers stray bytes stand that come steadily behind another's."""
    by_pair: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for d in case.damages:
        if d.turn in (AT_TURN, IN_IDLE) and d.asked_ns >= 0 and d.earlier_ns >= 0:
            by_pair.setdefault((d.asked_id, d.earlier_id), []).append((d.asked_ns, d.earlier_ns))
    out, grid, at_turn = {}, grid_ns(case), at_turns(case)
    for (servo, earlier), delays in by_pair.items():
        if len(delays) < SOME or earlier not in case.servos or servo == earlier:
            continue
        if len(at_turn.get(earlier, ())) >= LEAST:
            continue  # they stand before its own answers as well
        own, theirs = zip(*delays, strict=True)
        if _steady(theirs, own, STEADY, grid):
            out[servo] = earlier
    return out


def _steady(theirs: Sequence[int], own: Sequence[int], than: float, grid: int) -> bool:
    """Tell whether delays vary as little as a servo's, and so much less than others.

    How little they vary within a step of the stamps' ``grid`` nobody knows.
    """
    low, high = quantile(np.array([theirs, own]), (0.05, 0.95), axis=1)
    varies, other = (high - low).tolist()
    return bool(min(theirs) >= 0 and varies + grid <= min(than * other, JITTER_NS))
