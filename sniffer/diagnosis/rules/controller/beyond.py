"""Alarms that begin when the limit of what they are about is written: what is measured is as before."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.told import told_to
from sniffer.diagnosis.model import Finding, Place
from sniffer.ground.model import NS
from sniffer.ground.units import word_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.events import Happenings
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import I64

FINDINGS: Final = (
    FindingCode(
        "limit-set-beyond",
        "A servo complains since a limit was written, and of what that limit is kept.",
        "Its first alarm of the supply or of heat comes within two seconds of the write of such a limit, and none came in ten answers and more before; where the value is measured, it is what it was before, within a twentieth.",
    ),
)

ALARMS: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "voltage": ("device-input-voltage",),
        "temperature": (
            "device-overheating",
            "device-temperature-alarm",
            "device-temperature-limit",
        ),
    }
)
"""By what is measured the alarms of its limits."""

BEHIND_NS: Final = 2 * NS
"""A servo complains with its next answer; who is asked seldom has that a while later."""

SOUND: Final = 10
"""So many answers before show that it did not complain anyway."""

SAME: Final = 0.05
"""Part by which the value may differ from before: it is not it that went beyond the limit."""


def set_beyond(case: Case) -> Iterator[Finding]:
    """Find alarms that a limit brought, and not what is measured."""
    for servo in case.answering:
        for quantity, codes in ALARMS.items():
            alarms = np.sort(case.anomalies(*codes, servo_id=servo).t_ns)
            if not len(alarms):
                continue
            first_ns = int(alarms[0])
            told = _written(case, servo, quantity)
            told = told.take((told.t_ns <= first_ns) & (told.t_ns >= first_ns - BEHIND_NS))
            if len(told) and _is_new(case, servo, quantity, int(told.t_ns[-1]), first_ns):
                yield _beyond(case, servo, quantity, told, alarms)


def _written(case: Case, servo: int, quantity: str) -> Happenings:
    """Return when a servo was told another limit of what it measures."""
    registers = case.protocol.registers
    limits = [r.name for r in registers if quantity in (r.least_of, r.most_of)]
    told = told_to(case, servo, *limits) if limits else case.settings().take(slice(0, 0))
    return told.take((told.written == 1) & (told.before != told.after))


def _is_new(case: Case, servo: int, quantity: str, since_ns: int, until_ns: int) -> bool:
    """Tell whether a servo had no reason to complain before, and has no other one now."""
    answers = case.answers
    before = (answers["servo_id"] == servo) & (answers["t_last"] < since_ns)
    if int(answers["ok"][before].sum()) < SOUND:
        return False
    s = case.series(servo, quantity)
    if s is None:
        return True
    was, now = s.last[s.t <= since_ns], s.first[s.t_first >= until_ns]
    return not (len(was) and len(now)) or bool(abs(now[0] - was[-1]) <= SAME * abs(was[-1]))


def _beyond(case: Case, servo: int, quantity: str, told: Happenings, alarms: I64) -> Finding:
    t, at, length, what = (int(x[-1]) for x in (told.t_ns, told.at, told.length, told.what))
    register = case.protocol.registers[what]
    limit = f"{register.name} {int(told.after[-1]) * register.scale:.4g} {word_of(register.unit)}"
    s = case.series(servo, quantity)
    is_known = s is not None and bool((s.t_first >= t).any())
    stays = f", and its {quantity} stays as it was" if is_known else ""
    return Finding(
        "limit-set-beyond",
        servo,
        t,
        int(alarms[-1]),
        1,
        f"servo {servo} was told {limit} at {case.since(t)}, and complains since {case.since(int(alarms[0]))}"
        + stays,
        (Place(at, length, t, f"{limit} is written"),),
        brief=f"servo {servo} is told {limit}",
    )


RULES: Final[tuple[Rule, ...]] = (set_beyond,)
"""The rules of this file."""
