"""When things are said: cycles, stalls, bus load. Silent where the stamps cannot carry it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.decoding.pacing import ASSUMED
from sniffer.diagnosis.case import BUCKET_NS, episodes
from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.cycles import (
    BEAT,
    CYCLES,
    EDGE,
    ITS_STEP,
    LONGER,
    SPREAD,
    SPREAD_NS,
    STALL_NS,
    cycle_of,
    is_by_hand,
    is_in_bursts,
    is_kept_waiting,
    is_steady_for_a_while,
    planned,
    whole_cycles,
    without_slower_loops,
)
from sniffer.diagnosis.evidence.order import Order
from sniffer.diagnosis.evidence.paces import (
    is_between_paces,
    is_of_slower_loop,
    rests_of,
    usual_around,
)
from sniffer.diagnosis.ledger.silences import MISSING
from sniffer.diagnosis.model import Finding, Place
from sniffer.ground.medians import median
from sniffer.ground.model import MS, NS, Clock, MarkKind
from sniffer.ground.timing import byte_time_ns

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.exchanges import Pause
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import I64, Mask

FINDINGS: Final = (
    FindingCode(
        "loop-stalls",
        "The controller's loop stops for several cycles, and goes on.",
        "Pauses before requests that come without one in nearly every cycle, longer than two usual "
        "pauses, than two of those around it, and than two of those before the same request, beyond what "
        "the stamps leave open, with no missing answer or damage in them, not in every cycle for a while, "
        "not alike and three tenths of the time, nor behind a request that mostly has such a pause behind "
        "it, nor where the two requests before, around or behind it mostly have one, or hardly ever follow each "
        "other: the program's steps; "
        "nor before one servo after the other, alike in length and in time, as who homes them one by one rests, "
        "nor as long as those before it mostly are, or behind it: a loop that was slower, or will be; nor where like requests come only now and then, as by hand.",
    ),
    FindingCode(
        "loop-jitters",
        "The controller's loop is uneven: its cycles differ by half their length and more.",
        "The times between like requests: how far those at 5 % and at 95 % are from the middle, twice the "
        "lesser of both, less what the stamps leave open; not three periods that hold most of them, nor "
        "lengths with none between, nor cycles that are all about as long as those around them; each cycle in "
        "which something failed is left out at both ends, or where that is a tenth and more, one by "
        "one, with the cycle behind it; it goes on for most of the "
        "time; and what comes late does not come right behind something else that the program "
        "had to say; all that at the slowest rate, too, that the stamps leave open where none was stated.",
    ),
    FindingCode(
        "bus-full",
        "The line has no time left: bytes are on it nearly all the time.",
        "Bytes of frames times the byte time, as a share of the time in each quarter second; at a rate that "
        "was stated or that the stamps tell.",
    ),
    FindingCode(
        "coarse-stamps",
        "The host holds bytes for so long that cycles and answers cannot be timed: a tap with exact "
        "stamps would tell them.",
        "The latency that was stated, that the stamps show, or that the kind of clock has.",
    ),
)

FAILS_MOST: Final = 0.1
"""Share of cycles left out at each end: those in which something failed, which a timeout makes longer
and the next one shorter. Where it is more, they are told from the others one by one: with so many
left out nobody sees how uneven the others are."""

FREE_RUNNING_NS: Final = 6 * MS
"""A controller that never rests longer has no cycle to keep: it asks as soon as it is answered."""

SLOWEST_NS: Final = NS // 5
"""What comes less often than five times a second is no control loop: a program that sends a servo
somewhere and looks where it got to rests for as long as that takes, 0.2 to 0.8 s."""

TURNS: Final = 0.1
"""Part of a cycle by which so many of them may miss the middle of what has its turn each time."""

OFTEN: Final = 0.15
"""Share of the requests of one kind that may have a stall before them; more is the program's way."""

ITS_STEP_TIMES: Final = 3
"""So many requests of one kind with a rest behind: there a program has done what it had to do."""

