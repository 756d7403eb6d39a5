"""Measured values that mechanics forbid: positions and temperatures that jump, and come back."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import TORN
from sniffer.diagnosis.evidence.tracks import FAR, in_force, track
from sniffer.diagnosis.evidence.trips import trips
from sniffer.diagnosis.ledger.returns import TURN
from sniffer.diagnosis.ledger.steps import SPEED
from sniffer.diagnosis.model import Finding, Place
from sniffer.ground.milli import MILLI
from sniffer.ground.model import NEVER_NS, NS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case, Series
    from sniffer.diagnosis.evidence.tracks import JointTrack
    from sniffer.diagnosis.ledger.steps import Leap
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "position-jumps",
        "A measured position jumps as no joint moves.",
        "A step that would be faster than 1500 degrees (400 mm) a second even if the stamps are as wrong as they can be, and four times the greatest step of most of the time; or such a step and one back with the next value, without a goal there; or a step and one back within a quarter second, whatever the goals, both faster than 500 degrees (133 mm) a second. Where no clock tells: away and back within eight values, four times beyond all other steps, and no goal there. All beyond 4 degrees (0.8 mm) and 4 % of the range.",
        remedy="Look at the servo's position sensor (a worn potentiometer jumps) and at its gear; let the controller not act on a single position.",
        settle="Turn the joint slowly by hand with torque off: a worn sensor jumps at the same places.",
    ),
    FindingCode(
        "doubtful-value",
        "A single value stands far from those before and behind it, in a protocol whose answers have no checksum.",
        "Once, or with damage on the line: a position that jumps and comes back with the next value, or a temperature that does so by ten degrees.",
    ),
)

OVER: Final = 3.0
"""How many times what the fastest servo can a jump is; who is back from there at once needs no more
than what it cannot: it was not there."""

AHEAD: Final = 4.0
"""How many times the greatest of the usual steps a jump is."""

USUAL: Final = 0.5
"""Half of the time has no greater steps, however often it jumps."""

LEAST_SHARE: Final = 0.04
"""A jump is at least so much of the register's range, or of what was met, and more than play."""

SOON_NS: Final = NS // 4
"""Within longer times a joint may well have been there and back."""

LATER_NS: Final = 2 * NS
"""The same where its goals are known, and none was there."""

LESS: Final = 0.7
"""How much it counts without a checksum."""

BACK: Final = 0.25
"""A value is back if no more than this part of the jump is left."""

JUMP: Final = "jump"
"""Of a position that jumps: by how much at first, in its unit."""

WARMER_DEGC: Final = 10.0


def positions(case: Case) -> Iterator[Finding]:
    """Positions that jump."""
    yield from case.once(_positions)


def _positions(case: Case) -> Sequence[Finding]:
    out = []
    for servo in case.servos:
        for p in case.every(servo, "position"):
            steps = case.ledger.steps.of(servo, p.index)
            jumps = _jumps(case, servo, p, steps)
            if not case.has_clock:
                jumps = sorted({*jumps, *_trips(case, servo, p)}, key=lambda s: s.at)
            if jumps:
                out.append(_jumped(case, servo, p, jumps))
                break
    return out


def altered_bare(case: Case) -> int:
    """Return of how many servos bare answers are altered, as their values show; one proves nothing.

    Such an answer holds whatever was altered in it: that none looks torn says nothing of answers.
    """
    many = 0 if case.has_checksum else len(case.once(_positions))
    return many if many > 1 else 0


def _jumps(case: Case, servo: int, p: Series, steps: Sequence[Leap]) -> list[Leap]:
    """Return the steps that no joint does."""
    if len(p) < 8:
        return []
    usual = float(np.quantile(p.step, USUAL))
    span = _span(p)
    joint = track(case, servo)
    out: list[Leap] = []
    ways_back: set[int] = set()
    for k, s in enumerate(steps):
        size = s.size / MILLI
        wraps = p.register.range is not None and size > TURN * span
        least = max(AHEAD * usual, LEAST_SHARE * span, FAR.get(p.unit, 0.0))
        if size < least or wraps or s.at in ways_back:
            continue
        follows = steps[k + 1] if k + 1 < len(steps) else None
        back = _way_back(case, p, steps, k)
        if back is not None:
            ways_back.add(back.at)
            out.append(s)  # whatever it was told
            continue
        soon = SOON_NS if joint is None else LATER_NS
        comes_back = _comes_back(s, follows, soon) and s.took_ns <= soon
        # who is there and back within moments was not told so a second ago
        before_ns = SOON_NS if comes_back and s.took_ns <= SOON_NS else NS
        is_told = joint is not None and joint.position.index == p.index
        if joint is not None and is_told and _was_told(joint, s, before_ns):
            continue
        if comes_back or (_is_too_fast(case, p, s) and not _returns(steps, k)):
            out.append(s)
    return out


