"""The supply as servos measure it: sags, under load or of all at once, and limits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.efforts import effort
from sniffer.diagnosis.model import Finding, Place

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case, Series
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import I64

FINDINGS: Final = (
    FindingCode(
        "voltage-sag",
        "device",
        "The supply voltage that a servo measures falls far below what it usually is, or below its limit.",
        "A voltage more than a tenth below what the servo has for most of the time, or its peers; it counts in full from a fifth on, or below the servo's own limit.",
    ),
)

SAG: Final = 0.10
"""Part of the usual voltage; wires and a sound supply under a robot's load move it by less."""

DEEP: Final = 0.20
"""... and from this part on nothing else explains it."""

SHALLOW: Final = 0.07
"""At this part it counts for nothing."""

USUALLY: Final = 0.75
"""The voltage that is reached for a quarter of the time is that without load."""

APART: Final = 0.85
"""A servo that has less than this part of what its peers have is low all the time."""

LONE: Final = 0.4
"""How much a single low value counts where a damaged digit may be one."""

HEAVY: Final = 1.5
"""So many times its usual effort is load."""


def voltage_sag(case: Case) -> Iterator[Finding]:
    """Servos whose supply falls."""
    known = {s: case.series(s, "voltage") for s in case.measured_by("voltage")}
    usual = {s: float(np.quantile(v.mean, USUALLY)) for s, v in known.items() if v is not None}
    peers = float(np.median([*usual.values()])) if usual else 0.0
    for servo, v in known.items():
        if v is None:
            continue
        normal = peers if usual[servo] < APART * peers else usual[servo]
        limit = _limit(case, servo)
        low = np.flatnonzero((v.low < (1 - SAG) * normal) | (v.low < limit))
        if not len(low) or (len(v) < 2 and normal == usual[servo]):
            continue
        yield _sag(case, servo, v, low, normal, limit)


def _sag(case: Case, servo: int, v: Series, low: I64, normal: float, limit: float) -> Finding:
    least = float(v.low[low].min())
    strength = min(max((1 - least / normal - SHALLOW) / (DEEP - SHALLOW), 0.0), 1.0)
    if least < limit:
        strength = 1.0
    if len(low) < 2 and not case.has_checksum:
        strength *= LONE
    under = " under load" if _is_loaded(case, servo, v, low) else ""
    below = f", its limit is {v.told(limit)}" if least < limit else ""
    return Finding(
        "voltage-sag",
        servo,
        int(v.t_first[low[0]]),
        int(v.t[low[-1]]),
        len(low),
        f"servo {servo} measures {v.told(least)} at least{under}, usually {v.told(normal)}{below}",
        tuple(
            Place(int(v.at[r]), 1, int(v.t_first[r]), f"voltage {v.told(v.low[r])}")
            for r in low[:3]
        ),
        strength=strength,
        brief=f"supply of servo {servo} sags to {v.told(least)}{under}",
        values=(("least", least), ("usual", normal)),
    )


def _limit(case: Case, servo: int) -> float:
    """Return the lowest voltage that a servo is set to accept; 0: it was not seen."""
    for index, register in enumerate(case.protocol.registers):
        if register.unit == "V" and not register.quantity and "low" in register.name:
            told = case.settings(register.name, servo_id=servo)
            mine = told.after[told.what == index]
            if len(mine):
                return float(mine[-1]) * register.scale
    return 0.0


def _is_loaded(case: Case, servo: int, v: Series, low: I64) -> bool:
    """Tell whether the servo, or all that say it, work hard when its voltage is low."""
    usual, then = 0.0, 0.0
    for one in case.servos:
        motor = effort(case, one)
        if motor is None:
            continue
        steady, _ = motor.between(int(v.t_first[low[0]]), int(v.t[low[-1]]))
        if np.isfinite(steady):
            part = 1.0 if one == servo else 0.5  # its own load weighs more: it is behind its wire
            usual += part * float(np.median(motor.steady))
            then += part * steady
    return then > HEAVY * usual > 0


RULES: Final[tuple[Rule, ...]] = (voltage_sag,)
"""The rules of this file."""
