"""The supply as servos measure it: sags, under load or of all at once, and limits."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.efforts import effort
from sniffer.diagnosis.evidence.goal_steps import goal_steps
from sniffer.diagnosis.evidence.gone import gone_at_once
from sniffer.diagnosis.evidence.limits import Limit, limit_told
from sniffer.diagnosis.evidence.passing import misread_senders
from sniffer.diagnosis.model import Finding, Place
from sniffer.ground.medians import median, quantile
from sniffer.ground.milli import MILLI
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from sniffer.diagnosis.case import Case, Series
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import F64, I64

CHARGE: Final = "Charge or replace the battery: all that measure the supply see it run down. If it is a mains supply, measure it at its terminals."

FINDINGS: Final = (
    FindingCode(
        "voltage-sag",
        "The supply voltage that a servo measures falls far below what it usually is, or below its limit.",
        "A voltage more than an eighth below what the servo has for most of the time, or its peers, and no less than it can speak with; it counts in full from a quarter on, or below the servo's own limit, and little where it is no deeper, over as soon as motors have started, and no complaint or silence goes with it. A lone such value less than about a fifth below the usual one is not told.",
        is_of_supply=True,
    ),
    FindingCode(
        "supply-stays-low",
        "A servo measures far less than its supply time after time.",
        "Four readings in a row and more, with none between that is higher, of which each is a quarter below what the servo has for most of the time, or its peers.",
        is_of_supply=True,
    ),
    FindingCode(
        "supply-runs-down",
        "The supply falls all the time, for all servos that measure it, and does not come back.",
        "Of five parts of the time none has a higher voltage than the one before, of every servo that measures it, and the last one has a tenth less than the first; beside signs that it was too little.",
        is_of_supply=True,
        is_manner=True,
        remedy=CHARGE,
        settle=CHARGE,
    ),
    FindingCode(
        "supply-steady",
        "The supply of a servo was as usual right before it fell silent.",
        "A voltage within a twentieth of the usual one shortly before its silences, and behind the last step of goals, known of half of them at least; it counts in full within a tenth of a second, and less up to a second.",
    ),
)

PARTS: Final = 5
SPENT: Final = 0.1
BACK: Final = 0.01
"""Parts of the time, which part of its voltage a battery has lost that is nearly empty, and by how much
one part may be above the one before: by what a load takes for a while."""

JUST_NS: Final = NS // 10
SOON_NS: Final = NS
"""A voltage that was measured so shortly before a silence tells what the supply was like; up to the
second time it tells less and less."""

BEFORE_NS: Final = NS
"""So close to each other, two signs are of one sag."""

OLD: Final = 0.4
"""How much a voltage counts that is a second old."""

SAG: Final = 0.12
"""Part of the usual voltage; thin wires and a battery under a robot's load move it by less."""

STEADY: Final = 0.05

DEEP: Final = 0.25
"""... and from this part on nothing else explains it."""

SHALLOW: Final = 0.10
"""At this part it counts for nothing: of a sixth alone, with no complaint and no silence, no engineer
would say that a supply breaks down."""

STAYS: Final = 4
"""Readings in a row: what is misread by chance is not so often misread alike."""

ALIVE: Final = 0.35
"""Below this part of its usual voltage a servo says nothing any more: who states it was misread."""

USUALLY: Final = 0.75
"""The voltage that is reached for a quarter of the time is that without load."""

APART: Final = 0.85
"""A servo that has less than this part of what its peers have is low all the time."""

STARTS_NS: Final = NS // 4
"""A start takes tenths of a second: until a motor turns, nothing but its windings limits its current,
and where all start at once the supply of a sound robot has that to bear."""

LONE: Final = 0.4
"""How much a low value counts of which nothing follows: motors may just start, or a digit be torn."""

TOLD: Final = 0.25
"""Such a lone low value is not told below this: all motors of eight servos that start at once take
18 % at the end of a sound line."""

HEAVY: Final = 1.5
"""So many times its usual effort is load."""


def voltage_sag(case: Case) -> Iterator[Finding]:
    """Servos whose supply falls."""
    known = {s: case.series(s, "voltage") for s in case.measured_by("voltage")}
    usual = {s: float(quantile(v.mean, USUALLY)) for s, v in known.items() if v is not None}
    misread = misread_senders(case)  # some of what they seem to measure they did not say
    sound = [volts for servo, volts in usual.items() if servo not in misread]
    peers = float(median(sound)) if sound else 0.0
    for servo, v in known.items():
        if v is None:
            continue
        normal = peers if usual[servo] < APART * peers else usual[servo]
        limit = _limit(case, servo)
        below = (v.low < limit.value) & (v.t_first >= limit.since_ns)
        low = np.flatnonzero((v.low >= ALIVE * normal) & ((v.low < (1 - SAG) * normal) | below))
        if not len(low) or (len(v) < 2 and normal == usual[servo]):
            continue
        found = _sag(case, servo, v, low, normal, limit)
        if found is None:
            continue
        yield found
        deep = v.high < (1 - DEEP) * normal
        lasting = _in_a_row(
            (int(n) if is_deep else 0) for n, is_deep in zip(v.n, deep, strict=True)
        )
        if lasting >= STAYS:
            yield replace(
                found,
                code="supply-stays-low",
                count=lasting,
                what=f"servo {servo} measures less than {v.told((1 - DEEP) * normal)} "
                f"{lasting} times in a row",
                strength=1.0,
                brief="",
            )


