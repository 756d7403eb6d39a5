"""The mechanics of a bench servo, cheap enough for millions of frames: one step a look.

Positions are fractions of the travel, loads fractions of the stall torque.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from sniffer.ground.model import NS

if TYPE_CHECKING:
    import random

Path = Callable[[float], float]
"""Where a joint is to be, 0..1, at a time in seconds."""

AMBIENT_DEGC: Final = 24.0
STEP_MOST_S: Final = 0.25
"""A servo that was not looked at for longer is where it wants to be."""


class Supply:
    """What all servos hang on: the voltage sags under their currents."""

    def __init__(self, volt: float, ohm: float) -> None:
        self._volt = volt
        self._ohm = ohm
        self.total_a = 0.0

    @property
    def voltage(self) -> float:
        """The voltage at the servos."""
        return self._volt - self._ohm * self.total_a


class Body:
    """One servo: what its registers say of the world, moved on when somebody looks."""

    def __init__(self, servo_id: int, rng: random.Random, supply: Supply) -> None:
        self.servo_id = servo_id
        self.rng = rng
        self.supply = supply
        self.position = self.goal = rng.uniform(0.45, 0.55)
        self.speed = 0.0  # of the travel per second
        self.load = 0.0
        self.current_a = 0.0
        self.temperature = AMBIENT_DEGC + rng.uniform(3, 10)
        self.is_on = True
        self.hand: Path | None = None
        """Where somebody holds it while it is off."""
        self.settings: dict[str, int] = {}
        """What a controller wrote beside goals, by the register's name."""
        self._tau_s = rng.uniform(0.04, 0.09)
        self._idle_a = rng.uniform(0.03, 0.06)
        self._stall_a = rng.uniform(0.9, 1.5)
        self._weight = rng.uniform(-0.12, 0.12)
        self._rub = rng.uniform(0.04, 0.1)
        self._inertia = rng.uniform(0.01, 0.03)
        self._looked_s = 0.0

    def look(self, t_ns: int) -> None:
        """Move on to a time."""
        now_s = t_ns / NS
        dt = min(max(now_s - self._looked_s, 1e-4), STEP_MOST_S)
        self._looked_s = now_s
        before = self.speed
        if self.is_on:
            way = (self.goal - self.position) * (1 - math.exp(-dt / self._tau_s))
            way = min(max(way, -1.8 * dt), 1.8 * dt)
        elif self.hand is not None:
            way = min(max(self.hand(now_s), 0.0), 1.0) - self.position
        else:
            way = 0.0
        self.position += way
        self.speed = way / dt
        push = 0.0
        if self.is_on:
            push = self._inertia * (self.speed - before) / max(dt, 0.01)
            push += self._rub * math.tanh(self.speed * 20) + self._weight * (self.position - 0.4)
        self.load += (min(max(push, -0.8), 0.8) - self.load) * min(1.0, dt / 0.03)
        amperes = self._idle_a + abs(self.load) * self._stall_a
        self.supply.total_a += amperes - self.current_a
        self.current_a = amperes
        warmth = AMBIENT_DEGC + 10 + 60 * self.load * self.load
        self.temperature += (warmth - self.temperature) * dt / 200


def sway(rng: random.Random) -> Path:
    """Return a sum of two slow sines around a middle of its own."""
    middle = rng.uniform(0.42, 0.58)
    waves = [(rng.uniform(0.04, 0.15), rng.uniform(0.1, 0.8), rng.uniform(0, 6)) for _ in range(2)]

    def at(t: float) -> float:
        return middle + sum(a * math.sin(2 * math.pi * f * t + p) for a, f, p in waves)

    return at


def ramps(rng: random.Random) -> Path:
    """Return straight ways between points, with rests at them, over and over."""
    points = [rng.uniform(0.2, 0.8) for _ in range(rng.randint(3, 6))]
    legs = [(rng.uniform(0.5, 1.5), rng.uniform(0.2, 1.0)) for _ in points]
    whole = sum(move + rest for move, rest in legs)

    def at(t: float) -> float:
        left = t % whole
        for k, (move, rest) in enumerate(legs):
            if left < move + rest:
                part = min(left / move, 1.0)
                return points[k] + (points[(k + 1) % len(points)] - points[k]) * part
            left -= move + rest
        return points[0]

    return at


def steps(rng: random.Random, every_s: float = 2.0) -> Path:
    """Return a goal that jumps every so often: a motor pulls hard behind each jump."""
    points = [rng.uniform(0.15, 0.85) for _ in range(7)]
    phase = rng.uniform(0, every_s)

    def at(t: float) -> float:
        return points[int((t + phase) / every_s) % len(points)]

    return at


def stays(rng: random.Random) -> Path:
    """Return a goal that never changes."""
    place = rng.uniform(0.3, 0.7)
    return lambda t: place
