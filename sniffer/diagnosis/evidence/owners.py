"""Whose second answers torn places are, by how steadily they come behind a servo's requests.

A servo takes as long to answer as it always does. Its second answer lies over whatever comes next:
the torn bytes belong to the request behind, to the next servo's answer, to nobody. Read in their
places they blame that one. But they begin, or end, a steady time behind the request that they
answer, and less steadily behind every other one, between which the controller and another servo
took their time as well::

    request to 3 ends  + 2.1 ms  torn        request to 4 ends  + 0.3 ms  torn
    request to 3 ends  + 2.1 ms  torn        request to 4 ends  + 0.6 ms  torn
    request to 3 ends  + 2.1 ms  torn        request to 4 ends  + 0.4 ms  torn

Of every servo the span of time is looked for that holds more places than chance would put there:
``n * ln(n / expected)``, the log of how much likelier so many are if they are its own. It needs no
bound of its own for noise, which lies anywhere.
"""

from __future__ import annotations

from math import log
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.diagnosis.evidence.hasty import ends_of_requests
from sniffer.diagnosis.evidence.heard import heard
from sniffer.diagnosis.evidence.signs import is_anothers, named_by_header, named_within
from sniffer.diagnosis.evidence.stamps import grid_ns, steadiest_ns
from sniffer.diagnosis.ledger.damage import AT_TURN, HELD, IN_REPLY, IN_REQUEST, REST, STRAYS
from sniffer.diagnosis.ledger.seconds import SecondAnswer
from sniffer.diagnosis.physics.comparing import header_of
from sniffer.ground.codes import REQUEST, RESPONSE
from sniffer.ground.distinct import numbers
from sniffer.ground.medians import quantile

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence, Set

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.damage import Damage
    from sniffer.diagnosis.ledger.likes import RequestBefore

LATEST_NS: Final = 20_000_000
"""What begins later behind a request is no answer to it, whosever."""

JITTER_NS: Final = 300_000
"""By how much a servo's time to answer varies at most, between nine tenths of its answers."""

SPANS_NS: Final = (*(round(5_000 * 2 ** (k / 2)) for k in range(12)), JITTER_NS)
"""Spans of time that are tried, each wider by the root of two."""

LEAST: Final = 3
"""Places that make a pattern."""

STEADIER: Final = 2.0
CLOCK_NS: Final = 20_000
"""An answer is steadier than another if its time varies so many times less, and by so much."""

LEAD: Final = 5.0
"""By how much (natural logarithm) the best must be ahead of the next to be told: 150 times."""

SURE: Final = 1.5
"""By how much it must be ahead for each of its places to prove that a servo answers twice."""

PART: Final = 0.3
NEARLY: Final = 0.8
SOME: Final = 10
"""Part of all places that must be one servo's, and which part of these at others' turn, for proof.

Of 746 captures with other faults (two draws of all scenarios) none has that.
"""


class TornPlace(NamedTuple):
    """Torn bytes, or a second answer.

    ``servo_id`` is in whose exchange it stands, ``own_id`` whose torn answer it may simply be (-1);
    ``named``: whose answer it says it is (-1: it does not say); ``is_within``: by bytes within what
    is torn. ``is_little``: a stray byte, or a request some bits of which are wrong, is no second
    answer. ``asked`` is how long the request is in whose answer it stands.
    """

    at: int
    length: int
    servo_id: int
    begins_ns: int
    t_ns: int
    own_id: int
    is_little: bool
    asked: int
    asked_before: tuple[RequestBefore, ...]
    named: int = -1
    is_within: bool = False

    def is_elsewhere(self, servo_id: int) -> bool:
        """Tell whether it is no part of a servo's exchange, nor a few bytes at the end of it."""
        asked = self.asked_before[0].servo_id if self.asked_before else -1
        return asked != servo_id or (self.own_id != servo_id and not self.is_little)


