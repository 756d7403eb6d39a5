"""What servos say against it: alarms with what was commanded before, refusals, words unasked."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.case import episodes, sums
from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.model import Finding, Place
from sniffer.diagnostics.catalogue import CATALOGUE
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "refuses-command",
        "device",
        "A servo refuses one and the same command, time and again.",
        "At least three answers with a refusal (not of a checksum) to one command for one address.",
    ),
    FindingCode(
        "speaks-unasked",
        "device",
        "One device sends answers that nobody asked for.",
        "At least five whole answers without a request, nearly all of one servo, which answers what it is asked as well; requests are not damaged.",
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

LEAST: Final = 3
"""Refusals of one command that are no accident."""

PLENTY: Final = 10

UNASKED: Final = 5
"""Answers without a request: fewer come from requests that the tap lost."""


def complaints(case: Case) -> Iterator[Finding]:
    """Alarms, by code and servo, with their times and what was commanded before the first."""
    alarms = case.alarms
    numbers = [n for n in np.unique(alarms["code"]).tolist() if case.code(n) in COMPLAINTS]
    for number in numbers:
        code = case.code(number)
        mine = alarms["code"] == number
        for servo in np.unique(alarms["servo_id"][mine]).tolist():
            rows = np.flatnonzero(mine & (alarms["servo_id"] == servo))
            count = int(alarms["n"][rows].sum())
            spans = episodes(alarms["t_first"][rows], alarms["t_last"][rows])
            first, last = spans[0][0], spans[-1][1]
            words = code.removeprefix("device-").replace("-", " ")
            when = f"at {case.since(first)}"
            if count > 1:
                when = f"{count} times, first {when}, last at {case.since(last)}"
            who = None if servo < 0 else servo
            before = "" if who is None else _commanded(case, who, first)
            yield Finding(
                code,
                who,
                first,
                last,
                count,
                f"servo {servo} reports {words} {when}{before}",
                case.places(case.anomalies(code, servo_id=servo), f"servo {servo}: {words}", 2),
                strength=0.8 if count == 1 else 1.0,
                brief=_BRIEF.get(code, f"servo {{}} reports {words}").format(servo),
                episodes=spans,
            )


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


def refusals(case: Case) -> Iterator[Finding]:
    """Commands that a servo refuses again and again."""
    r = case.ledger.refusals.counted()
    for row in np.flatnonzero(r["n"] >= LEAST).tolist():
        servo, n, status = (int(r[name][row]) for name in ("servo_id", "n", "status"))
        names = case.protocol.status_names(status) if status > 0 else ()
        if "checksum" in names:  # what it got was not what was sent: that is the line's
            continue
        command = case.protocol.op_name(int(r["op"][row]))
        address = int(r["address"][row])
        to = "" if address < 0 else f" to address {address:#04x}"
        named = next((x.name for x in case.protocol.registers if 0 <= x.address == address), "")
        says = f" with {' and '.join(names).replace('_', ' ')}" if names else " with other values"
        what = (
            f"servo {servo} answers {command}{to}{f' ({named})' if named else ''}{says}, {n} times"
        )
        yield Finding(
            "refuses-command",
            servo,
            int(r["t_first"][row]),
            int(r["t_last"][row]),
            n,
            what,
            (Place(int(r["at"][row]), int(r["length"][row]), int(r["t_first"][row]), what),),
            strength=min(0.7 + n / PLENTY * 0.3, 1.0),
            brief=f"servo {servo} refuses {command}{f' of {named}' if named else ''}",
        )


def chatty(case: Case) -> Iterator[Finding]:
    """A device that speaks without being asked."""
    unasked = sums(case.answers, "servo_id", "unsolicited")
    torn = int(case.damage["n"].sum())
    for servo, n in unasked.items():
        others = sum(unasked.values()) - n
        missing = case.total("missing", servo) + case.total("damaged", servo)
        if n < UNASKED or others > n / 5 or missing > n / 2 or torn > n / 2:
            continue
        if servo < 0 or not case.total("ok", servo):
            continue
        told = case.anomalies("unsolicited-response", "duplicate-response", servo_id=servo)
        if not len(told):
            continue
        yield Finding(
            "speaks-unasked",
            servo,
            int(told.t_ns.min()),
            int(told.t_ns.max()),
            n,
            f"servo {servo} sent {n} answers that nobody asked for, all others {others}",
            case.places(told, "an answer without a request"),
            strength=min(0.6 + n / 25, 1.0),
            brief=f"servo {servo} speaks unasked",
        )


RULES: Final[tuple[Rule, ...]] = (complaints, refusals, chatty)
"""The rules of this file."""
