"""Two controllers of one period: two even rhythms that drift through each other, and tear as they meet."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import at_least, sureness
from sniffer.diagnosis.evidence.placed import finding_of
from sniffer.diagnosis.evidence.stamps import EXACT_NS
from sniffer.diagnosis.evidence.twins import of_twins
from sniffer.diagnosis.ledger.damage import IN_REPLY, IN_REQUEST
from sniffer.diagnosis.rules.line.damaged import singled_out
from sniffer.diagnosis.rules.line.streams import LEAST
from sniffer.ground.medians import median
from sniffer.ground.model import MS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.damage import Damage
    from sniffer.diagnosis.model import Finding
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import I64, Mask

FINDINGS: Final = (
    FindingCode(
        "rhythms-meet",
        "Two rhythms of the same period drift through each other, and frames are torn where they meet.",
        "Requests in two even rhythms whose periods differ by less than 3 %: one wanders through the "
        "other's cycle, at an even pace or now here and now there, three times as far as it trembles from one "
        "period to the next. Torn frames stand where both are due, far oftener than sound ones do, of which "
        "no more than half stand so. Where one servo, or two of one id, may have torn them, more requests than "
        "the torn one are missing that were due.",
    ),
)

NEAR: Final = 0.04
"""Part of the period by which one request of a rhythm may miss its time."""

MISSED: Final = 6
"""Periods that a rhythm may leave out: its requests were torn, or it waited."""

TIGHT: Final = 0.4
"""Part of the requests of a kind that must stand one period, or two, behind each other."""

ALIKE: Final = 0.03
"""By how much two periods may differ that are said to be the same."""

STEADY: Final = 3.0
"""How many times as far as it trembles from one period to the next a rhythm must wander."""

LATE: Final = 2.0
"""By how many times what stamps may be late two rhythms may seem to wander: each by one."""

JUMP: Final = 6.0
"""How many times as far as in the middle one may wander from one period to the next: where a loop of
its own waits for what is missing it jumps, and does not wander."""

LEAST_WAY: Final = 0.01
"""Part of a period that is a way."""

OVER: Final = 0.25
"""Part of an exchange that is a way: who is beside another one now and over it then goes so far.
Behind answers that are text a loop asks sooner or later by the bytes that they have."""

MANY: Final = 16
"""Periods over which one is measured."""

MOST: Final = 16
"""Rhythms that are compared, the longest ones."""

CHECKED: Final = 400
"""Sound requests by which it is known how often both rhythms are due."""

CLEARLY: Final = 2.5
"""How many times the odds of sound frames those of torn ones must be to stand where rhythms meet."""

SELDOM: Final = 0.5
"""Two that drift through each other are due at once for a part of the time: where most of the sound
frames stand so, two kinds of requests of one loop do, which keep step."""

TORN: Final = 3
CHANCE: Final = 1e-2
"""How many torn frames where they meet are no accident, and how likely chance may make it."""


class _Beat(NamedTuple):
    """Requests of one kind that come at an even period, in ns."""

    kind: int
    t: I64
    period: float


class _Meeting(NamedTuple):
    """Two rhythms, and how far one wanders through the other, in periods."""

    one: _Beat
    other: _Beat
    way: float


def rhythms_meet(case: Case) -> Iterator[Finding]:
    """Find frames that are torn where two rhythms meet that drift through each other."""
    torn = [d for d in case.damages if d.t_ns > 0]
    if not case.has_clock or case.latency_ns > EXACT_NS or len(torn) < TORN:
        return
    at = np.array([d.t_ns for d in torn], np.int64)
    span = _exchange_ns(case)
    best: tuple[float, list[int], int, int, int, _Meeting] | None = None
    every: list[_Meeting] = []
    for t, kind in case.ledger.exchanges.moments.stretches():
        pairs = _pairs(_rhythms(t, kind), at, case.latency_ns, span)
        every += pairs
        here = np.flatnonzero((at >= t[0]) & (at <= t[-1])) if pairs else at[:0]
        if len(here) < TORN:
            continue
        some = t[:: max(len(t) // CHECKED, 1)]
        # Who waits for what was torn is late, and tears more.
        for meeting in (_both_due, _both_near):
            rows = here[meeting(at[here], pairs, span)]
            sound = int(meeting(some, pairs, span).sum())
            if sound > SELDOM * len(some):
                continue
            if len(rows) * (len(some) - sound) < CLEARLY * sound * (len(here) - len(rows)):
                continue
            chance = at_least(len(rows), len(here), min((sound + 1) / (len(some) + 1), 1.0))
            if best is None or chance < best[0]:
                widest = max(pairs, key=lambda pair: abs(pair.way))
                best = chance, rows.tolist(), len(here), sound, len(some), widest
    if best is None or len(best[1]) < TORN or best[0] > CHANCE:
        return
    chance, where, judged, sound, n, pair = best
    alone = singled_out(case)
    of_one_id = sum(of_twins(case, torn[k]) for k in where)
    of_one = sum(torn[k].turn == IN_REPLY and torn[k].servo_id in alone for k in where)
    is_one = 2 * max(of_one_id, of_one) > len(where)
    if is_one and 2 * _swallowed([torn[k] for k in where], every, span) < len(where):
        return  # what a twin, or one servo's own fault, tears stands where that one is asked
    yield finding_of(
        [torn[k] for k in where],
        "rhythms-meet",
        None,
        f"two rhythms, of {pair.one.period / MS:.2f} and {pair.other.period / MS:.2f} ms, go "
        f"{abs(pair.way):.2f} of a period through each other; {len(where)} of {judged} torn frames "
        f"stand where they meet, and {sound} of {n} sound ones",
        "two rhythms meet here",
        strength=min(0.5 + len(where) / 20, 1.0) * sureness(chance, CHANCE**2),
        brief="two rhythms drift through each other",
    )


def _exchange_ns(case: Case) -> int:
    """Return how long an exchange takes from the beginning of its request on, the usual longest."""
    exchanges = case.ledger.exchanges
    ends = [e.high for k in exchanges.spans.keys if (e := exchanges.spans.at(k, 0.9)) is not None]
    longest = max((len(one) for one in exchanges.kinds.example), default=0)
    return int(max(ends, default=0)) + longest * case.ledger.byte_ns


def _rhythms(t: I64, kind: I64) -> list[_Beat]:
    """Return the requests that come at an even period: of one kind there may be two such rows."""
    out: list[_Beat] = []
    count = np.bincount(kind[kind >= 0])
    for k in np.flatnonzero(count >= LEAST).tolist():
        mine = t[kind == k]
        for step in (1, 2):  # two who say the same: every second one is of the same rhythm
            between = mine[step:] - mine[:-step]
            period = float(median(between))
            if period > 0 and (np.abs(between / period - 1) < NEAR).mean() >= TIGHT:
                out += [_Beat(k, row, _period(row, period)) for row in _rows(mine, period)]
                break
    return sorted(out, key=lambda r: -len(r.t))[:MOST]


def _period(t: I64, about: float) -> float:
    """Return the period of a row: over many at once it is known better."""
    many = min(MANY, len(t) // 2)
    between = t[many:] - t[:-many]
    return float(median(between / np.maximum(np.round(between / about), 1)))


def _rows(t: I64, period: float) -> list[I64]:
    """Return the moments of each row: what comes a whole number of periods behind its last one."""
    rows: list[list[int]] = []
    live: list[list[int]] = []
    for now in t.tolist():
        live = [row for row in live if now - row[-1] < (MISSED + NEAR) * period]
        off = [
            abs((now - row[-1]) / period - max(round((now - row[-1]) / period), 1)) for row in live
        ]
        best = min(range(len(live)), key=off.__getitem__, default=-1)
        if best >= 0 and off[best] <= NEAR:
            live[best].append(now)
        else:
            live.append([now])
            rows.append(live[-1])
    return [np.array(row, np.int64) for row in rows if len(row) >= LEAST]


def _pairs(rhythms: Sequence[_Beat], torn: I64, latency_ns: int, span: int) -> list[_Meeting]:
    """Return those that drift through each other, other than behind what is torn at some moments."""
    both = [(a, b) for k, a in enumerate(rhythms) for b in rhythms[k + 1 :]]
    ways = ((a, b, _way(a, b, torn, latency_ns, span)) for a, b in both)
    found = [_Meeting(a, b, way) for a, b, way in ways if way is not None]
    return sorted(found, key=lambda pair: -abs(pair.way))


def _way(a: _Beat, b: _Beat, torn: I64, latency_ns: int, span: int) -> float | None:
    """Return how far one rhythm wanders through the other, in periods; None: they keep step.

    A loop that waits for what is torn is late in that cycle, and in time again in the next one. Two
    clocks wander while all is sound, too.
    """
    if abs(a.period / b.period - 1) > ALIKE:
        return None
    row = np.searchsorted(a.t, b.t, "right") - 1
    behind = b.t[row >= 0] - a.t[row[row >= 0]]
    near = behind < 1.5 * a.period
    behind, at = behind[near], b.t[row >= 0][near]
    if len(behind) < LEAST:
        return None
    steps = np.diff(np.unwrap(behind / a.period, period=1.0))
    middle = float(median(steps))
    jump = JUMP * float(median(np.abs(steps - middle)))
    steps = np.clip(steps, middle - jump, middle + jump)
    trembles = float(steps.std()) / 2**0.5
    since, until = (np.searchsorted(torn, t) for t in (at - behind, at))
    place = np.concatenate([[0.0], np.cumsum(steps)])[since == until]
    # what goes up and down from one to the next evens out over many; a way does not
    place = (
        np.convolve(place, np.full(MANY, 1 / MANY), "valid") if len(place) >= MANY else place[:0]
    )
    way = float(place.max() - place.min()) if len(place) else 0.0
    least = max(STEADY * trembles, LATE * latency_ns / a.period, LEAST_WAY, OVER * span / a.period)
    return way if way > least else None


def _both_due(at: I64, pairs: Sequence[_Meeting], span: int) -> Mask:
    """Tell at which moments an exchange of each of two rhythms would be on the line."""
    out = np.zeros(len(at), bool)
    for a, b, _ in pairs:
        out |= (np.abs(_off(at, a)) <= span) & (np.abs(_off(at, b)) <= span)
    return out


def _both_near(at: I64, pairs: Sequence[_Meeting], span: int) -> Mask:
    """Tell in which cycles of two rhythms their exchanges would be on the line at once."""
    out = np.zeros(len(at), bool)
    for a, b, _ in pairs:
        apart = _off(at, a) - _off(at, b)
        out |= np.abs(apart - np.round(apart / a.period) * a.period) <= span
    return out


def _swallowed(torn: Sequence[Damage], pairs: Sequence[_Meeting], span: int) -> int:
    """Return at how many torn places more requests are missing that were due than one that is torn.

    A second answer tears one request, and a servo's own fault none; of two that run into each other
    both are gone.
    """
    at = np.array([d.t_ns for d in torn], np.int64)
    is_one = np.array([d.turn == IN_REQUEST for d in torn])
    most = np.zeros(len(at), np.int64)
    for a, b, _ in pairs:
        missing = _is_missing(at, a, span).astype(np.int64) + _is_missing(at, b, span)
        most = np.maximum(most, missing)
    return int((most > is_one).sum())


def _is_missing(at: I64, rhythm: _Beat, span: int) -> Mask:
    """Tell at which moments a request of a rhythm is due that was not heard."""
    near = np.searchsorted(
        rhythm.t, at[:, None] + np.array([-span, span]) - _off(at, rhythm)[:, None]
    )
    missing: Mask = (np.abs(_off(at, rhythm)) <= span) & (near[:, 0] == near[:, 1])
    return missing


def _off(at: I64, rhythm: _Beat) -> I64:
    """Return how far moments are behind the nearest one at which a rhythm is due."""
    t = rhythm.t
    after = np.minimum(np.searchsorted(t, at), len(t) - 1)
    before = np.maximum(after - 1, 0)
    near = np.where(np.abs(t[after] - at) < np.abs(t[before] - at), t[after], t[before])
    since = (at - near) / rhythm.period
    off: I64 = ((since - np.round(since)) * rhythm.period).astype(np.int64)
    return off


RULES: Final[tuple[Rule, ...]] = (rhythms_meet,)
"""The rules of this file."""
