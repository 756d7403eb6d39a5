"""Two controllers on one bus: requests in two rhythms that have nothing to do with each other."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.cycles import lumps
from sniffer.diagnosis.evidence.stamps import EXACT_NS
from sniffer.diagnosis.ledger.keys import request_key, requested_of
from sniffer.diagnosis.model import Finding, Place
from sniffer.diagnosis.rules.line.streams import TIMERS, do_meet, least_together
from sniffer.ground.distinct import within
from sniffer.ground.wording import counted

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import I64

FINDINGS: Final = (
    FindingCode(
        "interleaved-requests",
        "The same requests come in two rhythms at once: at an even period, and at any time between.",
        "Of two servos' requests a quarter or more come sooner than their period, spread evenly over it and in no few places, and hardly one later; "
        "and one period before a request stands another twice as often as by chance, whatever stands between.",
    ),
    FindingCode(
        "unrelated-periods",
        "Requests come in two even periods of which neither is a multiple of the other.",
        "Requests of at least two kinds, each within 3 % of its period in three of five cases, the periods 4 % off any multiple of each other. It counts little where less is torn than by two who do not listen.",
    ),
    FindingCode(
        "rounds-cross",
        "Requests of one round stand between those of another, now here and now there.",
        "A dozen times and more a request stands between two of which one usually follows the other, where it follows "
        "neither usually, and no other usually follows it: at three places or more, of several requests, no one of "
        "which has a place of its own. It counts little where less is torn than by two who do not listen, or ten times "
        "as much as stands so: they miss each other oftener than they meet.",
    ),
)

LEAST: Final = 40
"""Periods of one kind of request: of fewer no shape can be told."""

SOONER: Final = 0.25
LATER: Final = 0.2
"""Parts of all periods."""

EVEN: Final = 0.24
"""What comes sooner is spread: no twentieth of an octave holds more than this part of it. A loop
that waits for what is missing has a few periods, each of which holds a third or so."""

QUARTER: Final = 0.25
SPREAD: Final = 0.65
"""Nor do three windows of a quarter of an octave hold this part of it: spread evenly over its period they
have 0.45, of ten second controllers 0.45 to 0.61; three loops that wait for what is torn, ask again, and
read once more now and then have 0.68 and more."""

BEATS: Final = 2.0
WITHIN: Final = 0.05
"""How many times as often as by chance a request stands one period before another, so nearly: who
keeps a rhythm has them in three of five cases, a loop whose cycles all differ hardly oftener than chance."""

TIGHT: Final = 0.6
"""Part of the periods that are the usual one, where one program keeps the time."""

APART: Final = 0.04
"""How far a ratio of periods must be from a whole number; each is known to 1 %."""

FAR: Final = 6.0
"""Of periods so many times as long nobody can tell whether they are multiples."""

BLUR: Final = 8
"""Periods that are not so many times as long as stamps are late look uneven, or even, by that."""

CROSSINGS: Final = 12
"""Requests within another round that show one."""

ROUND: Final = 100
"""Requests of which an order shows."""

FOLLOWED: Final = 16
USUAL: Final = 0.4
UNUSUAL: Final = 0.25
"""What is followed so often tells what usually follows it: that in so many cases; less is unusual."""

PLACES: Final = 3
"""Places at which requests stand between others' at least."""

OWN: Final = 2 / 3
"""Part of the crossings that one place may have, or each request at a place of its own: what a loop asks in
turn, or in each tenth round, it asks at the same place."""

MET_MORE: Final = 10
"""Torn places for each request between others, up to which they may be of two who do not listen; where
more is torn, requests are missing from the order, and what is altered stands in it."""

_NEAR: Final = 2
"""Bins beside the fullest one that are the same period: 3 %."""


class _Rhythm(NamedTuple):
    """The usual period of one kind of request, in ns, and parts of all periods."""

    key: int
    servo_id: int
    period_ns: float
    tight: float
    sooner: float
    later: float
    lump: float
    in_few: float
    soonest_ns: float
    times: int


