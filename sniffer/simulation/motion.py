"""Servo physics: a joint that follows its goal, and the supply that all joints share.

Positions are fractions of the travel (0..1), loads fractions of the stall load (-1..1). Only the
trajectories use transcendental functions, and round what they return: the rest is plain arithmetic,
so one seed gives the same bytes on every machine.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    import random

STEP_S: Final = 0.002
AMBIENT_DEGC: Final = 26.0

STRAIN: Final = 0.85
"""Part of the stall load beyond which a motor is strained. This and what follows are figures of the
simulation."""

STIFFNESS: Final = 12.0
"""Part of the stall load with which a joint that is held fast pushes, for each travel of error."""

OHM: Final = 0.25
"""What a supply and its leads put in the way of the current of up to ``SERVED`` joints."""

SERVED: Final = 8
"""Joints that one pair of supply wires feeds; more of them have more wires."""

DROOP: Final = 0.06
"""Part of the travel by which a joint gives way under all of the stall load."""

WARMEST_DEGC: Final = 55.0
EASED_K: Final = 10.0
"""As warm as a joint gets that follows its goals; it warms as it will until so much below that."""

HELD_WARMTH: Final = 0.3
"""Part of the usual warmth of a motor that does not turn: the servo limits its current."""

HANGS_AT: Final = 0.08
"""Where a joint hangs that nothing drives, and how fast it falls there: per second, squared."""

FALLS: Final = 25.0

Trajectory = Callable[[float], float]
"""The goal, 0..1, at a time in seconds."""


def sines(rng: random.Random) -> Trajectory:
    """Return a sum of three slow sines around a middle of its own."""
    middle = rng.uniform(0.42, 0.58)
    waves = [(rng.uniform(0.05, 0.13), rng.uniform(0.15, 1.1), rng.uniform(0, 6)) for _ in range(3)]

    def at(t: float) -> float:
        x = middle + sum(a * math.sin(2 * math.pi * f * t + p) for a, f, p in waves)
        return round(min(max(x, 0.02), 0.98), 9)

    return at


def moves(rng: random.Random) -> Trajectory:
    """Return minimum-jerk moves between points with rests at them, over and over.

    The law is 10 s^3 - 15 s^4 + 6 s^5. Source: Flash and Hogan, The Coordination of Arm Movements,
    J. Neurosci. 5 (1985).
    """
    points = [rng.uniform(0.1, 0.9) for _ in range(rng.randint(4, 7))]
    legs = [(rng.uniform(0.4, 1.2), rng.uniform(0.1, 0.6)) for _ in points]
    period = sum(move + rest for move, rest in legs)

    def at(t: float) -> float:
        left = t % period
        for k, (move, rest) in enumerate(legs):
            a, b = points[k], points[(k + 1) % len(points)]
            if left < move + rest:
                s = min(left / move, 1.0)
                return round(a + (b - a) * s * s * s * (10 - 15 * s + 6 * s * s), 9)
            left -= move + rest
        return points[0]

    return at


def trajectory(rng: random.Random) -> Trajectory:
    """Draw one of the two."""
    return sines(rng) if rng.random() < 0.5 else moves(rng)


def _within(least: float, value: float, most: float) -> float:
    """Return a value, or the limit that it is beyond: in half the time of ``min`` and ``max``."""
    return least if value < least else most if value > most else value


class Joint:
    """One servo's mechanics: second-order following, friction, gravity, heat."""

    def __init__(self, rng: random.Random, position: float) -> None:
        self.goal = self.position = position
        self.speed = 0.0  # per second
        self.load = 0.0
        self.current_ma = self._idle_ma = rng.uniform(35, 55)
        self.temperature = AMBIENT_DEGC + rng.uniform(2, 9)
        self.enabled = False
        self.sag = 0.0
        """How much of its supply voltage is lost on the way to it, 0..1."""
        self.is_held = False
        """Something holds it fast."""
        self.is_limp = False
        """Its motor is off, whatever the servo wants, and the joint falls to where it hangs."""
        self.burden = 0.0
        """What pulls at it from outside, in parts of the stall load."""
        self.heater = 0.0
        """Warmth that it gets while its motor is on, beside that of its own load: K per second."""
        self.strained_s = 0.0
        """For how long its load has been beyond ``STRAIN``, less the time since that it was not."""
        self._omega = rng.uniform(28, 45)
        self._damping = rng.uniform(0.75, 1.0)
        self._inertia = rng.uniform(0.015, 0.03)
        self._friction = rng.uniform(0.06, 0.14)
        self._gravity = rng.uniform(-0.15, 0.15)
        self._stall_ma = rng.uniform(900, 1400)
        self._heating = rng.uniform(4, 8)

    @property
    def driven(self) -> bool:
        """Tell whether the motor is on."""
        return self.enabled and not self.is_limp

    def step(self, dt: float) -> None:
        """Move on by ``dt`` seconds."""
        if self.is_held:
            self._push(dt)
            return
        driven, position, speed = self.driven, self.position, self.speed
        goal = _within(0.0, self.goal, 1.0)  # it does not press against its end
        if self.burden:
            goal -= DROOP * self.burden
        if driven:
            pull = self._omega * self._omega * (goal - position)
            acceleration = pull - 2 * self._damping * self._omega * speed
            acceleration = _within(-30.0, acceleration, 30.0)
        else:
            acceleration = -20.0 * speed
            if self.is_limp:
                acceleration += FALLS * (HANGS_AT - position)
        speed = _within(-1.6, speed + acceleration * dt, 1.6)
        position += speed * dt
        if not 0.0 <= position <= 1.0:
            position, speed = _within(0.0, position, 1.0), 0.0
        self.position, self.speed = position, speed
        torque = 0.0
        if driven:
            rubbing = self._friction * speed / (abs(speed) + 0.03)
            torque = self._inertia * acceleration + rubbing + self._gravity * (position - 0.3)
            if self.burden:
                torque += self.burden
        # nobody builds a joint that its own way makes too hot: that is a fault's matter
        eased = 1.0 if self.burden else (WARMEST_DEGC - self.temperature) / EASED_K
        self._work(torque, dt, self._heating * _within(0.0, eased, 1.0))

    def _push(self, dt: float) -> None:
        """Push against what holds it fast."""
        self.speed = 0.0
        torque = STIFFNESS * (self.goal - self.position) if self.driven else 0.0
        self._work(torque, dt, self._heating * HELD_WARMTH)

    def _work(self, torque: float, dt: float, heating: float) -> None:
        """Let the load follow the torque; current and warmth follow the load."""
        load = self.load = self.load + (_within(-1.0, torque, 1.0) - self.load) * dt / 0.02
        self.current_ma = self._idle_ma + abs(load) * self._stall_ma
        warmth = heating * load * load
        self.temperature += (warmth - (self.temperature - AMBIENT_DEGC) / 240) * dt
        if self.heater and self.driven:
            self.temperature += self.heater * dt
        if self.strained_s or abs(load) > STRAIN:
            self.strained_s = max(self.strained_s + (dt if abs(load) > STRAIN else -dt), 0.0)


class Rig:
    """All joints on one supply: the voltage sags under the current of all of them."""

    def __init__(self, joints: Sequence[Joint], supply_v: float) -> None:
        self.joints = joints
        self.voltage = self._supply_v = supply_v
        self.now_s = 0.0
        self._ohm = OHM * min(1.0, SERVED / max(len(joints), 1))

    def feed(self, supply_v: float) -> None:
        """Take another supply."""
        self.voltage = self._supply_v = supply_v

    def advance(self, now_s: float) -> None:
        """Let time pass until ``now_s``, in whole steps."""
        while self.now_s + STEP_S <= now_s:
            for joint in self.joints:
                joint.step(STEP_S)
            total_a = sum(joint.current_ma for joint in self.joints) / 1000
            self.voltage = self._supply_v - self._ohm * total_a
            self.now_s += STEP_S

    def voltage_at(self, joint: Joint) -> float:
        """Return the voltage that reaches one joint."""
        return self.voltage * (1 - joint.sag)
