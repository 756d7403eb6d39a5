"""Which cause explains what was found: every cause is weighed, the best one takes its findings.

The weights are data (``weights/``), a line each with its reason. A cause's score is its prior and
what the findings count for and against it. The best one takes the findings it explains; the rest is
weighed again, until nothing is left that has a cause.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.causes import CAUSES, CONTROLLER, SERVO
from sniffer.diagnosis.model import LINE, SAID, Ranked, Reason
from sniffer.diagnosis.rules import FINDINGS
from sniffer.diagnosis.weights import WEIGHTS
from sniffer.ground.model import NEVER_NS, NS

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sniffer.diagnosis.causes import Cause
    from sniffer.diagnosis.model import Finding

SLACK_NS: Final = 5 * NS
"""How far apart a cause and what follows from it may be."""

SHARPNESS: Final = 1.0
"""By how much confidence grows with the lead.

Of 719 incidents (exact and 16 ms hosts; faults of tap, devices and controllers) those 50 to 70 %
sure were right in 76 %, 80 to 90 % in 88 %, 95 to 99 % in 95 %: Brier score 0.074. At 0.7 it is
0.081; at 1.4 it is the same, and the surest overstate.
"""

LEAST: Final = 0.0
"""A cause that scores less is none."""

SHOWN: Final = 3
"""Causes told of an incident."""

SIDE: Final = 0.3
"""What counts so little for a cause is a side effect of it, which others have as well."""

PROOF: Final = 3.0
"""From this score on, of side effects alone, another fault is as good as proven."""

ANOMALY: Final = FindingCode("", "", "")
"""What has no entry among the findings."""

TOGETHER_NS: Final = NS
"""One cause that befalls several servos within this time is one incident."""


class Weighed(NamedTuple):
    """A cause with what it scores and why."""

    cause: Cause
    servo_id: int | None
    score: float
    reasons: tuple[Reason, ...]
    explained: tuple[Finding, ...]


@dataclass(frozen=True, slots=True)
class Explained:
    """Findings that one cause explains, and all causes that were weighed for them."""

    servo_ids: tuple[int, ...]
    findings: tuple[Finding, ...]
    causes: tuple[Ranked, ...]
    key: Finding


def explain(findings: Sequence[Finding]) -> list[Explained]:
    """Return what explains all findings that have an explanation, the surest first."""
    left, out = list(findings), []
    while left:
        best = _best(left, findings)
        if best is None:
            break
        best = _without_others(best, left, findings)
        out.append(_explained(best, left, findings))
        taken = set(map(id, best.explained)) - _of_another(best, left) - _there_before(best)
        left = [f for f in left if id(f) not in taken]
    return _joined(out)


def _without_others(
    best: Weighed, left: Sequence[Finding], all_found: Sequence[Finding]
) -> Weighed:
    """Leave out what a controller's mistakes with some servos do not do to others.

    Findings of a servo that none was made with are its own where they prove a fault.
    """
    weights = WEIGHTS[best.cause.slug]
    meant = {f.servo_id for f in best.explained if weights[f.code].is_key}
    if best.cause.of != CONTROLLER or None in meant:
        return best
    beside = [f for f in best.explained if f.servo_id is not None and f.servo_id not in meant]
    away = set(map(id, best.explained)) - set(map(id, beside))
    rest = [f for f in left if id(f) not in away] if beside else []
    proven = {w.servo_id for w in weigh(rest, rest) if w.cause.of == SERVO and w.score > LEAST}
    apart = set(map(id, (f for f in beside if f.servo_id in proven)))
    if not apart:
        return best
    kept = [f for f in left if id(f) not in apart]
    return _weighed(best.cause, best.servo_id, kept, all_found) or best


def _of_another(best: Weighed, left: Sequence[Finding]) -> set[int]:
    """Return findings that a cause has as side effects, and that prove the fault of one servo.

    What befalls the line, the controller or the tap does not choose a servo: where one is hit far
    more than others, and in a way that a fault of its own has, there are two faults. A sign that
    proves such a fault by itself has all that is told of its servo with it.
    """
    weights = WEIGHTS[best.cause.slug]
    sides = {id(f) for f in best.explained if weights[f.code].weight <= SIDE}
    if not sides or best.cause.of == SERVO:
        return set()
    proven = {f.servo_id for f in best.explained if id(f) in sides and _proves_its_own(f)}
    sides |= {id(f) for f in best.explained if f.servo_id is not None and f.servo_id in proven}
    rest = [f for f in left if id(f) in sides or all(f is not other for other in best.explained)]
    out: set[int] = set()
    for w in weigh(rest, rest):
        mine = [f for f in w.explained if id(f) in sides and f.servo_id == w.servo_id]
        signs = {f.code for f in mine if WEIGHTS[w.cause.slug][f.code].is_key}
        its_own = any(_declared(code).is_its_own for code in signs)
        is_shown = its_own and (len(signs) > 1 or w.servo_id in proven)
        if w.cause.of == SERVO and w.score >= PROOF and is_shown:
            out |= set(map(id, mine))
    return out


def _proves_its_own(f: Finding) -> bool:
    """Tell whether a finding is as good as proof that its servo has a fault of its own."""
    tables = (WEIGHTS[c.slug] for c in CAUSES.values() if c.of == SERVO)
    most = max((t[f.code].weight for t in tables if f.code in t), default=0.0)
    return _declared(f.code).is_its_own and most * f.strength >= PROOF


def _there_before(best: Weighed) -> set[int]:
    """Return findings of servos that were there before all else that a cause explains.

    What befalls the line, the controller or the tap has its side effects when it is there.
    """
    weights = WEIGHTS[best.cause.slug]
    if best.cause.of == SERVO:
        return set()
    out: set[int] = set()
    for f in best.explained:
        others = [g.first_ns for g in best.explained if g.servo_id != f.servo_id]
        is_side = f.servo_id is not None and f.code in FINDINGS and weights[f.code].weight <= SIDE
        if is_side and others and f.first_ns < min(others) - SLACK_NS:
            out.add(id(f))
    return out


def _best(left: Sequence[Finding], all_found: Sequence[Finding]) -> Weighed | None:
    """Return the cause that scores highest on what is left."""
    weighed = [w for w in weigh(left, all_found) if w.score > LEAST and _is_of_something(w)]
    return max(weighed, key=lambda w: (w.score, -_order(w.cause)), default=None)


def _is_of_something(w: Weighed) -> bool:
    """Tell whether what a cause explains is more than the manner in which something came.

    Where it is known by that alone, other findings must tell of what came so, of the same servo;
    those that a cause has beside the point tell of nothing.
    """
    weights = WEIGHTS[w.cause.slug]
    manners = [f for f in w.explained if _declared(f.code).is_manner]
    others = [f for f in w.explained if not _declared(f.code).is_manner]
    if any(weights[f.code].is_key for f in others):
        return True
    tell = [f for f in others if f.code not in FINDINGS or weights[f.code].weight > SIDE]
    return any(
        other.servo_id is None or one.servo_id in (None, other.servo_id)
        for other in tell
        for one in manners
    )


def weigh(left: Sequence[Finding], all_found: Sequence[Finding]) -> list[Weighed]:
    """Weigh every cause on findings; what speaks against one counts though it is explained."""
    servos = sorted({f.servo_id for f in left if f.servo_id is not None})
    out = []
    for cause in CAUSES.values():
        whose: Iterable[int | None] = servos if cause.of == SERVO else (None,)
        for servo in whose:
            found = _weighed(cause, servo, left, all_found)
            if found is not None:
                out.append(found)
    return out


def _weighed(
    cause: Cause, servo: int | None, left: Sequence[Finding], all_found: Sequence[Finding]
) -> Weighed | None:
    """Weigh one cause, of one servo where it is a servo's."""
    weights = WEIGHTS[cause.slug]
    mine = [f for f in left if f.code in weights and _concerns(f, servo)]
    mine = [f for f in mine if not f.is_own or cause.of == SERVO]
    speaks = [f for f in mine if weights[f.code].weight > 0]
    keys = [f for f in speaks if weights[f.code].is_key]
    if not keys:
        return None
    first = min(f.first_ns for f in keys) - SLACK_NS
    last = max(f.last_ns for f in keys) + SLACK_NS
    speaks = [f for f in speaks if f.first_ns <= _until(f, last) and f.last_ns >= first]
    against = [
        f
        for f in all_found
        if f.code in weights and weights[f.code].weight < 0 and _concerns(f, servo)
        if f.first_ns <= last and f.last_ns >= first
    ]
    best: dict[str, tuple[float, Finding]] = {}
    for f in (*speaks, *against):  # one that several servos have counts once
        value = weights[f.code].weight * f.strength
        if f.code not in best or abs(value) > abs(best[f.code][0]):
            best[f.code] = value, f
    reasons = tuple(
        Reason(cause.slug, code, value, f"{weights[code].reason}: {f.what}", weights[code].reason)
        for code, (value, f) in sorted(best.items(), key=lambda e: -abs(e[1][0]))
    )
    score = cause.prior + sum(value for value, _ in best.values())
    return Weighed(cause, servo, score, reasons, tuple(speaks))