def interleaved(case: Case) -> Iterator[Finding]:
    """Requests that two programs send, each at its own period."""
    if not case.has_clock:
        return
    mixed = [
        r
        for r in _rhythms(case)
        if r.sooner >= SOONER
        and r.later <= LATER
        and r.lump <= EVEN
        and r.in_few <= SPREAD
        and r.soonest_ns < 0.4 * r.period_ns
        and r.period_ns > BLUR * case.latency_ns
        and _beats(case, r)
    ]
    if len({r.servo_id for r in mixed}) < 2:
        return
    if not do_meet(case, sum(r.sooner * r.times for r in mixed), least=0):
        return
    most = max(mixed, key=lambda r: r.times)
    yield _finding(
        case,
        "interleaved-requests",
        sum(r.times for r in mixed),
        f"requests to {counted(len({r.servo_id for r in mixed}), 'servo')} come every "
        f"{most.period_ns / 1e6:.1f} ms, and {100 * most.sooner:.0f} % of them at any time between",
        strength=min(0.6 + most.sooner, 1.0),
        brief="the same requests in two rhythms",
    )


def _beats(case: Case, r: _Rhythm) -> bool:
    """Tell whether requests stand one period behind others, whatever was asked between them."""
    kinds = case.ledger.exchanges.kinds
    keys = request_key(*(np.array(c, np.int64) for c in (kinds.servo_id, kinds.op, kinds.address)))
    for t, kind in case.ledger.exchanges.moments.stretches():
        own = t[within(kind, np.flatnonzero(keys == r.key))]
        if len(own) < LEAST:
            continue
        sooner, later = (own - r.period_ns * (1 + side * WITHIN) for side in (1, -1))
        behind = np.searchsorted(own, later, "right") > np.searchsorted(own, sooner)
        expected = 2 * WITHIN * r.period_ns * len(own) / (own[-1] - own[0])
        if behind.mean() >= BEATS * -np.expm1(-expected):
            return True
    return False


def unrelated(case: Case) -> Iterator[Finding]:
    """Requests in two periods that do not belong together."""
    if not case.has_clock:
        return
    even = sorted(
        (r for r in _rhythms(case) if r.tight >= TIGHT and r.period_ns > BLUR * case.latency_ns),
        key=lambda r: r.period_ns,
    )
    if len(even) < 2:
        return
    if case.latency_ns <= EXACT_NS and case.once(least_together) is None:
        return  # one loop whose cycles differ has such periods, too, but its requests keep step
    for slow in reversed(even):
        fast = even[0]
        ratio = slow.period_ns / fast.period_ns
        if ratio > FAR or abs(ratio - round(ratio)) < APART * ratio:
            continue
        torn = int(case.damage["n"].sum())
        yield _finding(
            case,
            "unrelated-periods",
            slow.times + fast.times,
            f"some requests come every {fast.period_ns / 1e6:.1f} ms, others every "
            f"{slow.period_ns / 1e6:.1f} ms, {ratio:.2f} times as long; {torn} torn places",
            strength=1.0 if do_meet(case, slow.times) else TIMERS,
            brief="requests in two unrelated rhythms",
        )
        return


def rounds_cross(case: Case) -> Iterator[Finding]:
    """Requests that stand between others whose order is known: no time is needed to see that."""
    found = [t[crossings_of(kind)] for t, kind in case.ledger.exchanges.moments.stretches()]
    times = sum(map(len, found))
    if not times:
        return
    # what is torn at another time, two have not torn that cross here: one loop began in another order
    spans = [(t[0], t[-1]) for t in found if len(t)]
    meanwhile = sum(any(a <= d.t_ns <= b for a, b in spans) for d in case.damages)
    torn = int(case.damage["n"].sum())
    yield _finding(
        case,
        "rounds-cross",
        times,
        f"{times} requests stand between two of another round, now here and now there; "
        f"{counted(meanwhile, 'place')} torn meanwhile",
        strength=1.0
        if do_meet(case, times, torn=meanwhile) and torn <= MET_MORE * times
        else TIMERS,
        brief="requests of two rounds stand between each other",
    )


