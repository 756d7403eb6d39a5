"""Whether cycles of different lengths and rests are a program's plan: no uneven loop, no stall."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.case import BUCKET_NS
from sniffer.diagnosis.evidence.tracks import track
from sniffer.diagnosis.ledger.histograms import Histograms
from sniffer.ground.medians import median, quantile
from sniffer.ground.model import MS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.exchanges import Pause
    from sniffer.ground.model import I64

EDGE: Final = 0.05
"""Where a spread is measured; a loop that became uneven late in a capture still shows there."""

SPREAD: Final = 0.5
"""Part of a cycle by which those of an uneven loop differ; a sleeping script's by a third."""

SPREAD_NS: Final = 4 * MS
"""Less than a scheduler's tick of a busy host is not worth a word."""

CYCLES: Final = 40
"""Cycles that make a loop."""

REGIMES: Final = 0.75
"""Part of the cycles in three periods: a program that does one thing, then another, has some; a
loop that trembles has all between."""

PERIOD: Final = 5
"""Bins that are one period: 3 % to both sides."""

RARE: Final = 0.01
"""Part of the cycles that a length must have to be one of the program's."""

SEVERAL: Final = 3
"""Octaves between the short times and the long ones of what is asked several times in a cycle."""

NEAR: Final = 4
"""Cycles on each side that are around one."""

STEADY: Final = 0.6
"""How much less uneven than all cycles those beside each other are where each phase is steady."""

RUNS: Final = 0.4
"""Part of a capture that a loop's cycles fill, if it is one; those that are late at random fill two
thirds. Goals that come while a person moves a slider are no cycles."""

BEAT: Final = 1 / 3
"""What is asked so many times as often as what is asked most may be what has the loop's cycle."""

KEPT_WAITING: Final = 0.5
"""Part of the late cycles that begin right behind another job of the program: it was busy."""

BEGINS: Final = 0.25
"""Part of the cycles in time that begin behind a rest where a request begins a job: on a line that
is nearly full the other cycles stand right behind another job, too."""

ITS_STEP: Final = 0.5
"""Share of the times something is said that a rest stands there: there a program has done what it
had to do, or begins something else. What stops a loop takes no heed of where the program is."""

TWICE: Final = 2
"""A place in a program is one where it rests so many times."""

SELDOM: Final = 0.01
"""Part of the times a request is said, or twice, that another one follows it where neither is said
in a loop: a loop that stops goes on where it was. An order in which 30 servos come by chance has
each pair three times as often; what a window beside asks once a second, of a servo after the other,
is seldom, too, and stands beside one stall in a hundred."""

SHARED: Final = 0.5
"""Part of the kinds of requests on both sides of a pause that both have where one loop goes on."""

AHEAD: Final = 2.0
"""How many times as far as mostly goals may go in the time of a pause where they follow a path."""

TURNS: Final = 3
"""So many rests before as many servos, one behind the other in their order, are each one's turn."""

ALIKE: Final = 0.1
"""Part by which rests of one sleep may differ; a busy host is as late as that."""

LONGER: Final = 2.0
STALL_NS: Final = 10 * MS
"""A stall is so many usual pauses and so much longer: a cycle was missed, and is not only late."""

SLOWER: Final = 4
"""So many such pauses in a row, with nothing between them but one cycle's requests, are a slower
loop: a program that looks less often now."""


def lumps(bins: I64, wide: int = PERIOD) -> float:
    """Return the part of all cycles that the fullest three periods have, so many bins each."""
    left, held = bins.copy(), 0
    for _ in range(3):
        window = np.convolve(left, np.ones(wide, np.int64))[wide - 1 :]  # from each bin on
        top = int(window.argmax())
        held += int(window[top])
        left[top : top + wide] = 0
    return held / max(int(bins.sum()), 1)


