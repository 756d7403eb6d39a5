"""Joints that stand since a limit of their motor was set to nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.model import Finding, Place
from sniffer.diagnosis.tracks import track
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule
    from sniffer.diagnosis.tracks import Away

RAISE_IT: Final = "Its motor is on and may do nothing: write the limit back to what it was, and look at what wrote it."

FINDINGS: Final = (
    FindingCode(
        "motor-limited-to-nothing",
        "controller",
        "A limit of a motor's force or speed was set to 0, and its joint stands since.",
        "A write of 0 to such a register (of this servo or to all), the last that it was told, at most two seconds before a stretch in which the joint does not follow, or within it.",
        remedy=RAISE_IT,
        settle=RAISE_IT,
        concerns="",
    ),
)

LIMITS: Final = frozenset(
    {"max_force", "force_limit", "torque_limit", "max_torque", "max_speed", "max_speed_in_rpm"}
)
"""Quantities and names of registers at whose 0 a motor does nothing. Sources: mightyZAP User Manual
v1.02, (3) Parameter Map 0x0E and 0x8A; RS305CR manual, No. 35 Max Torque; LSS wiki, Details 12."""

BEFORE_NS: Final = 2 * NS
"""How long before a joint is seen to stand it may have been told: its goal moves on first."""


class _ToldNothing(NamedTuple):
    """Where a register was last stated before some time, and what it was."""

    t_ns: int
    at: int
    length: int
    register: int


def limited(case: Case) -> Iterator[Finding]:
    """Find joints that do not follow since a limit of their motor is 0."""
    for servo in case.servos:
        joint = track(case, servo)
        for away in joint.away if joint is not None else ():
            told = _nothing(case, servo, away)
            if told is None:
                continue
            name = case.protocol.registers[told.register].name
            yield Finding(
                "motor-limited-to-nothing",
                servo,
                told.t_ns,
                away.last_ns,
                1,
                f"servo {servo} was told {name} 0 at {case.since(told.t_ns)}, and follows no goal since",
                (Place(told.at, told.length, told.t_ns, f"{name} is set to 0"),),
                brief=f"servo {servo} is told {name} 0",
            )
            break


def _nothing(case: Case, servo: int, away: Away) -> _ToldNothing | None:
    """Return the write of 0 that a joint stands since, if it was not undone before it stood."""
    best: _ToldNothing | None = None
    for who in (servo, *case.everyone):
        told = case.settings(*LIMITS, servo_id=who)
        for register in np.unique(told.what).tolist():
            mine = np.flatnonzero((told.what == register) & (told.t_ns <= away.last_ns))
            k = int(mine[-1]) if len(mine) else -1
            if k < 0 or told.after[k] != 0 or not told.written[k]:
                continue
            if told.t_ns[k] < away.first_ns - BEFORE_NS:
                continue
            best = _ToldNothing(int(told.t_ns[k]), int(told.at[k]), int(told.length[k]), register)
    return best


RULES: Final[tuple[Rule, ...]] = (limited,)
"""The rules of this file."""
