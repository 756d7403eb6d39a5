"""Steps of measured positions that mechanics forbid, and whether they come back."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.evidence.chances import at_least
from sniffer.diagnosis.evidence.tracks import FAR, in_force, track
from sniffer.diagnosis.evidence.trips import trips
from sniffer.diagnosis.ledger.returns import TURN
from sniffer.diagnosis.ledger.steps import SPEED
from sniffer.ground.medians import quantile
from sniffer.ground.milli import MILLI
from sniffer.ground.model import NEVER_NS, NS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from sniffer.diagnosis.case import Case, Series
    from sniffer.diagnosis.evidence.tracks import JointTrack
    from sniffer.diagnosis.ledger.steps import Leap

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

BY_CHANCE: Final = 1e-3
"""How likely jumps may be as far as bits are worth by chance, for bits to be what jumped."""

BACK: Final = 0.25
"""A value is back if no more than this part of the jump is left."""


def jumping(case: Case) -> Mapping[int, tuple[Series, Sequence[Leap]]]:
    """Return of each servo whose position jumps that register and its jumps."""
    return case.once(_jumping)


def _jumping(case: Case) -> Mapping[int, tuple[Series, Sequence[Leap]]]:
    out: dict[int, tuple[Series, Sequence[Leap]]] = {}
    for servo in case.servos:
        for p in case.every(servo, "position"):
            jumps = _jumps(case, servo, p, case.ledger.steps.of(servo, p.index))
            if not case.has_clock:
                jumps = sorted({*jumps, *_trips(case, servo, p)}, key=lambda s: s.at)
            if jumps:
                out[servo] = p, jumps
                break
    return out


def altered(case: Case) -> Mapping[int, Sequence[Leap]]:
    """Return of each servo the jumps that altered bits of answers without a checksum make.

    A servo's sensor jumps to anywhere; each bit of a number is worth twice the one before.
    """
    return {} if case.has_checksum else case.once(_altered)


def _altered(case: Case) -> Mapping[int, Sequence[Leap]]:
    out: dict[int, Sequence[Leap]] = {}
    for servo, (p, jumps) in jumping(case).items():
        usual, span, least = float(quantile(p.step, USUAL)), _span(p), _least(p)
        # numbers are whole, and the way between two others bends
        near = (p.scale + usual) / 2
        bits = [b for k in range(16) if (b := p.scale * (1 << k)) <= span]
        steps = case.ledger.steps.of(servo, p.index)
        by_a_bit = [s for s in jumps if any(abs(_beside(s, steps) - b) <= near for b in bits)]
        likely = sum(b >= least for b in bits) * 2 * near / (span - least)
        if at_least(len(by_a_bit), len(jumps), min(likely, 1.0)) < BY_CHANCE:
            out[servo] = by_a_bit
    return out


def _beside(s: Leap, steps: Sequence[Leap]) -> float:
    """Return how far a value is from the middle of those before and behind it, in its unit."""
    back = next((b.after for b in steps if b.t_ns - b.took_ns == s.t_ns), s.before)
    return abs(s.after - (s.before + back) / 2) / MILLI


def altered_bare(case: Case) -> int:
    """Return of how many servos bare answers are altered, as their values show; one proves nothing.

    Such an answer holds whatever was altered in it: that none looks torn says nothing of answers.
    """
    many = 0 if case.has_checksum else len(jumping(case))
    return many if many > 1 else 0


def _jumps(case: Case, servo: int, p: Series, steps: Sequence[Leap]) -> list[Leap]:
    """Return the steps that no joint does."""
    if len(p) < 8:
        return []
    span, least = _span(p), _least(p)
    joint = track(case, servo)
    out: list[Leap] = []
    ways_back: set[int] = set()
    for k, s in enumerate(steps):
        size = s.size / MILLI
        wraps = p.register.range is not None and size > TURN * span
        if size < least or wraps or s.at in ways_back:
            continue
        follows = steps[k + 1] if k + 1 < len(steps) else None
        back = _way_back(case, p, steps, k)
        if back is not None:
            ways_back.add(back.at)
            out.append(s)  # whatever it was told
            continue
        # goals are told in the numbers of one register; another one may count otherwise
        is_told = joint is not None and joint.position.index == p.index
        soon = LATER_NS if is_told else SOON_NS
        is_back = comes_back(s, follows, soon) and s.took_ns <= soon
        # who is there and back within moments was not told so a second ago
        before_ns = SOON_NS if is_back and s.took_ns <= SOON_NS else NS
        if joint is not None and is_told and _was_told(joint, s, before_ns):
            continue
        if is_back or (_is_too_fast(case, p, s) and not _returns(steps, k)):
            out.append(s)
    return out


def _trips(case: Case, servo: int, p: Series) -> Iterator[Leap]:
    """Yield the steps to where a position is for a few values, and no goal: told by their order."""
    joint = track(case, servo)
    least = max(LEAST_SHARE * _span(p), FAR.get(p.unit, 0.0)) * MILLI
    for out, back in trips(case, servo, p)[0]:
        wraps = p.register.range is not None and out.size / MILLI > TURN * _span(p)
        before_ns = 2 * (back.t_ns - out.t_ns)
        is_told = joint is not None and joint.position.index == p.index
        was_told = joint is not None and is_told and _was_told(joint, out, before_ns)
        if out.size >= least and not wraps and not was_told:
            yield out


def _least(p: Series) -> float:
    """Return how far no joint goes between two values, by how far it usually does."""
    usual = float(quantile(p.step, USUAL))
    return max(AHEAD * usual, LEAST_SHARE * _span(p), FAR.get(p.unit, 0.0))


def _span(p: Series) -> float:
    low, high = p.register.range or (0, 0)
    return (high - low) * p.scale or float(p.high.max() - p.low.min())


def _was_told(joint: JointTrack, s: Leap, before_ns: int) -> bool:
    """Tell whether a goal lies at least half the way to where the position jumps."""
    since, until = np.array([s.t_ns - s.took_ns - before_ns]), np.array([s.t_ns])
    low, high = (float(x[0]) * MILLI for x in in_force(joint.goal, since, until))
    half = (s.before + s.after) / 2
    return high >= half if s.after > s.before else low <= half


def comes_back(s: Leap, follows: Leap | None, soon_ns: int = NEVER_NS) -> bool:
    """Tell whether the next value is where the one before the step was, and comes soon."""
    if follows is None or follows.before != s.after or follows.t_ns - follows.took_ns != s.t_ns:
        return False
    if follows.took_ns > soon_ns:
        return False
    return abs(follows.after - s.before) <= BACK * s.size


def _way_back(case: Case, p: Series, steps: Sequence[Leap], k: int) -> Leap | None:
    """Return the step by which a position is soon back from where it jumped to.

    It may move meanwhile. Both ways are faster than its motor can be: no goal explains that, and it
    does not bounce either.
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
    return k > 0 and comes_back(steps[k - 1], steps[k])


def _is_too_fast(case: Case, p: Series, s: Leap) -> bool:
    """Tell whether a step is faster than any joint, however late the stamps are."""
    if not case.has_clock or p.unit not in SPEED or s.took_ns <= 0:
        return False
    seconds = (s.took_ns + case.latency_ns) / NS
    return s.size / MILLI > OVER * SPEED[p.unit] * seconds