def _trips(case: Case, servo: int, p: Series) -> Iterator[Leap]:
    """Yield the steps to where a position is for a few values only, and no goal: told by their order."""
    joint = track(case, servo)
    least = max(LEAST_SHARE * _span(p), FAR.get(p.unit, 0.0)) * MILLI
    for out, back in trips(case, servo, p)[0]:
        wraps = p.register.range is not None and out.size / MILLI > TURN * _span(p)
        before_ns = 2 * (back.t_ns - out.t_ns)
        is_told = joint is not None and joint.position.index == p.index
        was_told = joint is not None and is_told and _was_told(joint, out, before_ns)
        if out.size >= least and not wraps and not was_told:
            yield out


def _span(p: Series) -> float:
    low, high = p.register.range or (0, 0)
    return (high - low) * p.scale or float(p.high.max() - p.low.min())


def _was_told(joint: JointTrack, s: Leap, before_ns: int) -> bool:
    """Tell whether a goal lies at least half the way to where the position jumps."""
    since, until = np.array([s.t_ns - s.took_ns - before_ns]), np.array([s.t_ns])
    low, high = (float(x[0]) * MILLI for x in in_force(joint.goal, since, until))
    half = (s.before + s.after) / 2
    return high >= half if s.after > s.before else low <= half


def _comes_back(s: Leap, follows: Leap | None, soon_ns: int = NEVER_NS) -> bool:
    """Tell whether the next value is where the one before the step was, and comes soon."""
    if follows is None or follows.before != s.after or follows.t_ns - follows.took_ns != s.t_ns:
        return False
    if follows.took_ns > soon_ns:
        return False
    return abs(follows.after - s.before) <= BACK * s.size


def _way_back(case: Case, p: Series, steps: Sequence[Leap], k: int) -> Leap | None:
    """Return the step by which a position is soon back from where it jumped to, be it moving meanwhile.

    Both ways are faster than its motor can be: no goal explains that, and it does not bounce either.
    """
    s = steps[k]
    if p.unit not in SPEED or not case.has_clock or not _outruns(case, p, s):
        return None
    for back in steps[k + 1 :]:
        if back.t_ns - back.took_ns - s.t_ns > SOON_NS:
            return None
        if (
            abs(back.before - s.after) <= BACK * s.size
            and abs(back.after - s.before) <= BACK * s.size
        ):
            return back if _outruns(case, p, back) else None
    return None


def _outruns(case: Case, p: Series, s: Leap) -> bool:
    """Tell whether a step is faster than a motor, however late the stamps are."""
    return s.size / MILLI * NS > SPEED[p.unit] * (s.took_ns + case.latency_ns)


def _returns(steps: Sequence[Leap], k: int) -> bool:
    """Tell whether a step is the way back of the one before."""
    return k > 0 and _comes_back(steps[k - 1], steps[k])


def _is_too_fast(case: Case, p: Series, s: Leap) -> bool:
    """Tell whether a step is faster than any joint, however late the stamps are."""
    if not case.has_clock or p.unit not in SPEED or s.took_ns <= 0:
        return False
    seconds = (s.took_ns + case.latency_ns) / NS
    return s.size / MILLI > OVER * SPEED[p.unit] * seconds


def _jumped(case: Case, servo: int, p: Series, jumps: Sequence[Leap]) -> Finding:
    first = jumps[0]
    # damage that passes for a value comes with damage that does not
    guarded = case.has_checksum or (len(jumps) > 1 and not case.count(*TORN))
    to = f"{p.told(first.before / MILLI)} to {p.told(first.after / MILLI)}"
    took = f" within {first.took_ns / 1e6:.0f} ms" if case.has_clock else ""
    often = "" if len(jumps) == 1 else f", {len(jumps)} times"
    return Finding(
        "position-jumps" if guarded else "doubtful-value",
        servo,
        first.t_ns,
        jumps[-1].t_ns,
        len(jumps),
        f"the position of servo {servo} jumps from {to}{took}{often}",
        tuple(Place(s.at, 1, s.t_ns, f"position {p.told(s.after / MILLI)}") for s in jumps[:3]),
        strength=min(0.8 + 0.1 * len(jumps), 1.0) * (1.0 if case.has_checksum else LESS),
        brief=f"position of servo {servo} jumps from {to}",
        episodes=tuple((s.t_ns - s.took_ns, s.t_ns) for s in jumps),
        values=((JUMP, first.size / MILLI),),
    )


def temperatures(case: Case) -> Iterator[Finding]:
    """Temperatures that jump and come back: no motor does that."""
    for servo in case.measured_by("temperature"):
        t = case.series(servo, "temperature")
        if t is None:
            continue
        steps = case.ledger.steps.of(servo, t.index)
        jumps = [
            s
            for s, follows in itertools.pairwise(steps)
            if s.size / MILLI >= WARMER_DEGC and _comes_back(s, follows)
        ]
        if not jumps:
            continue
        first = jumps[0]
        to = f"{t.told(first.before / MILLI)} to {t.told(first.after / MILLI)}"
        yield Finding(
            "doubtful-value",
            servo,
            first.t_ns,
            jumps[-1].t_ns,
            len(jumps),
            f"the temperature of servo {servo} jumps from {to} and back",
            tuple(Place(s.at, 1, s.t_ns, f"temperature {t.told(s.after / MILLI)}") for s in jumps),
            strength=0.8,
        )


RULES: Final[tuple[Rule, ...]] = (positions, temperatures)
"""The rules of this file."""
