"""Whether joints follow their goals: limp, blocked, or away for no reason that is measured."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import may_be_torn
from sniffer.diagnosis.evidence.efforts import effort, stops_as_told
from sniffer.diagnosis.evidence.hanging import hangs_behind, hangs_since_it_was_away, is_switched_on
from sniffer.diagnosis.evidence.lastbit import lacks_last_bit
from sniffer.diagnosis.evidence.tracks import LAG_NS, LOOKS, Away, in_force, track
from sniffer.diagnosis.evidence.trips import trips
from sniffer.diagnosis.ledger.damage import IN_REQUEST, STRAYS
from sniffer.diagnosis.model import Finding, Place
from sniffer.diagnosis.rules.device.warmth import hot_times
from sniffer.ground.medians import median, quantile
from sniffer.ground.model import NS
from sniffer.protocols.base import RESTARTS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.evidence.efforts import Effort
    from sniffer.diagnosis.evidence.tracks import JointTrack
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "joint-stalled",
        "A joint is far from its goal, does not come nearer, and its motor pushes.",
        "For a second or longer, or each time that a joint which is looked at seldom is looked at: an error beyond a tenth of what the goals range over, no approach, and a load of 40 % or a current three times the least on the bus, or one that grows and falls with that error. It counts half where the joint each time came there by itself, on the way to one goal, and leaves with the next one; not where it has the current at which a modifier told it to stop.",
        settle="Ask whether it is meant to press there: a gripper that holds and a joint that homes against its stop look alike on the wire. If it is not, move the joint by hand with torque off.",
    ),
    FindingCode(
        "joint-limp",
        "A joint does not follow its goals, and its motor does nothing about it.",
        "For a second or longer: an error as above, no approach, and the load or current of a motor that is off. It counts half where the last that was said of its torque is that it is on, and the servo was never away since.",
        is_lasting=True,
        settle="Read the torque register of the servo. If its torque is on, watch the joint: where that moves, its position sensor stands still; where it does not, its motor or its gear has come loose.",
    ),
    FindingCode(
        "joint-limp-after-alarm",
        "A joint does not follow its goals any more since its servo complained.",
        "As above, and an alarm of that servo, or a temperature at its limit, in the five seconds before.",
        is_lasting=True,
    ),
    FindingCode(
        "joint-limp-after-restart",
        "A joint does not follow its goals any more since its servo was away or told to restart.",
        "As above, and a silence of that servo, or a restart, that ended in the five seconds before; or it moved until the servo first left a request unanswered, and never since.",
        is_lasting=True,
    ),
    FindingCode(
        "stuck-before-alarm",
        "A joint stood still under moving goals when its servo reported an overload.",
        "In the quarter second of the alarm the goals range over a fourth of what counts as far, the positions over less than a quarter of that, and over less than half of it half a second later.",
    ),
    FindingCode(
        "joint-not-following",
        "A joint does not follow its goals, and nothing measured tells whether it pushes.",
        "As above, without load or current, or with one that is neither idle nor pushing; not a joint that came there by itself, on the way to one goal, and leaves with the next one, as a gripper does.",
        is_lasting=True,
    ),
)

ALARMS: Final = (
    "device-overload",
    "device-overheating",
    "device-temperature-limit",
    "device-input-voltage",
    "device-safe-mode",
    "device-blocked",
    "device-stuck",
)
"""Alarms upon which servos switch their motor off, or are about to."""

HARD: Final = 1.25
"""A motor that gives up and tries again pushes less in the middle than it does at its hardest."""

SHORTLY_NS: Final = NS // 10
"""Before an alarm of overload a motor pushes for tenths of a second; less tells nothing."""

SETS_OUT_NS: Final = NS // 2
"""A joint that nothing holds has begun to move by then."""

ENOUGH_NS: Final = 2 * NS
"""A stretch of this length is beyond doubt."""

PUSHES: Final = 3
"""Quarter seconds for which a motor pushes before it gives up: less is a start, or a hard stop."""

PAUSES_NS: Final = NS
"""A motor that does nothing for longer does not push any more."""

ALONG: Final = 4
TOGETHER: Final = 0.8
HARDER: Final = 2.0
"""Quarter seconds in which a motor's effort is held against how far its goal is, the correlation
from which it goes with that, and how many times as hard it works where the goal is far as where it
is near, or as usual."""

WELL: Final = 1.5
"""How many times as far off as what counts as far: a joint that bears too much gives way a little."""

LONE: Final = 0.6
"""How much it counts where no joint of the bus ever followed: positions may be no measurements."""

PERHAPS: Final = 0.5
"""How much it counts that a joint presses as it would by plan, or may not have heard its goals."""

LOST: Final = 0.1
"""Part of the requests, of all or of its own, that are torn where a joint may stand because it is
not told to go."""

FEW: Final = 2
DISPLACED: Final = 0.5
"""Bytes left behind bare answers, and for which part of them, that show that these are not as sent."""

_BRIEF: Final = {
    "joint-stalled": "servo {} pushes and does not move",
    "joint-limp": "servo {} hangs limp",
    "joint-limp-after-alarm": "servo {} lets go",
    "joint-limp-after-restart": "servo {} limp since",
    "joint-not-following": "servo {} does not follow its goals",
}


def following(case: Case) -> Iterator[Finding]:
    """Joints that are away from their goals and do not come nearer."""
    tracks = [t for t in (track(case, s) for s in case.servos) if t is not None]
    moved = any(_moves(t) for t in tracks)
    for one in tracks:
        if may_be_torn(case, int(one.goal.n.sum())) or lacks_last_bit(case, one):
            continue  # what is read from and never sent anywhere has a goal by a torn request
        kinds: dict[str, list[Away]] = {}
        for away in one.away:
            if _is_displaced(case, one, away):
                continue
            code = _kind(case, one, away)
            motor = effort(case, one.servo_id)
            if motor and code in ("joint-limp", "joint-not-following") and _presses(one, away):
                continue
            if motor and stops_as_told(case, one.servo_id, motor, away.first_ns, away.last_ns):
                continue
            kinds.setdefault(code, []).append(away)
            if code.startswith("joint-limp") and motor:
                pushed = _pushed_before(one, motor, away)
                if pushed is not None:
                    kinds.setdefault("joint-stalled", []).append(pushed)
        for code, several in kinds.items():
            yield _found(case, one, code, several, moved=moved or _moves(one))


def _is_displaced(case: Case, one: JointTrack, away: Away) -> bool:
    """Tell whether bare answers of a stretch took stray bytes for their first ones.

    Each of these leaves its last byte behind: what was its load is its place then.
    """
    if case.has_checksum:
        return False
    left = sum(
        d.turn in STRAYS
        and d.asked_id == one.servo_id
        and away.first_ns <= d.t_ns <= away.last_ns + case.latency_ns
        for d in case.damages
    )
    said = int(one.position.n[away.first : away.last + 1].sum())
    return left >= max(FEW, DISPLACED * said)


def stuck(case: Case) -> Iterator[Finding]:
    """Joints that stood still when their servos reported an overload."""
    for servo in case.servos:
        alarms = case.anomalies("device-overload", servo_id=servo)
        one = track(case, servo) if len(alarms) else None
        if one is None:
            continue
        back = np.array([s.back_ns or 0 for s in case.ledger.silences.runs(servo)], np.int64)
        away = trips(case, servo, one.goal)[0]  # no joint follows a goal that is there for moments
        stood = [
            k
            for k, t in enumerate(alarms.t_ns.tolist())
            if _stands(one, t)
            and not ((back <= t) & (back > t - 2 * NS)).any()
            and not any(trip.out.t_ns <= t <= trip.back.t_ns + SETS_OUT_NS for trip in away)
        ]
        if not stood or len(stood) * 2 < len(alarms):
            continue
        rows = alarms.take(np.array(stood))
        yield Finding(
            "stuck-before-alarm",
            servo,
            int(rows.t_ns[0]) - SHORTLY_NS,
            int(rows.t_ns[-1]),
            len(stood),
            f"servo {servo} stood still under moving goals before {len(stood)} of its "
            f"{len(alarms)} overload alarms",
            case.places(rows, "overload reported"),
            brief=f"servo {servo} is stuck",
        )


def _stands(one: JointTrack, t_ns: int) -> bool:
    """Tell whether a joint did not move with its goals right before a moment."""
    p, g = one.position, one.goal
    row = int(np.searchsorted(p.t_first, t_ns, "right")) - 1
    if row > 0 and t_ns - int(p.t_first[row]) < SHORTLY_NS:
        row -= 1  # it has just begun: what was before tells more
    first = row
    while first > 0 and p.n[first : row + 1].sum() < LOOKS and row - first < 2:
        first -= 1
    if row < 0 or p.n[first : row + 1].sum() < LOOKS - 1:
        return False
    since, until = int(p.t_first[first]), t_ns
    goals = np.flatnonzero((g.t >= since) & (g.t_first < until))
    if not len(goals):
        return False
    asked = float(g.high[goals].max() - g.low[goals].min())
    went = float(p.high[first : row + 1].max() - p.low[first : row + 1].min())
    if asked <= one.far / 4 or went >= asked / 4:
        return False
    # who gets up to speed stands still, too, and works hard: a moment later it is gone
    behind = int(np.searchsorted(p.t_first, t_ns + SETS_OUT_NS, "right"))
    goes = float(p.high[first:behind].max() - p.low[first:behind].min())
    return goes < asked / 2


def _moves(one: JointTrack) -> bool:
    """Tell whether a joint ever moved as its goals did."""
    p = one.position
    return float(p.high.max() - p.low.min()) > one.far / 2


def _kind(case: Case, one: JointTrack, away: Away) -> str:
    """Name what a stretch is, by effort and by what was before it."""
    motor = effort(case, one.servo_id)
    if motor is None:
        return "joint-not-following"
    steady, peaks = motor.between(away.first_ns + NS // 2, away.last_ns)
    if steady >= motor.pushes_from or peaks >= HARD * motor.pushes_from:
        return "joint-stalled"
    if not peaks <= motor.idles_to:
        return "joint-stalled" if _pulls_by_error(one, motor, away) else "joint-not-following"
    alarms = case.anomalies(*ALARMS, servo_id=one.servo_id).t_ns
    if hangs_behind(one, away, np.concatenate([alarms, hot_times(case, one.servo_id)])):
        return "joint-limp-after-alarm"
    back = [s.back_ns for s in case.ledger.silences.of(one.servo_id) if s.back_ns is not None]
    begun = np.array([*back, *case.order_times(one.servo_id, RESTARTS).tolist()], np.int64)
    gone = case.ledger.silences.runs(one.servo_id)
    is_since = hangs_behind(one, away, begun) or hangs_since_it_was_away(one, away, gone)
    return "joint-limp-after-restart" if is_since else "joint-limp"


def _pulls_by_error(one: JointTrack, motor: Effort, away: Away) -> bool:
    """Tell whether a motor works the harder the further its goal is: one that is off does not."""
    p, s = one.position, motor.series
    rows = np.flatnonzero((p.t >= away.first_ns) & (p.t_first <= away.last_ns))
    at = np.minimum(np.searchsorted(s.bucket, p.bucket[rows]), len(s) - 1)
    both = s.bucket[at] == p.bucket[rows]
    rows, worked = rows[both], motor.steady[at[both]]
    if len(rows) < ALONG:
        return False
    low, high = in_force(one.goal, p.t_first[rows], p.t[rows])
    off = np.abs((low + high) / 2 - p.last[rows])
    least, most = quantile(worked, [0.1, 0.9])
    least = min(least, float(median(motor.steady)))
    if not off.std() or most < max(HARDER * least, motor.idles_to):
        return False
    return float(np.corrcoef(off, worked)[0, 1]) >= TOGETHER


def _pushed_before(one: JointTrack, motor: Effort, away: Away) -> Away | None:
    """Return when a motor that is off pushed at first, while its joint stood there far from its goal."""
    p, s = one.position, motor.series
    first = away.first
    while first > 0 and abs(p.low[first - 1] - p.last[away.first]) < one.far / 4:
        first -= 1
    stood = (s.t_first >= p.t_first[first]) & (s.t <= away.last_ns)
    rows = np.flatnonzero(stood & (motor.steady >= motor.pushes_from))
    # one push, and not the starts of a motor that cools down, tries again and gives up
    pushes = np.split(rows, np.flatnonzero(s.t_first[rows[1:]] - s.t[rows[:-1]] > PAUSES_NS) + 1)
    rows = max(pushes, key=len)
    if len(rows) < PUSHES or s.n[rows].sum() < LOOKS:
        return None
    low, high = in_force(one.goal, s.t[rows] - NS // 8, s.t[rows])
    stands = p.last[away.first]
    error = float(median(np.maximum(low - stands, stands - high)))
    if error <= WELL * one.far:
        return None
    since, until = int(s.t_first[rows[0]]), int(s.t[rows[-1]])
    looked = np.flatnonzero((p.t >= since) & (p.t_first <= until))
    begin, end = (int(looked[0]), int(looked[-1])) if len(looked) else (first, first)
    return Away(begin, end, since, until, error)


def _presses(one: JointTrack, away: Away) -> bool:
    """Tell whether a joint went towards its one goal, met something, and leaves it with the next goal.

    So does a gripper that is let to press a little; a motor that is off neither comes nor goes.
    """
    p, stands = one.position, float(one.position.last[away.first])
    since, until = np.array([away.first_ns]), np.array([away.last_ns])
    low, high = (float(x[0]) for x in in_force(one.goal, since, until))
    if high - low > one.far / 2:
        return False
    ahead = 1 if low > stands else -1
    first = away.first
    while first > 0 and abs(p.low[first - 1] - stands) < one.far / 2:
        first -= 1
    before = slice(int(np.searchsorted(p.t, p.t_first[first] - LAG_NS)), first)
    way = ahead * (stands - (p.low[before] if ahead > 0 else p.high[before]))
    g = one.goal
    next_goals = np.flatnonzero((g.t > away.last_ns) & (np.abs(g.last - low) > one.far))
    told_ns = int(g.t[next_goals[0]]) if len(next_goals) else int(p.t[-1])
    behind = slice(away.last, int(np.searchsorted(p.t_first, told_ns + 2 * LAG_NS)))
    leaves = np.abs(p.last[behind] - stands) > one.far
    has_come = not first or float(way.max(initial=0.0)) > one.far
    return has_come and bool(leaves.any() or not len(next_goals))


def _goals_are_lost(case: Case, servo: int) -> bool:
    """Tell whether so many requests are torn, to all servos or to one, that goals do not reach it."""
    d, t = case.damage, case.traffic
    torn = d["turn"] == IN_REQUEST
    lost = int(d["n"][torn].sum()), int(d["n"][torn & (d["servo_id"] == servo)].sum())
    came = int(t["requests"].sum()), int(t["requests"][t["servo_id"] == servo].sum())
    return any(n > LOST * (n + asked) for n, asked in zip(lost, came, strict=True))


def _found(
    case: Case, one: JointTrack, code: str, several: Sequence[Away], *, moved: bool
) -> Finding:
    servo, unit = one.servo_id, one.position.unit
    longest = max(several, key=lambda a: a.last_ns - a.first_ns)
    took_ns = longest.last_ns - longest.first_ns
    motor = effort(case, servo)
    works, by_plan = "", code == "joint-stalled" and all(_presses(one, a) for a in several)
    if motor is not None:
        steady, peaks = motor.between(longest.first_ns + NS // 2, longest.last_ns)
        shown = steady if code == "joint-stalled" else peaks
        works = f", with {motor.told(shown)}" if np.isfinite(shown) else ""
    goals = one.goal
    told = np.flatnonzero((goals.t >= longest.first_ns) & (goals.t_first <= longest.last_ns))
    span = (
        f"{goals.low[told].min():.4g} to {goals.high[told].max():.4g} {unit}" if len(told) else ""
    )
    during = f" while its goals went from {span}" if span else ""
    p = one.position
    rows = range(longest.first, min(longest.last + 1, longest.first + 2))
    places = tuple(
        Place(int(p.at[r]), 1, int(p.t_first[r]), f"position {p.told(p.first[r])}") for r in rows
    )
    if len(told):
        g = int(told[0])
        what = f"goal {goals.told(goals.first[g])}"
        places += (Place(int(goals.at[g]), 1, int(goals.t_first[g]), what),)
    sure = 1.0 if took_ns >= ENOUGH_NS or len(several) > 1 else 0.8
    sure *= PERHAPS if by_plan else 1.0
    sure *= PERHAPS if _goals_are_lost(case, servo) else 1.0
    meant = (
        "; it came there on the way to that goal, as one does that is to press" if by_plan else ""
    )
    if code == "joint-limp" and is_switched_on(case, servo, longest):
        sure *= PERHAPS  # its sensor or its gear may be gone as well
        meant = "; its torque was switched on before, and not off since"
    return Finding(
        code,
        servo,
        several[0].first_ns,
        several[-1].last_ns,
        len(several),
        f"servo {servo} stood at {p.told(p.last[longest.last])} for {took_ns / NS:.1f} s"
        f"{during}{works}{meant}",
        places,
        strength=sure if moved else LONE * sure,
        brief=_BRIEF[code].format(servo),
        episodes=tuple((a.first_ns, a.last_ns) for a in several),
        values=(("error", longest.error),),
    )


RULES: Final[tuple[Rule, ...]] = (following, stuck)
"""The rules of this file."""