class Owner(NamedTuple):
    """A servo behind whose requests places come steadily: which, and how they do.

    ``first_ns`` and ``last_ns`` are the earliest and the latest of them behind its request;
    ``lead`` is by how much it is ahead of the next servo (natural logarithm), ``tried`` how many
    places there are.
    """

    servo_id: int
    traces: tuple[TornPlace, ...]
    first_ns: int
    last_ns: int
    score: float
    lead: float
    tried: int

    @property
    def elsewhere(self) -> tuple[TornPlace, ...]:
        """Those that stand in exchanges of others, or are more than a part of its own."""
        return tuple(t for t in self.traces if t.is_elsewhere(self.servo_id))

    @property
    def is_proof(self) -> bool:
        """Whether nothing but a second answer comes so: its request was answered, and then this."""
        if len(self.traces) < PART * self.tried:
            return False
        if sum(t.is_within for t in self.elsewhere) >= LEAST:
            return True
        n = sum(not t.is_little for t in self.elsewhere)
        sure = self.lead >= SURE * len(self.traces)
        return sure and n >= max(SOME, NEARLY * len(self.traces))


def owner(case: Case) -> Owner | None:
    """Return the servo whose second answers most places are; None where it cannot be told."""
    return case.once(_owner)


def _owner(case: Case) -> Owner | None:
    if not case.has_prompt_stamps:
        return None  # a host that holds bytes back moves them by more than they vary
    grid = grid_ns(case)
    if max(grid, steadiest_ns(case)) > SPANS_NS[-1]:
        return None  # so does one that stamps them by the millisecond, or when it has time
    traces = _traces(case)
    found, most = [], {}
    at_turn = at_turns(case)
    strays = frozenset[int]().union(*at_turn.values())
    for servo in case.servos:
        # strays before its own answers as well are no second ones of it
        turns = strays if len(at_turn.get(servo, ())) >= LEAST else frozenset[int]()
        mine = [t for t in traces if t.named in (-1, servo) and t.at not in turns]
        by_begin, by_end = (_steadiest(servo, mine, grid, is_by_end=e) for e in (False, True))
        better = max(by_begin, by_end, key=lambda o: o.score)
        if turns and len(better.traces) < len(at_turn[servo]):
            continue  # what stands before its answers tears the next request now and then
        most[servo] = better.score
        own = sum(t.own_id == servo for t in better.traces)
        if 2 * own > len(better.traces):
            # its own answer, over which another's lies, begins or ends as steadily: both must
            better = better._replace(score=(by_begin.score + by_end.score) / 2)
        found.append(better)
    found.sort(key=lambda o: -o.score)
    if not found or len(found[0].traces) < LEAST:
        return None
    if is_anothers(case, (t.at for t in found[0].traces), found[0].servo_id):
        return None
    first = {o.servo_id: _first(case, o.servo_id, traces, grid) for o in found}
    whose = first[found[0].servo_id]
    if whose == -1:
        return None
    # Torn answers that come as steadily at one end are those of who was asked, as far as one knows.
    others = [most[o.servo_id] for o in found[1:] if first[o.servo_id] != whose]
    lead = found[0].score - max(others, default=0.0)
    return found[0]._replace(servo_id=whose, lead=lead) if lead >= LEAD else None


def at_turns(case: Case) -> Mapping[int, Set[int]]:
    """Return where strays stand between a request and the answer to it, by who is asked.

    What a driver makes as it lets go of the line stands so, whoever is asked next.
    """
    out: dict[int, set[int]] = {}
    for d in case.damages:
        if d.turn == AT_TURN and d.behind == REQUEST and d.is_answered:
            out.setdefault(d.servo_id, set()).add(d.at)
    return out


def _first(case: Case, servo: int, traces: Sequence[TornPlace], grid: int) -> int:
    """Return whose second answer it is that a servo's own one is put out of its place by.

    A bare answer is whoever's is asked for: one too many stands for the next servo's, whose own
    one stands for that of the one behind. The servo's own where that is in its place; -1 where
    all are out of place, as they are where nobody waits for answers.
    """
    chain = [servo]
    while case.has_bare_answers:
        before = _whose_stands_for(chain[-1], traces, grid)
        if before == chain[-1]:
            break
        if before in chain:
            return -1
        chain.append(before)
    return chain[-1]