PERSON_NS: Final = NS // 2
"""Nobody stops a program and starts it again within half a second: what is longer may be a person's
doing, unless it happens time and again and never lasts long."""

PERSON_MOST_NS: Final = 2 * NS
PERSON_TIMES: Final = 5
"""So many times: of a person's rests of up to six seconds three are that short once in fifty
captures by chance, five once in seven hundred."""

RESTS: Final = 0.3
"""Part of the time that a program stands by plan, as behind each step."""

TAIL: Final = 4
"""How many times as late as one cycle in twenty a pause is that no uneven loop has by chance."""

FULL: Final = 0.85
"""Busy share of a full line: between two frames stands no more than what servos take to answer."""

CARRIED: Final = 1.1
"""Of more than that nobody knows the rate: a line carries no more than all, by a clock 2 % fast, and of
what a host took late some falls into the quarter second behind."""

FULL_NS: Final = 2 * NS
"""A burst of less is no bus without time."""

COARSE_NS: Final = 4 * MS
"""A loop of 100 cycles a second has 10 ms: stamps that are off by half of that tell nothing of it."""

DAMAGE: Final = (
    "bad-checksum",
    "damaged-frame",
    "truncated-frame",
    "idle-tail",
    "noise",
    "damaged-response",
    "mismatched-response",
    "bytes-lost",
    "port-lost",
    "not-decoded",
    "line-break",
)
"""Codes that explain a pause: what was said in it was not understood, or was not heard."""


def loop_jitters(case: Case) -> Iterator[Finding]:
    """A loop whose cycles differ much."""
    exchanges, periods = case.ledger.exchanges, case.ledger.periods
    rest = exchanges.idle.at(0, 0.99)
    if not case.has_clock or not periods.keys or rest is None or rest.low < FREE_RUNNING_NS:
        return
    most, lasts_ns = max(map(periods.count, periods.keys)), case.last_ns - case.first_ns
    edge = EDGE + _failing(case) / most
    if edge > FAILS_MOST:  # those in which nothing failed tell, where there are enough of them
        periods, edge = whole_cycles(case, MISSING, *DAMAGE), EDGE
        most = max(map(periods.count, periods.keys), default=0)
        lasts_ns = max(map(periods.total, periods.keys), default=0)
    spreads = [
        found
        for key in periods.keys
        if periods.count(key) >= most * BEAT and (found := cycle_of(case, periods, key, edge))
    ]
    if not spreads:
        return
    often = max(spreads, key=lambda s: s[-1])
    # What is asked twice in a cycle, or at times, is uneven by plan: the steadiest one tells.
    steadiest = min(spreads, key=lambda s: s[0] / _beat(s[1], often[1]))
    told = often if _beat(steadiest[1], often[1]) == often[1] else steadiest
    spread, middle = steadiest[0], told[1]
    if middle > SLOWEST_NS or spread < max(SPREAD * middle, SPREAD_NS):
        return
    low, high, count = told[2:]
    if is_in_bursts(lasts_ns, count, middle):
        return
    if is_steady_for_a_while(case) or is_kept_waiting(case):
        return
    yield Finding(
        "loop-jitters",
        None,
        case.first_ns,
        case.last_ns,
        count,
        f"{count} cycles of {middle / MS:.1f} ms at the middle: one in twenty is shorter "
        f"than {low / MS:.1f} ms, one in twenty longer than {high / MS:.1f} ms "
        f"(stamps good to {case.latency_ns / MS:g} ms)",
        strength=min(0.5 + spread / middle, 1.0),
        brief=f"cycles of {low / MS:.0f} to {high / MS:.0f} ms",
        values=(("middle_ns", middle), ("spread_ns", spread), ("late_ns", high - middle)),
    )


def _beat(middle: int, often: int) -> int:
    """Return the loop's cycle by how far apart like requests are, and those that come most often.

    Whose turn comes in every second or third cycle is late by as much as a cycle is, not by twice that.
    """
    turns = round(middle / often)
    return often if turns > 1 and abs(middle - turns * often) <= TURNS * often else middle