def crossings_of(kinds: I64) -> I64:
    """Return which requests stand within another round; none where they may be of one loop.

    Of two rounds through A B C D, of which the second comes a little later::

        heard     A B C A D B C D
        between         A           C D usually follow each other, A here follows and leads nobody
    """
    known = np.flatnonzero(kinds >= 0)
    kinds = kinds[known]
    if len(kinds) < ROUND:
        return known[:0]
    often = np.flatnonzero(np.bincount(kinds) >= FOLLOWED)
    # all that are seldom said are one: none of them has a usual place
    kinds = np.where(within(kinds, often), np.searchsorted(often, kinds), len(often))
    n = len(often) + 1
    pairs = np.bincount(kinds[:-1] * n + kinds[1:], minlength=n * n).reshape(n, n)
    total = pairs.sum(1)
    share = pairs / np.maximum(total, 1)[:, None]
    usual = np.where((total >= FOLLOWED) & (share.max(1) >= USUAL), share.argmax(1), -1)
    before, one, behind = kinds[:-2], kinds[1:-1], kinds[2:]
    # what is seldom said is of a step that a program takes now and then, as switching on servo by servo
    usual[len(often)] = -1
    rows = (one != len(often)) & (usual[before] == behind) & (one != before) & (one != behind)
    rows &= (share[before, one] < UNUSUAL) & (share[one, behind] < UNUSUAL)
    places = np.zeros((n, n), np.int64)
    np.add.at(places, (before[rows], one[rows]), 1)
    times, by_place = int(places.sum()), places.sum(1)
    most = max(by_place.max(), places.max(0).sum(), places.max(1).sum())
    if times < CROSSINGS or (by_place > 0).sum() < PLACES or most > OWN * times:
        return known[:0]
    crossing: I64 = known[1:-1][rows]
    return crossing


def _rhythms(case: Case) -> list[_Rhythm]:
    periods = case.ledger.periods
    edges = 2 ** (
        np.arange(len(periods.counts(periods.keys[0])) if periods.keys else 0) / periods.per_octave
    )
    out = []
    for key in periods.keys:
        count = periods.count(key)
        if count < LEAST:
            continue
        bins = periods.counts(key)
        near = np.ones(2 * _NEAR + 1, np.int64)
        wide = np.convolve(bins, near, "same")
        top = int(wide.argmax())
        before = bins[: max(top - _NEAR, 0)]
        # a twentieth of an octave, as wide as what is called one period
        lump = int(np.convolve(before, near, "same").max()) if len(before) else 0
        sooner = int(before.sum())
        behind = int(bins[top + 4 * _NEAR :].sum())
        first = int(np.searchsorted(np.cumsum(bins), 0.1 * count))
        out.append(
            _Rhythm(
                key,
                requested_of(key),
                float(edges[top]),
                int(wide[top]) / count,
                sooner / count,
                behind / count,
                lump / max(sooner, 1),
                lumps(before, int(QUARTER * periods.per_octave)) if len(before) else 0.0,
                float(edges[min(first, len(edges) - 1)]),
                count,
            )
        )
    return out


def _finding(
    case: Case, code: str, count: int, what: str, *, strength: float, brief: str
) -> Finding:
    return Finding(
        code,
        None,
        case.first_ns,
        case.last_ns,
        count,
        what,
        (Place(int(case.traffic["at"].min(initial=0)), 1, case.first_ns, "the first request"),),
        strength=strength,
        brief=brief,
    )


RULES: Final[tuple[Rule, ...]] = (interleaved, unrelated, rounds_cross)
"""The rules of this file."""
