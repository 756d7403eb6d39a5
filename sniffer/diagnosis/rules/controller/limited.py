"""Joints that stand since a limit of their motor was set to nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.told import told_to
from sniffer.diagnosis.evidence.tracks import track
from sniffer.diagnosis.model import Finding, Place
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.evidence.tracks import Away
    from sniffer.diagnosis.ledger.events import Happenings
    from sniffer.diagnosis.rules import Rule

RAISE_IT: Final = "Its motor is on and may do nothing: write the limit back to what it was, and look at what wrote it."

FINDINGS: Final = (
    FindingCode(
        "motor-limited-to-nothing",
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


def limited(case: Case) -> Iterator[Finding]:
    """Find joints that do not follow since a limit of their motor is 0."""
    for servo in case.servos:
        joint = track(case, servo)
        stands = ((away, _nothing(case, servo, away)) for away in (joint.away if joint else ()))
        away, told = next(((away, told) for away, told in stands if len(told)), (None, None))
        if away is None or told is None:
            continue
        t, at, length, what = (int(x[-1]) for x in (told.t_ns, told.at, told.length, told.what))
        name = case.protocol.registers[what].name
        yield Finding(
            "motor-limited-to-nothing",
            servo,
            t,
            away.last_ns,
            1,
            f"servo {servo} was told {name} 0 at {case.since(t)}, and follows no goal since",
            (Place(at, length, t, f"{name} is set to 0"),),
            brief=f"servo {servo} is told {name} 0",
        )


def _nothing(case: Case, servo: int, away: Away) -> Happenings:
    """Return the writes of 0 that a joint stands since, those that were undone left out."""
    told = told_to(case, servo, *LIMITS)
    told = told.take(told.t_ns <= away.last_ns)
    last = told.take(
        np.array([told.what[k] not in told.what[k + 1 :] for k in range(len(told))], bool)
    )
    is_nothing = (last.after == 0) & (last.written == 1)
    return last.take(is_nothing & (last.t_ns >= away.first_ns - BEFORE_NS))


RULES: Final[tuple[Rule, ...]] = (limited,)
"""The rules of this file."""