def _until(f: Finding, last_ns: int) -> int:
    """Return until when a finding may begin that follows from what was over by then."""
    return NEVER_NS if _declared(f.code).is_lasting else last_ns


def _concerns(f: Finding, servo: int | None) -> bool:
    return servo is None or f.servo_id is None or f.servo_id == servo


def _explained(best: Weighed, left: Sequence[Finding], all_found: Sequence[Finding]) -> Explained:
    """Rank the causes of what the best one explains.

    A cause that does not explain what tells most of it is no rival by what it explains besides:
    noise that tears frames of all servos makes no voltage of one of them low.
    """
    weights = WEIGHTS[best.cause.slug]
    key = max(best.explained, key=lambda f: (weights[f.code].weight * f.strength, f.count))
    rivals = [best]
    for w in weigh(left, all_found):
        shares = any(f in best.explained for f in w.explained)
        same = w.servo_id in (None, best.servo_id) or best.servo_id is None
        if shares and same and w.cause.slug != best.cause.slug and _is_of_something(w):
            if all(f is not key for f in w.explained):
                w = _on(w, best.explained)
            known = next((r for r in rivals if r.cause.slug == w.cause.slug), None)
            if known is None:
                rivals.append(w)
            elif known.score < w.score:
                rivals[rivals.index(known)] = w
    rivals.sort(key=lambda w: -w.score)
    odds = [math.exp(min(w.score * SHARPNESS, 50.0)) for w in rivals]
    # 1: none of them; what may be another servo's is that one's as likely
    total = sum(odds) + odds[rivals.index(best)] * len(key.may_be) + 1.0
    ranked = tuple(
        Ranked(
            w.cause.slug,
            odd / total,
            _why(w),
            w.reasons,
        )
        for w, odd in zip(rivals[:SHOWN], odds, strict=False)
    )
    return Explained(_whose(best), best.explained, ranked, key)