def runs_down(case: Case) -> Iterator[Finding]:
    """Tell whether the supply falls all the time, as a battery that is empty does."""
    known = [v for s in case.measured_by("voltage") if (v := case.series(s, "voltage")) is not None]
    parts = [_parts(v) for v in known if len(v) >= PARTS * STAYS]
    if not parts or len(parts) < len(known):
        return
    back = max(float(np.diff(one).max()) / one[0] for one in parts)
    if back > BACK or any(one[-1] > (1 - SPENT) * one[0] for one in parts):
        return
    first, last = (float(median([one[k] for one in parts])) for k in (0, -1))
    v = known[0]
    yield Finding(
        "supply-runs-down",
        None,
        int(min(v.t_first[0] for v in known)),
        int(max(v.t[-1] for v in known)),
        1,
        f"the supply falls from {v.told(first)} to {v.told(last)} for all servos that measure it, and "
        "does not come back",
        (Place(int(v.at[-1]), 1, int(v.t_first[-1]), f"voltage {v.told(v.last[-1])}"),),
        brief=f"the supply runs down to {v.told(last)}",
    )


def _parts(v: Series) -> F64:
    """Return the mean voltage of each part of the time, by as many readings each."""
    return np.array([part.mean() for part in np.array_split(v.mean, PARTS)])


def steady(case: Case) -> Iterator[Finding]:
    """Servos that fell silent with their supply in order."""
    steps = goal_steps(case)
    for servo in case.measured_by("voltage"):
        v = case.series(servo, "voltage")
        spells = [s for s in case.ledger.silences.runs(servo) if s.missed > 1]
        # a supply that is cut off was in order before
        if v is None or not spells or len(v) < 2 or servo in gone_at_once(case):
            continue
        usual = float(quantile(v.mean, USUALLY))
        began = np.array([s.first_ns for s in spells], np.int64)
        row = np.searchsorted(v.t, began, "right") - 1
        age = began - v.t[np.maximum(row, 0)]
        # what it was before motors set out tells nothing of what they take
        is_old = np.searchsorted(steps, began) > np.searchsorted(steps, v.t[np.maximum(row, 0)])
        known = (row >= 0) & (age <= SOON_NS) & ~is_old
        if 2 * known.sum() < len(known) or (v.low[row[known]] < (1 - STEADY) * usual).any():
            continue
        began, row, age = began[known], row[known], age[known]
        yield Finding(
            "supply-steady",
            servo,
            int(began[0]),
            int(began[-1]),
            len(row),
            f"servo {servo} measures {v.told(float(v.low[row].min()))} right before it falls silent",
            tuple(
                Place(int(v.at[r]), 1, int(v.t_first[r]), f"voltage {v.told(v.last[r])}")
                for r in row[:2].tolist()
            ),
            strength=min(1.0, max(1.0 - float(median(age) - JUST_NS) / SOON_NS, OLD)),
        )


def _in_a_row(counts: Iterable[int]) -> int:
    """Return the greatest sum of counts with no zero between: 2 3 0 4 is 5."""
    most = here = 0
    for n in counts:
        here = here + n if n else 0
        most = max(most, here)
    return most


def _sag(
    case: Case, servo: int, v: Series, low: I64, normal: float, limit: Limit
) -> Finding | None:
    """Return what a sag says; None where it is one that sound robots have."""
    least = float(v.low[low].min())
    strength = min(max((1 - least / normal - SHALLOW) / (DEEP - SHALLOW), 0.0), 1.0)
    is_below = least < limit.value and v.t[low[-1]] >= limit.since_ns
    if is_below:
        strength = 1.0
    is_start = strength < 1.0 and v.t_first[low[-1]] - v.t_first[low[0]] <= STARTS_NS
    is_doubtful = len(low) < 2 and not case.has_checksum
    if (is_start or is_doubtful) and not _is_borne_out(case, servo, v, low):
        strength *= LONE
        if strength < TOLD:
            return None
    under = " under load" if _is_loaded(case, servo, v, low) else ""
    below = f", its limit is {v.told(limit.value)}{limit.told(case)}" if is_below else ""
    sags = (
        "sags to" if least < (1 - SAG) * normal else f"is below its limit, {v.told(limit.value)}:"
    )
    return Finding(
        "voltage-sag",
        servo,
        int(v.t_first[low[0]]),
        int(v.t[low[-1]]),
        len(low),
        f"servo {servo} measures {v.told(least)} at least{under}, usually {v.told(normal)}{below}",
        _lowest(case, servo, v),
        strength=strength,
        brief=f"supply of servo {servo} {sags} {v.told(least)}{under}",
        values=(("least", least), ("usual", normal)),
    )


def _lowest(case: Case, servo: int, v: Series) -> tuple[Place, ...]:
    """Return where the lowest voltage stands."""
    low = case.ledger.lowest.of(servo, v.index)
    if low is None:
        return ()
    return (Place(low.at, 1, low.t_ns, f"voltage {v.told(low.value / MILLI)}"),)


def _is_borne_out(case: Case, servo: int, v: Series, low: I64) -> bool:
    """Tell whether the servo complains, or falls silent, about when its voltage is low."""
    since, until = int(v.t_first[low[0]]) - BEFORE_NS, int(v.t[low[-1]]) + BEFORE_NS
    told = case.anomalies("device-safe-mode", "device-input-voltage", servo_id=servo).t_ns
    silent = [s.first_ns for s in case.ledger.silences.runs(servo)]
    return any(since <= t <= until for t in (*told.tolist(), *silent))


def _limit(case: Case, servo: int) -> Limit:
    """Return the lowest voltage that a servo is set to accept; 0: it was not seen."""
    for index, register in enumerate(case.protocol.registers):
        if register.least_of == "voltage":
            told = limit_told(case, servo, index)
            if told is not None:
                return told
    return Limit(0.0, 0)


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
            usual += part * float(median(motor.steady))
            then += part * steady
    return then > HEAVY * usual > 0


RULES: Final[tuple[Rule, ...]] = (voltage_sag, steady, runs_down)
"""The rules of this file."""