def is_parted(bins: I64, per_octave: int) -> bool:
    """Tell whether cycles are of lengths far apart, with none between: so a plan has it.

    Each length is steady, or what is asked several times in a cycle has the short ones.
    """
    held = np.flatnonzero(bins >= max(RARE * int(bins.sum()), 1))
    parts = np.split(held, np.flatnonzero(np.diff(held) > per_octave / 2) + 1)
    wide = max(len(held) and (part[-1] - part[0] + 1) for part in parts) / per_octave
    total = np.cumsum(bins)
    low, high = (int(np.searchsorted(total, s * total[-1])) for s in (EDGE, 1 - EDGE))
    is_several = high - low > SEVERAL * per_octave
    return len(parts) > 1 and (is_several or bool(2.0**wide - 1 < SPREAD))


def whole_cycles(case: Case, *failures: str) -> Histograms:
    """Return the times between like requests, by kind, in which nothing failed, nor right before.

    Nothing where more failed than is known one by one.
    """
    out = Histograms(case.ledger.periods.per_octave)
    failed = case.anomalies(*failures).t_ns
    if case.count(*failures) > len(failed):
        return out
    for t, kind in case.ledger.exchanges.moments.stretches()[:1]:
        for k in np.flatnonzero(np.bincount(kind[kind >= 0]) >= CYCLES).tolist():
            begins = t[kind == k]
            by_then = np.searchsorted(np.sort(failed), begins)
            period = np.diff(begins)[1:][by_then[2:] == by_then[:-2]]
            out.add(np.full(len(period), k), period, period)
    return out


def cycle_of(
    case: Case, periods: Histograms, key: int, edge: float
) -> tuple[int, int, int, int, int] | None:
    """Return by how much the times between like requests differ, their middle, ends and count.

    Ends are so far from the shortest and the longest that what failed cannot have made them.
    """
    low, middle, high = (periods.at(key, share) for share in (edge, 0.5, 1 - edge))
    if low is None or middle is None or high is None or periods.count(key) < CYCLES:
        return None
    bins = periods.counts(key)
    if lumps(bins) >= REGIMES or is_parted(bins, periods.per_octave):
        return None
    # Pauses make cycles longer and none shorter: what is uneven is so on both sides.
    side = min(middle.low - low.high, high.low - middle.high)
    # those nearer the middle differ less, at least by so much where all lengths are as frequent
    wider = (1 - 2 * EDGE) / (1 - 2 * edge)
    spread = max(round(2 * side * wider) - 2 * case.latency_ns, 0)
    return spread, middle.high, low.high, high.low, periods.count(key)


def is_in_bursts(lasts_ns: int, count: int, middle_ns: int) -> bool:
    """Tell whether cycles, so many of such a length, come only now and then: by hand, as a rule."""
    return count * middle_ns < RUNS * lasts_ns


def is_by_hand(case: Case) -> bool:
    """Tell whether like requests come only now and then, whoever they are to: no loop goes on."""
    periods, lasts_ns = case.ledger.periods, case.last_ns - case.first_ns
    most = max(map(periods.count, periods.keys), default=0)
    often = [k for k in periods.keys if periods.count(k) >= most * BEAT]
    middles = [(k, periods.at(k, 0.5)) for k in often]
    return all(is_in_bursts(lasts_ns, periods.count(k), m.high) for k, m in middles if m)


def is_steady_for_a_while(case: Case) -> bool:
    """Tell whether each cycle is about as long as those around it, however they differ in all.

    Who does one thing after the other has a period for each; a loop that trembles has a longer and
    a shorter cycle side by side.
    """
    for t, kind in case.ledger.exchanges.moments.stretches():
        n = np.bincount(kind[kind >= 0])
        for k in np.flatnonzero(n >= max(CYCLES, n.max(initial=0) / 2)).tolist():
            period = np.diff(t[kind == k])
            beside = np.lib.stride_tricks.sliding_window_view(period, 2 * NEAR + 1)
            middle = median(beside, axis=1)
            off = period[NEAR:-NEAR] - middle
            side = np.minimum(-quantile(off, EDGE), quantile(off, 1 - EDGE))
            if 2 * (side - case.latency_ns) < STEADY * SPREAD * median(middle):
                return True
    return False