def _on(w: Weighed, findings: Sequence[Finding]) -> Weighed:
    """Weigh a cause on some of the findings that it explains, and on all that speaks against it."""
    mine = tuple(f for f in w.explained if any(f is one for one in findings))
    codes = {f.code for f in mine}
    reasons = tuple(r for r in w.reasons if r.weight < 0 or r.finding in codes)
    score = w.cause.prior + sum(r.weight for r in reasons)
    return Weighed(w.cause, w.servo_id, score, reasons, mine)


def _whose(best: Weighed) -> tuple[int, ...]:
    """Return the servos that a cause is about: what it does to others is not about them."""
    if best.servo_id is not None:
        return (best.servo_id,)
    if best.cause.of != CONTROLLER:
        return ()
    weights = WEIGHTS[best.cause.slug]
    keys = {f.servo_id for f in best.explained if weights[f.code].is_key}
    return tuple(sorted(servo for servo in keys if servo is not None))


def _why(w: Weighed) -> str:
    """Return what speaks for a cause, in words."""
    told = [r.reason for r in w.reasons if r.weight > 0][:SAID]
    return "; ".join(told)


def _joined(found: list[Explained]) -> list[Explained]:
    """Join what one cause did to several servos: a supply that feeds them all is one."""
    out: list[Explained] = []
    for one in found:
        cause = one.causes[0].cause
        twin = next(
            (
                k
                for k, other in enumerate(out)
                if other.causes[0].cause == cause
                and CAUSES[cause].of == SERVO
                and (_began_together(one, other) or (_omits(one) and _omits(other)))
            ),
            None,
        )
        if twin is None:
            out.append(one)
            continue
        other = out[twin]
        shared = {id(f) for f in other.findings}
        findings = (*other.findings, *(f for f in one.findings if id(f) not in shared))
        servo_ids = tuple(sorted({*other.servo_ids, *one.servo_ids}))
        out[twin] = Explained(servo_ids, findings, other.causes, other.key)
    return _followed(out)


def _followed(found: list[Explained]) -> list[Explained]:
    """Give what befell one servo by what another one's incident says to that one."""
    out = list(found)
    for one in found:
        other = next((e for e in out if e is not one and _follows(one, e)), None)
        if other is not None:
            more = tuple(f for f in one.findings if all(f is not g for g in other.findings))
            both = replace(other, findings=(*other.findings, *more))
            out = [both if e is other else e for e in out if e is not one]
    return out


def _follows(one: Explained, other: Explained) -> bool:
    """Tell whether all that is found in one incident befell its servos by another one's cause.

    Or the line, where it is nobody's.
    """
    weights = WEIGHTS[other.causes[0].cause]
    whom = set(one.servo_ids or (LINE,))
    return any(
        whom <= set(f.befell) and all(f.first_ns <= g.first_ns for g in one.findings)
        for f in other.findings
        if f.code in weights and weights[f.code].is_key
    )


def _began_together(one: Explained, other: Explained) -> bool:
    """Tell whether all began at once, or what is found alike: they fell silent in one moment.

    A battery that empties is low for one servo before it is for the next.
    """
    first, second = (min(f.first_ns for f in e.findings) for e in (one, other))
    return abs(first - second) <= TOGETHER_NS or any(
        abs(f.first_ns - g.first_ns) <= TOGETHER_NS
        or (
            _declared(f.code).is_of_supply
            and max(f.first_ns, g.first_ns) <= min(f.last_ns, g.last_ns) + SLACK_NS
        )
        for f in one.findings
        for g in other.findings
        if f.code == g.code and f.code in FINDINGS
    )


def _omits(one: Explained) -> bool:
    """Tell whether a program left something out, by a finding that is declared to say so."""
    return any(_declared(f.code).is_omission for f in one.findings)


def _declared(code: str) -> FindingCode:
    """Return what is declared of a finding's code; of an anomaly nothing is."""
    return FINDINGS.get(code, ANOMALY)


def _order(cause: Cause) -> int:
    """Return where a cause stands: of two that score alike, the tap's is weighed first."""
    return {"tap": 0, "line": 1, "servo": 2}.get(cause.of, 3)
