"""How hard a motor works, by what its servo measures: idle, at work, or pushing."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.distinct import within
from sniffer.ground.medians import median, quantile

if TYPE_CHECKING:
    from sniffer.diagnosis.case import Case, Series
    from sniffer.ground.model import F64

QUANTITIES: Final = ("load", "current", "operating_rate")
"""What tells it, the best first."""

PUSHES: Final = 0.4
"""Part of the greatest load that no motor has for a second but where it presses or bears."""

IDLES: Final = 0.12
"""Part of it that friction and give of a joint have, with the motor off."""

NOTHING: Final = 0.03
"""A motor that is off has no more, unless all of the bus have: a load is what drives it."""

PUSHING_MA: Final = 300.0
"""Currents of small servos at rest are some tens of mA, their stall currents 800 mA and more."""

TIMES: Final = 3.0
"""A current so many times the least on the bus is more than that of electronics alone."""


STOPS: Final = 0.9
"""Part of the effort at which it is told to stop that a servo has when it does."""


class Effort:
    """Load or current of one servo, as parts of what it can or against what its peers have."""

    def __init__(self, case: Case, series: Series) -> None:
        self._case = case
        self.series = series
        self.full = _greatest(series)
        """The greatest that the motor can, 0 where it is in mA."""
        self.size: F64 = np.maximum(np.abs(series.low), np.abs(series.high))
        self.steady: F64 = np.abs(series.mean)

    @functools.cached_property
    def _idle(self) -> float:
        """What the idlest servo of the bus has."""
        quantity = self.series.register.quantity
        known = (self._case.series(i, quantity) for i in self._case.measured_by(quantity))
        return min(
            (
                float(quantile(np.abs(s.mean), 0.1))
                for s in known
                if s is not None and s.unit == self.series.unit
            ),
            default=0.0,
        )

    @property
    def pushes_from(self) -> float:
        """From which number on the motor pushes."""
        return PUSHES * self.full if self.full else max(PUSHING_MA, TIMES * self._resting)

    @property
    def idles_to(self) -> float:
        """Up to which number the motor may be off."""
        if self.full:
            return min(max(1.6 * self._idle, NOTHING * self.full), IDLES * self.full)
        return min(max(1.6 * self._resting, PUSHING_MA / 5), PUSHING_MA)

    @property
    def _resting(self) -> float:
        """The current of the idlest servo; if that is much, none of them idles."""
        return min(self._idle, PUSHING_MA / 2)

    def between(self, first_ns: int, last_ns: int) -> tuple[float, float]:
        """Return the usual steady effort in a stretch of time, and the usual peaks; NaN: none."""
        rows = (self.series.t >= first_ns) & (self.series.t_first <= last_ns)
        if not rows.any():
            return float("nan"), float("nan")
        return float(median(self.steady[rows])), float(median(self.size[rows]))

    def told(self, value: float) -> str:
        """Return a number in words, as the nearest that a servo can state: it is a mean."""
        if self.full:
            return f"{self.series.register.quantity.replace('_', ' ')} {value / self.full:.0%}"
        step = self.series.scale
        return f"{self.series.register.quantity} {self.series.told(round(value / step) * step)}"


def _greatest(series: Series) -> float:
    """Return the greatest number of a load: 100 %, or what its register states; 0: none known."""
    if series.unit == "%":
        return 100.0
    r = series.register
    top = (1 << r.sign_bit) - 1 if r.sign_bit is not None else (r.range or (0, 0))[1]
    return 0.0 if series.unit else top * abs(r.scale)


def effort(case: Case, servo_id: int) -> Effort | None:
    """Return how hard a servo works; None: it does not say, or in steps that nobody can weigh."""
    for quantity in QUANTITIES:
        series = case.series(servo_id, quantity)
        if series is not None and (series.unit == "mA" or _greatest(series)):
            return Effort(case, series)
    return None


def stops_as_told(case: Case, servo: int, motor: Effort, first_ns: int, last_ns: int) -> bool:
    """Tell whether a servo stands with the effort at which it was told to stop, with its goals.

    A command has that as a modifier, in the unit of the effort: a gripper closes until it holds.
    """
    registers, w = case.protocol.registers, case.writes
    unit = motor.series.unit
    stops = [i for i, r in enumerate(registers) if r.kind == "modifier" and unit and r.unit == unit]
    told = (w["servo_id"] == servo) & within(w["register"], stops) & (w["t_first"] <= first_ns)
    rows = np.flatnonzero(told).tolist()
    limits = [int(w["low"][k]) * abs(registers[int(w["register"][k])].scale) for k in rows]
    _, peaks = motor.between(first_ns, last_ns)
    return any(peaks >= STOPS * limit for limit in limits)