def is_kept_waiting(case: Case) -> bool:
    """Tell whether what comes late comes as soon as the program has done something else.

    Who has several timers and one line says the one thing when the other is done: what else begins
    behind a rest has none before it when it is late. A loop that trembles is late behind a rest.
    Where nobody stated the rate, one at which it is so is enough.
    """
    slower_ns = case.ledger.exchanges.slower_ns
    return any(_is_kept_waiting(case, ns) for ns in ((0, slower_ns) if slower_ns else (0,)))


def _is_kept_waiting(case: Case, slower_ns: int) -> bool:
    """Tell it where a byte takes so much longer than at the rate by which the bus is timed."""
    kinds, turns = case.ledger.exchanges.kinds, case.ledger.exchanges.turns
    length = np.array([len(example) for example in kinds.example], np.int64)
    turn = np.array([b.low if (b := turns.at(k, EDGE)) else 0 for k in range(len(kinds))], np.int64)
    for t, kind in case.ledger.exchanges.moments.stretches():
        # A stamp says when a request ended: it began as much sooner as its bytes took longer.
        shortest = np.full(len(kinds), length.max(), np.int64)
        known = np.minimum(kind[:-1], kind[1:]) >= 0
        np.minimum.at(shortest, kind[:-1][known], length[kind[1:][known]])
        took = length * case.ledger.byte_ns + np.maximum(turn - shortest * slower_ns, 0)
        for k in np.flatnonzero(kinds.n >= max(CYCLES, kinds.n.max() / 2)).tolist():
            rows = np.flatnonzero(kind == k)[1:]
            if not len(rows):
                continue
            idle = t[rows] - t[rows - 1] - took[kind[rows - 1]] - length[k] * slower_ns
            period = np.diff(t[kind == k])
            late = period > (1 + SPREAD / 2) * median(period)
            held = late & (idle - case.latency_ns <= SPREAD_NS)
            begins = bool(quantile(idle[~late], 1 - BEGINS) > SPREAD_NS)
            if begins and held.sum() >= max(KEPT_WAITING * late.sum(), 1):
                return True
    return False


def planned(case: Case, rests: Sequence[Pause]) -> set[int]:
    """Return which pauses, by place, a program has by plan: between steps, motions, activities."""
    return set[int]().union(*(tell(case, rests) for tell in (steps, turns, motions, activities)))


def steps(case: Case, rests: Sequence[Pause]) -> set[int]:
    """Return which pauses, by place, stand between two steps of a program.

    What is said before it, around it or behind it, two requests at a time, is mostly said at a
    rest: who sends a servo somewhere and asks until it is there rests then, and begins anew. Or
    it is hardly ever said else: the program was done with one thing, and began another.
    """
    found: set[int] = set()
    for t, kind in case.ledger.exchanges.moments.stretches():
        pair = (kind[:-1] + 1) * (int(kind.max(initial=0)) + 2) + kind[1:] + 1
        code, row, total = np.unique(pair, return_inverse=True, return_counts=True)
        begins = np.searchsorted(t, [p.t_ns for p in rests])
        place = {
            int(i) - 1: p.at
            for i, p in zip(begins, rests, strict=True)
            if 0 < i < len(kind) and (kind[i - 1], kind[i]) == (p.kind, p.next_kind)
        }
        # Where nothing but one request stands behind a pause, nothing goes on.
        found.update(at for i, at in place.items() if i == len(pair) - 1)
        said = np.bincount(kind + 1)[kind[:-1] + 1]
        is_seldom = total[row] <= np.maximum(SELDOM * said, TWICE)
        for beside in (-1, 0, 1):
            told = [(i + beside, at) for i, at in place.items() if 0 <= i + beside < len(row)]
            found.update(at for i, at in told if is_seldom[i])
            held = row[np.array([i for i, _ in told], np.int64)]
            times = np.bincount(held, minlength=len(code))
            its = (times >= TWICE) & (times >= ITS_STEP * total)
            found.update(at for (_, at), k in zip(told, held, strict=True) if its[k])
    return found


