"""Joints with motors that follow goals, pull current and warm up, on a supply with a resistance."""

from __future__ import annotations

import math
import random
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable


class Supply:
    def __init__(self, volts: float = 12.0, ohms: float = 0.15) -> None:
        self.volts, self.ohms = volts, ohms


class Joint(ABC):
    """Positions are shares of the stroke, loads of the most there is; currents are amperes."""

    def __init__(
        self, ident: int, supply: Supply, seed: int, speed: float = 1.2, weight: float = 0.12
    ) -> None:
        self.ident = self.place = ident
        self.supply, self.rng = supply, random.Random(seed * 977 + ident)
        self.pos = self.goal = 0.5 + self.rng.uniform(-0.1, 0.1)
        self.vel, self.load, self.current = 0.0, 0.0, 0.05
        self.temp = 27.0 + self.rng.uniform(0, 4)
        self.volts = supply.volts
        self.top, self.weight = (
            speed * self.rng.uniform(0.9, 1.1),
            weight * self.rng.uniform(0.5, 1.5),
        )
        self.torque, self.error = False, 0
        self.t = 0.0
        self.amps, self.ohms, self.heat, self.air = 1.2, 0.05, 6.0, 27.0
        self.tau = 90.0
        self.stop: Callable[[float, float], float | None] = lambda t, p: None  # where it is held
        self.hand: Callable[[float], float] | None = None
        self.clock, self.delay = self.rng.uniform(0.998, 1.002), 0.0003
        self.limit_volts, self.limit_temp, self.dies_below = 7.0, 80.0, 0.0
        self.boots, self.boot_time = 0.0, 0.3
        self.restarted = 0
        self.cap = 1.0
        self.dither = 0.0015

    def off(self, t: float) -> bool:
        return t < self.boots

    def restart(self, t: float, away: float | None = None) -> None:
        self.boots = t + (self.boot_time if away is None else away)
        self.torque, self.error = False, 0
        self.restarted += 1
        self.defaults()

    def defaults(self) -> None:  # noqa: B027 - a wCK loses nothing that is asked for here
        """Forget what is lost without power."""

    @abstractmethod
    def hear(self, frame: bytes, t: float) -> bytes | None:
        """Return the answer to a frame; None: there is none."""

    def advance(self, t: float, total: float) -> None:
        dt, self.t = t - self.t, t
        before = self.pos
        awake = self.torque and not self.off(t)
        if awake:
            pull = (self.goal - self.pos) * 14
            self.vel += max(
                -25 * dt, min(25 * dt, max(-self.top, min(self.top, pull)) * self.cap - self.vel)
            )
        elif self.hand:
            self.vel = (self.hand(t) - self.pos) / dt * 0.2
        else:
            self.vel = -0.25 * self.weight if self.pos > 0.1 else 0.0
        self.pos = min(1.0, max(0.0, self.pos + self.vel * dt))
        held = self.stop(t, self.pos)
        if held is not None:
            self.pos, self.vel = held, 0.0
        drive = abs(self.goal - self.pos) * 6 if awake else 0.0
        moving = abs(self.pos - before) / dt if dt else 0.0
        want = min(
            1.0,
            self.weight * (0.5 + 0.5 * math.sin(self.pos * 4))
            + 0.25 * moving
            + (min(1.0, drive) if held is not None else 0.0),
        )
        self.load += ((want if awake else 0.0) - self.load) * min(1.0, dt / 0.03)
        self.current = 0.0 if self.off(t) else 0.04 + self.load * self.amps
        self.volts = self.supply.volts - self.supply.ohms * total - self.ohms * self.current
        self.temp += dt * ((self.air - self.temp) / self.tau + self.heat * self.current**2 / 10)
        if self.volts < self.dies_below and not self.off(t):
            self.restart(t)

    def noisy(self, value: float, share: float) -> float:
        return value + self.rng.gauss(0, share)

    @property
    def seen(self) -> float:
        return min(1.0, max(0.0, self.noisy(self.pos, self.dither / 3)))

    @property
    def sign(self) -> int:
        return 1 if self.vel >= 0 else -1