def _whose_stands_for(servo: int, traces: Sequence[TornPlace], grid: int) -> int:
    """Return behind whose requests come most steadily what was taken for a servo's answers."""
    since: dict[int, list[int]] = {}
    for t in traces:
        mine = next((k for k, a in enumerate(t.asked_before) if a.servo_id == servo), -1)
        answer_ns = t.asked_before[mine].answer_ns if mine >= 0 else -1
        if answer_ns < 0:
            continue
        # of requests to one servo the last before it
        last = {a.servo_id: a.t_ns for a in reversed(t.asked_before[mine + 1 :])}
        last[servo] = t.asked_before[mine].t_ns
        for before, t_ns in last.items():
            since.setdefault(before, []).append(answer_ns - t_ns)
    varies = {s: _varies(x) for s, x in since.items() if 2 * len(x) > len(since[servo])}
    best = min(varies, key=lambda s: varies[s], default=servo)
    is_steadier = best != servo and varies[servo] > STEADIER * varies[best] + max(CLOCK_NS, grid)
    return best if is_steadier else servo


def _varies(since: Sequence[int]) -> float:
    """Return how much times vary, in ns, but for those that are out of line."""
    return float(np.subtract(*quantile(since, (0.9, 0.1))))


def _traces(case: Case) -> Sequence[TornPlace]:
    """Return places whose time is known: torn ones, and second answers."""
    torn = [d for d in case.damages if d.turn != HELD and d.begins_ns >= 0]
    no_traces = set().union(*heard(case), ends_of_requests(case), _begun_requests(case))
    places = [d for d in torn if d.at not in no_traces]
    within, headed = named_within(case), named_by_header(case)
    # what names the servo asked, and stands before its whole answer, is one of two answers of it
    first = {d.at: d.servo_id for d in places if d.is_answered and headed.get(d.at) == d.servo_id}
    behind = [d for d in places if _is_behind(d)]
    traces = [
        TornPlace(
            d.at,
            d.length,
            d.servo_id,
            d.begins_ns,
            d.t_ns,
            d.servo_id if d.turn in (IN_REPLY, REST) and not d.is_answered else -1,
            d.turn in STRAYS or (d.turn == IN_REQUEST and bool(d.alike)),
            len(d.asked),
            d.asked_before,
            within.get(d.at, first.get(d.at, -1)),
            d.at in within,
        )
        for d in places
        if not _is_behind(d)
    ]
    whole = case.ledger.second_answers.kept
    bare = [_second(d, case.ledger.byte_ns) for d in behind]
    unnamed = [*(s for s in whole if not _names(case, s)), *bare]
    return [
        *traces,
        *(_named(s) for s in whole if _names(case, s)),
        *_less_steady(unnamed, grid_ns(case)),
    ]


def _begun_requests(case: Case) -> Iterator[int]:
    """Yield where what is torn begins as all requests do, and no bare answer."""
    known = case.ledger.exchanges.kinds.requests
    if case.has_bare_answers and (size := header_of(known) if known else 0):
        yield from (d.at for d in case.damages if d.got[:size] == known[0][:size])


def _names(case: Case, s: SecondAnswer) -> bool:
    """Tell whether a whole answer says whose it is, as one with a header does."""
    return not case.protocol.ordered and s.length > 1


def _named(s: SecondAnswer) -> TornPlace:
    begins, ends = s.times[1]
    own = s.servo_id
    return TornPlace(s.at, s.length, own, begins, ends, -1, True, 0, s.asked_before, named=own)


def _is_behind(d: Damage) -> bool:
    """Tell whether bytes of no frame stand behind an answer, where they may be a second one."""
    asked = d.asked_before[:1]
    return d.turn in STRAYS and d.behind == RESPONSE and bool(asked) and asked[0].is_answered


def _second(d: Damage, byte_ns: int) -> SecondAnswer:
    """Return such bytes as a second answer: a bare one has no header that would tell it."""
    ended = d.begins_ns - d.since_ns
    times = (ended - d.length * byte_ns, ended), (d.begins_ns, d.t_ns)
    return SecondAnswer(d.at, d.length, d.asked_id, times, d.asked_before)