def turns(case: Case, rests: Sequence[Pause]) -> set[int]:
    """Return which pauses, by place, a program has before each servo in turn.

    Who homes its joints does the same with one after the other, and sleeps as long each time. What
    stops a loop three times alike finds three servos in their order once in many times.
    """
    found: set[int] = set()
    place = {servo: nth for nth, servo in enumerate(case.answering)}
    kinds, alike_ns = case.ledger.exchanges.kinds, 2 * case.latency_ns
    row: list[Pause] = []
    for p in sorted(rests, key=lambda p: p.t_ns):
        nth = place.get(kinds.servo_id[p.next_kind]) if p.next_kind >= 0 else None
        if nth is not None and row:
            last = row[-1]
            goes_on = nth == place[kinds.servo_id[last.next_kind]] + 1
            goes_on &= abs(p.sure_ns - last.sure_ns) <= ALIKE * p.sure_ns + alike_ns
            if len(row) > 1:
                took, before = p.t_ns - last.t_ns, last.t_ns - row[-2].t_ns
                goes_on &= max(took, before) <= 2 * min(took, before)
            if not goes_on:
                row = []
        row = [*row, p] if nth is not None else []
        if len(row) >= TURNS:
            found.update(one.at for one in row)
    return found


def motions(case: Case, rests: Sequence[Pause]) -> set[int]:
    """Return which pauses, by place, stand beside a goal that is far away.

    Behind it a program waits for as long as the way takes, and then looks at the joint. Before it
    the program is done with the last way, and stays there for a while.
    """
    kinds = case.ledger.exchanges.kinds
    found: set[int] = set()
    for p in rests:
        last, then = (kinds.servo_id[k] if k >= 0 else None for k in (p.kind, p.next_kind))
        is_behind = last == then and _goes_far(case, last, p.t_ns)
        if is_behind or _goes_far(case, then, p.t_ns + p.sure_ns, p.sure_ns):
            found.add(p.at)
    return found


def _goes_far(case: Case, servo: int | None, t_ns: int, paused_ns: int = 0) -> bool:
    """Tell whether a servo is sent far away at a moment; behind a pause, farther than it went on.

    Goals that follow a path by the clock are behind a pause where they would be without it.
    """
    joint = track(case, servo) if servo is not None else None
    if joint is None:
        return False
    way = float(median(np.abs(np.diff(joint.goal.last)))) if len(joint.goal) > 1 else 0.0
    went_on = AHEAD * way * (1 + paused_ns / BUCKET_NS) if paused_ns else 0.0
    near = np.abs(joint.goal.t - t_ns) <= BUCKET_NS
    return float(joint.goal.step[near].max(initial=0.0)) > joint.far + went_on


def activities(case: Case, rests: Sequence[Pause]) -> set[int]:
    """Return which pauses, by place, have other requests behind them than before.

    There one thing was done, and another begins: a loop that stops goes on with what it says.
    So many requests are looked at on each side that a loop has said all of its own, twice.
    """
    found: set[int] = set()
    for t, kind in case.ledger.exchanges.moments.stretches():
        wide = 2 * int((np.bincount(kind[kind >= 0]) >= CYCLES).sum())
        for p, i in zip(rests, np.searchsorted(t, [p.t_ns for p in rests]).tolist(), strict=True):
            before, behind = (
                set(kind[max(i - wide, 0) : i].tolist()),
                set(kind[i : i + wide].tolist()),
            )
            if 0 < i < len(t) and len(before & behind) < SHARED * len(before | behind):
                found.add(p.at)
    return found


def without_slower_loops(case: Case, stalls: Sequence[Pause], usual: float) -> list[Pause]:
    """Leave out pauses (in order) that come in every cycle for a while.

    What is said between them takes no more than a usual pause or, where they are alike, than they
    do themselves, however many servos are asked.
    """
    rows: list[list[Pause]] = []
    for p in stalls:
        last = rows[-1][-1] if rows else p
        longer, shorter = max(p.sure_ns, last.sure_ns), min(p.sure_ns, last.sure_ns)
        is_alike = longer - shorter <= ALIKE * longer + 2 * case.latency_ns
        spare = max(usual, STALL_NS, last.sure_ns if is_alike else 0)
        between = p.t_ns - last.t_ns - last.sure_ns
        if last is not p and between <= spare and longer <= LONGER * shorter:
            rows[-1].append(p)
        else:
            rows.append([p])
    return [p for row in rows if len(row) < SLOWER for p in row]