def _failing(case: Case) -> int:
    """Return how many exchanges failed, but for those that do in each cycle: nobody is there."""
    always = sum(case.total("asked", s) for s in case.servos if not case.total("ok", s))
    return max(case.total("asked") - case.total("ok") - always, case.count(*DAMAGE))


def loop_stalls(case: Case) -> Iterator[Finding]:
    """A loop that stops for several cycles."""
    line = case.line
    spoken = line["pause_max"][line["pause_max"] > 0]
    if not case.has_clock or not len(spoken):
        return
    usual = float(median(spoken))
    least = LONGER * usual + STALL_NS + 2 * case.latency_ns
    for uneven in loop_jitters(case):  # its longest cycles are what it is uneven by
        least = max(least, usual + TAIL * uneven.value("late_ns"))
    if usual > SLOWEST_NS or is_by_hand(case):
        return
    rests = rests_of(case)
    longer = [p for p in rests if p.sure_ns >= LONGER * usual]
    by_plan = planned(case, longer)
    stalls = [p for p in rests if p.sure_ns >= least and p.at not in by_plan]
    stalls = without_slower_loops(case, sorted(stalls, key=lambda p: p.t_ns), usual)
    stalls = [p for p in stalls if p.sure_ns >= LONGER * usual_around(case, p)]
    stalls = [p for p in stalls if not is_of_slower_loop(case, p)]
    stalls = [p for p in stalls if not is_between_paces(case, p)]
    stalls = [p for p in stalls if _in_the_loop(case, p, usual)]
    if not stalls:
        return
    order = case.once(Order)
    damaged = damaged_at(case)
    kinds = case.ledger.exchanges.kinds
    before = np.bincount([p.next_kind for p in stalls], minlength=len(kinds))
    behind = np.bincount([p.kind for p in stalls], minlength=len(kinds))
    stalls = [
        p
        for p in stalls
        if before[p.next_kind] <= OFTEN * kinds.n[p.next_kind]
        and behind[p.kind] < max(ITS_STEP * kinds.n[p.kind], ITS_STEP_TIMES)
        and p.sure_ns >= LONGER * _usual_before(case, p.next_kind)
        and not is_explained(p, damaged, usual)
        and not order.leaves_out(p.kind, p.next_kind)  # what is missing was not heard
    ]
    if not stalls or not _is_no_person(stalls) or _are_rests(stalls):
        return
    longest = max(stalls, key=lambda p: p.sure_ns)
    yield Finding(
        "loop-stalls",
        None,
        stalls[0].t_ns,
        stalls[-1].t_ns + stalls[-1].sure_ns,
        len(stalls),
        f"{len(stalls)} pauses of at most {longest.sure_ns / MS:.0f} ms (± {case.latency_ns / MS:g}) "
        f"where the longest is usually {usual / MS:.0f} ms, and no answer was missing",
        tuple(
            Place(p.at, 1, p.t_ns, f"then {p.sure_ns / MS:.0f} ms of nothing") for p in stalls[:3]
        ),
        strength=min(0.7 + 0.1 * len(stalls), 1.0),
        brief=f"the loop stops for {longest.sure_ns / MS:.0f} ms",
        episodes=tuple((p.t_ns, p.t_ns + p.sure_ns) for p in stalls),
        values=(("longest_ns", longest.sure_ns), ("usual_ns", usual)),
    )


def _in_the_loop(case: Case, pause: Pause, usual: float) -> bool:
    """Tell whether both requests beside a pause are the loop's, which has begun."""
    kinds = case.ledger.exchanges.kinds
    if min(pause.kind, pause.next_kind) < 0 or kinds.n[pause.next_kind] < CYCLES / 2:
        return False
    begun = max(kinds.t_first[pause.kind], kinds.t_first[pause.next_kind])
    return begun <= pause.t_ns - 4 * usual