def _less_steady(pairs: Sequence[SecondAnswer], grid: int) -> Iterator[TornPlace]:
    """Yield of every two answers to a request the one that is not the servo's own.

    That is the second, unless the first comes far less steadily behind the request: then it is
    another's, and was taken for the answer.
    """
    by_servo: dict[int, list[SecondAnswer]] = {}
    for s in pairs:
        by_servo.setdefault(s.servo_id, []).append(s)
    for servo, some in by_servo.items():
        since = np.array([[t[1] - s.asked_before[0].t_ns for t in s.times] for s in some])
        varies = np.subtract(*quantile(since, (0.75, 0.25), axis=0))
        is_own = bool(varies[0] > STEADIER * varies[1] + max(CLOCK_NS, grid))
        for s in some:
            begins, ends = s.times[0 if is_own else 1]
            own = servo if is_own else -1
            yield TornPlace(s.at, s.length, servo, begins, ends, own, True, 0, s.asked_before)


def _within(few: tuple[int, int], most: tuple[int, int]) -> float:
    """Return how much likelier it is that places lie thickest in a part of a span than evenly.

    A second answer comes as steadily as the first; where a request lies over it, that begins first.
    """
    (n, span), (all_of, wide) = few, most
    if span >= wide:
        return 0.0
    rest = all_of - n
    return n * log(n * wide / (all_of * span)) + rest * log(rest * wide / (all_of * (wide - span)))


def _steadiest(servo: int, traces: Sequence[TornPlace], grid: int, *, is_by_end: bool) -> Owner:
    """Return the span of time behind a servo's requests in which places are that chance puts not.

    Its own torn answers differ in length by what they answer: each length of request has its span.
    """
    pairs: dict[int, list[tuple[int, int]]] = {}
    for k, t in enumerate(traces):
        moment, is_own = t.t_ns if is_by_end else t.begins_ns, t.own_id == servo
        for asked in t.asked_before:
            if asked.servo_id == servo and (asked.is_answered or is_own):
                since = moment - asked.t_ns
                if 0 < since <= LATEST_NS:
                    pairs.setdefault(t.asked if is_own else 0, []).append((since, k))
    spans = [_thickest(some, grid) for some in pairs.values() if len(some) >= LEAST]
    mine = sorted({k for span in spans for k in span.rows})
    return Owner(
        servo,
        tuple(traces[k] for k in mine),
        min((span.first_ns for span in spans), default=0),
        max((span.last_ns for span in spans), default=0),
        sum(span.score for span in spans),
        0.0,
        len(traces),
    )


class _Span(NamedTuple):
    """A span of time with the rows that are in it."""

    first_ns: int
    last_ns: int
    rows: tuple[int, ...]
    score: float


def _thickest(pairs: Sequence[tuple[int, int]], grid: int) -> _Span:
    """Return where times (with their rows) are thickest, with all that a servo's time may vary.

    Moments on a grid are away from it by as much as it is wide: so much wider is each span.
    """
    since, which = np.array(sorted(pairs), np.int64).T
    spans = [span + grid for span in SPANS_NS]
    begins, ends, score, most = 0, 0, 0.0, (0, 0)
    thick = []  # of each span the most places in it: how many, and how wide it is
    for span in spans:
        last = np.searchsorted(since, since + span, "right")
        first = int(np.argmax(last - np.arange(len(since))))
        n = len(numbers(which[first : last[first]]))
        thick.append((n, span))
        told = n * float(np.log(n * LATEST_NS / (len(since) * span)))
        if told > score:
            begins, ends, score, most = (
                int(since[first]),
                int(since[last[first] - 1]),
                told,
                (n, span),
            )
    score += max((_within(few, most) for few in thick if 0 < few[0] < most[0]), default=0.0)
    last = np.searchsorted(since, since + spans[-1], "right")
    around = np.flatnonzero((since <= begins) & (since + spans[-1] >= ends))
    if not len(around):
        return _Span(0, 0, (), 0.0)
    first = int(around[np.argmax((last - np.arange(len(since)))[around])])
    rows = numbers(which[first : last[first]])
    return _Span(int(since[first]), int(since[last[first] - 1]), tuple(rows.tolist()), score)
