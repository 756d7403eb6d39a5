"""What servos say against it: alarms with what was commanded before."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.anomalies.catalogue import CATALOGUE
from sniffer.diagnosis.case import episodes
from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import may_be_torn
from sniffer.diagnosis.evidence.tracks import in_force, track
from sniffer.diagnosis.model import Finding
from sniffer.ground.distinct import numbers, within
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule

REASON: Final = "safe_mode_cause"
"""The register of LSS in which a servo states why it protects itself (Q1)."""

_REASONS: Final[Mapping[str, tuple[str, str]]] = MappingProxyType(
    {
        "current": ("saved-for-current", "its current"),
        "input_voltage": ("saved-for-voltage", "its supply"),
        "temperature": ("saved-for-heat", "its temperature"),
    }
)
"""By what is stated the finding, and what is meant."""

FINDINGS: Final = (
    FindingCode(
        "complaints-together",
        "Several servos complain of the same within moments.",
        "Two servos and more, a half of those that answer, report one alarm within a second of each other.",
        is_manner=True,
    ),
    *(
        FindingCode(
            code,
            f"A servo states that it protects itself for {what}.",
            f"Its register `{REASON}` is read as `{word}`.",
        )
        for word, (code, what) in _REASONS.items()
    ),
    FindingCode(
        "overload-passes",
        "A servo takes its overload back at once, and moves on: it works hard where its goals go fast.",
        "Every overload alarm is over within half a second (without times an eighth, counted from the bytes), and around each (without times, during each) the joint moves by twice what counts as far from a goal; nor is it away from its goals later on.",
    ),
)

COMPLAINTS: Final = frozenset(
    code for code in CATALOGUE if code.startswith("device-") and code != "device-recovered"
)
"""Alarms by which a servo says itself what is wrong."""

_BRIEF: Final[Mapping[str, str]] = MappingProxyType(
    {
        "device-input-voltage": "servo {} complains of its supply",
        "device-overload": "servo {} reports an overload",
        "device-overheating": "servo {} reports overheating",
        "device-temperature-alarm": "servo {} warns of its temperature",
        "device-temperature-limit": "servo {} reaches its temperature limit",
        "device-stuck": "servo {} says that it is stuck",
        "device-blocked": "servo {} says that it is blocked",
        "device-safe-mode": "servo {} goes into safe mode",
        "device-stroke-limit": "servo {} reports a goal beyond its limits",
        "device-outside-limits": "servo {} is outside its limits",
    }
)

RECENT_NS: Final = 10 * NS
"""A goal stated longer before an alarm has nothing to do with it."""

SHARED: Final = ("device-safe-mode", "device-input-voltage", "device-overload")
"""Alarms that a supply which sags raises in all servos that hang on it."""

PASSES_NS: Final = NS // 2
"""A motor that starts hard, or hastens behind its goals, is over it in so long; who bears too much is not."""

PAUSES: Final = 4
"""Pauses are not in bare bytes: a line that speaks for a quarter of the time is as long so many times."""

TORN: Final = 40
BY_CHANCE: Final = 0.2
"""Torn places among which one may hold by chance (a sum of eight bits lets one in 256 pass, and each is
framed from several bytes on), and how much an alarm counts there that is said once and taken back."""

SUMS: Final = 256
"""Of so many torn frames one holds at least, whatever it is."""

MOMENT_NS: Final = NS
"""Servos are asked one after the other."""


def complaints(case: Case) -> Iterator[Finding]:
    """Alarms, by code and servo, with their times and what was commanded before the first."""
    alarms = case.alarms
    told = {n: case.code(n) for n in numbers(alarms["code"]).tolist()}
    for number, code in ((n, code) for n, code in told.items() if code in COMPLAINTS):
        mine = alarms["code"] == number
        for servo in numbers(alarms["servo_id"][mine]).tolist():
            rows = np.flatnonzero(mine & (alarms["servo_id"] == servo))
            count = int(alarms["n"][rows].sum())
            spans = episodes(alarms["t_first"][rows], alarms["t_last"][rows])
            first, last = spans[0][0], spans[-1][1]
            words = code.removeprefix("device-").replace("-", " ")
            when = f"at {case.since(first)}"
            if count > 1:
                when = f"{count} times, first {when}, last at {case.since(last)}"
            before = "" if servo < 0 else _commanded(case, servo, first)
            yield Finding(
                code,
                None if servo < 0 else servo,
                first,
                last,
                count,
                f"servo {servo} reports {words} {when}{before}",
                case.places(case.anomalies(code, servo_id=servo), f"servo {servo}: {words}", 2),
                strength=_sure(case, code, servo, count),
                brief=_BRIEF.get(code, f"servo {{}} reports {words}").format(servo),
                episodes=spans,
            )


def _sure(case: Case, code: str, servo: int, count: int) -> float:
    """Return how sure it is that a servo said so.

    Of frames that are torn some hold by chance, and say anything: as seldom, and not in the next answer,
    or in the name of who never answers, or, where two senders tear them alike, time and again, and
    seldom as an answer that is due. A request that lost the first bit of its command in an overlay
    (F2 as 72) is one that nobody asked for, with four alarms. Of hundreds of torn ones some surely hold.
    """
    torn = int(case.damage["n"].sum())
    is_torn = torn >= TORN
    if count <= torn // SUMS:
        return BY_CHANCE
    said = case.anomalies(code, servo_id=servo).t_ns
    back = np.sort(case.anomalies("device-recovered", servo_id=servo).t_ns)
    behind = np.searchsorted(back, said)
    is_over = behind < len(back)
    is_over[is_over] = back[behind[is_over]] <= said[is_over] + MOMENT_NS
    if is_torn and is_over.all() and (count == 1 or may_be_torn(case, count)):
        return BY_CHANCE
    stray = case.anomalies("mismatched-response", "unsolicited-response").t_ns
    if count == 1:
        is_nobody = is_torn and bool(case.answering) and servo not in case.answering
        is_unasked = may_be_torn(case, count) and bool(within(said, stray).all())
        return BY_CHANCE if is_nobody or is_unasked else 0.8
    is_torn &= bool(within(case.anomalies(code).t_ns, stray).mean() > 0.5)
    return BY_CHANCE if is_torn else 1.0


def _commanded(case: Case, servo: int, t_ns: int) -> str:
    """Say what the goal was before a moment."""
    goal = case.series(servo, "goal_position")
    if goal is None:
        return ""
    row = int(np.searchsorted(goal.t_first, t_ns, "right")) - 1
    if row < 0 or t_ns - int(goal.t[row]) > RECENT_NS:
        return ""
    stated = max(t_ns - int(goal.t[row]), 0) / 1e6
    near = f", stated {stated:.0f} ms before" if int(goal.t[row]) < t_ns else ""
    return f"; its goal was {goal.told(float(goal.last[row]))}{near}"


def overload_passes(case: Case) -> Iterator[Finding]:
    """Overloads that servos take back at once while they move on."""
    passes_ns = PASSES_NS if case.has_clock else PASSES_NS // PAUSES
    around_ns = NS if case.has_clock else 0
    for servo in case.servos:
        told = case.anomalies("device-overload", servo_id=servo)
        back = case.anomalies("device-recovered", servo_id=servo).t_ns
        joint = track(case, servo)
        if not len(told) or joint is None or any(a.last_ns > told.t_ns[0] for a in joint.away):
            continue
        row = np.searchsorted(back, told.t_ns, "right")
        if (row >= len(back)).any() or (back[row] - told.t_ns > passes_ns).any():
            continue
        low, high = in_force(joint.position, told.t_ns - around_ns, back[row] + around_ns)
        if (high - low < 2 * joint.far).any():
            continue
        longest = max(float((back[row] - told.t_ns).max()) / 1e6, 1)
        yield Finding(
            "overload-passes",
            servo,
            int(told.t_ns[0]),
            int(back[row[-1]]),
            len(told),
            f"servo {servo} takes its overload back within {longest:.0f} ms, and moves by "
            f"{joint.position.told(float((high - low).min()))} meanwhile",
            case.places(told, f"servo {servo}: overload", 2),
            brief=f"servo {servo} moves on",
        )


def together(case: Case) -> Iterator[Finding]:
    """Servos that complain of the same at the same time."""
    for code in SHARED:
        firsts = {s: case.anomalies(code, servo_id=s).t_ns for s in case.servos}
        first = {s: int(t.min()) for s, t in firsts.items() if len(t)}
        many = len({*case.answering, *first})
        for servo, t in first.items():
            near = sum(abs(other - t) <= MOMENT_NS for other in first.values())
            if near < 2 or 2 * near < many:
                continue
            yield Finding(
                "complaints-together",
                servo,
                t,
                t,
                near,
                f"servo {servo} reports {code.removeprefix('device-')} within a second of others: {near} of "
                f"{many} servos do",
                strength=min(near / many, 1.0),
                brief=f"{near} servos complain at once",
            )


def reasons(case: Case) -> Iterator[Finding]:
    """What servos state as the reason for which they protect themselves."""
    names = case.protocol.registers
    for servo in case.servos:
        told = case.settings(REASON, servo_id=servo)
        words = [names[w].values.get(a, "") for w, a in zip(told.what, told.after, strict=True)]
        for word, (code, what) in _REASONS.items():
            mine = told.take(np.array([each == word for each in words], bool))
            if len(mine):
                yield Finding(
                    code,
                    servo,
                    int(mine.t_ns[0]),
                    int(mine.t_ns[-1]),
                    len(mine),
                    f"servo {servo} states that it protects itself for {what}",
                    case.places(mine, f"servo {servo}: {REASON} {word}", 2),
                    brief=f"servo {servo} states {what} as the reason",
                )


RULES: Final[tuple[Rule, ...]] = (
    complaints,
    together,
    reasons,
    overload_passes,
)
"""The rules of this file."""