def _usual_before(case: Case, kind: int) -> int:
    """Return how long the rests before one kind of request are that are no outliers; 0: short ones."""
    exchanges = case.ledger.exchanges
    rests = [p.sure_ns for p in exchanges.pauses if p.next_kind == kind]
    rank = int(OFTEN * exchanges.kinds.n[kind])
    return rests[rank] if rank < len(rests) else 0


def damaged_at(case: Case) -> I64:
    """Return when something was not understood, or read late."""
    told = case.anomalies(*DAMAGE).t_ns, case.remarks(MarkKind.HELD).t_ns
    return np.sort(np.concatenate(told))


def is_explained(pause: Pause, damaged: I64, usual: float) -> bool:
    """Tell whether something was not understood around a pause, or read late."""
    spare = max(STALL_NS, 2 * usual)
    first = np.searchsorted(damaged, pause.t_ns - spare)
    last = np.searchsorted(damaged, pause.t_ns + pause.sure_ns + spare)
    return bool(last > first)


def _is_no_person(stalls: list[Pause]) -> bool:
    longest = max(p.sure_ns for p in stalls)
    short = sum(p.sure_ns <= PERSON_NS for p in stalls)
    return 2 * short >= len(stalls) or (longest <= PERSON_MOST_NS and len(stalls) >= PERSON_TIMES)


def _are_rests(stalls: list[Pause]) -> bool:
    """Tell whether a program stands for about as long as it goes: by plan, not now and then."""
    rests = [p.sure_ns for p in stalls]
    if len(stalls) < PERSON_TIMES or max(rests) > LONGER * min(rests):
        return False
    return sum(rests[:-1]) >= RESTS * (stalls[-1].t_ns - stalls[0].t_ns)


def bus_full(case: Case) -> Iterator[Finding]:
    """A line that is busy nearly all the time."""
    pace = case.ledger.pace
    if not case.has_clock or (pace is not None and pace.rate == ASSUMED and pace.doubtful):
        return
    if pace is None or (pace.rate == ASSUMED and case.ledger.clock != Clock.SAMPLE):
        return
    line = case.line
    # The buckets that are joined, or that the capture only begins or ends in, are no quarter seconds.
    whole = np.flatnonzero(np.diff(line["bucket"], append=line["bucket"][-1:]) == 1)[1:]
    # what is no frame keeps no time from one
    said = line["bytes"][whole] - line["gap_bytes"][whole]
    busy = said * byte_time_ns(case.baud) / BUCKET_NS
    full: Mask = busy >= FULL
    if full.sum() * BUCKET_NS < FULL_NS or 2 * full.sum() < len(whole):
        return
    if float(busy[full].mean()) > CARRIED:
        return
    rows = whole[full]
    spans = episodes(line["bucket"][rows] * BUCKET_NS, (line["bucket"][rows] + 1) * BUCKET_NS)
    share = float(busy[full].mean())
    yield Finding(
        "bus-full",
        None,
        spans[0][0],
        spans[-1][1],
        int(full.sum()),
        f"for {full.sum() * BUCKET_NS / NS:g} s bytes are on the line {min(share, 1):.0%} of the time "
        f"at {case.baud} baud",
        (Place(int(line["at"][rows[0]]), 1, spans[0][0], "here the line is full"),),
        brief=f"the line is busy {min(share, 1):.0%} of the time",
        episodes=spans,
        values=(("busy", share),),
    )


def coarse_stamps(case: Case) -> Iterator[Finding]:
    """Stamps that cannot carry a verdict about time."""
    if not case.has_clock or case.latency_ns < COARSE_NS:
        return
    yield Finding(
        "coarse-stamps",
        None,
        case.first_ns,
        case.last_ns,
        1,
        f"stamps may lag {case.latency_ns / MS:g} ms behind the bytes: what is shorter is not judged; "
        "an adapter with a low latency timer, or a logic analyser, would tell it",
        values=(("latency_ns", case.latency_ns),),
    )


RULES: Final[tuple[Rule, ...]] = (loop_jitters, loop_stalls, bus_full, coarse_stamps)
"""The rules of this area."""
