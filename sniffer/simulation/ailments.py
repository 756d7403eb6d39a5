"""What a servo suffers from for a while, or for ever: faults that have begun, and what they do."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from sniffer.ground.model import NS
from sniffer.simulation import faults as f

if TYPE_CHECKING:
    import random

    from sniffer.simulation.faults import Mischief
    from sniffer.simulation.talk import Bus, Servo

FOREVER_NS: Final = 1 << 62

LASTS_S: Final = {f.STALL: (1.5, 4.0), f.OVERLOAD: (3.0, 6.0), f.OVERHEAT: (20.0, 40.0)}
"""How long a fault holds on that passes, where nobody says it."""

HEATER_K_S: Final = (3.0, 6.0)
"""How fast a motor grows hot: faster than a real one, so that it is seen within half a minute."""

BURDEN: Final = (0.92, 0.99)
"""What an overloaded joint bears, in parts of the stall load."""

RESETS_S: Final = (0.4, 2.0)
"""From one restart of a servo to the next."""


class Ailments:
    """The lasting faults of a bus: when they begin, what they do meanwhile, when they end."""

    def __init__(self, bus: Bus, mischief: Mischief) -> None:
        self._bus = bus
        self._mischief = mischief
        self._until: dict[Servo, dict[str, int]] = {}
        self._next_reset: dict[Servo, int] = {}

    @property
    def _rng(self) -> random.Random:
        return self._mischief.rng

    def strike(self, servo_id: int, now_ns: int) -> None:
        """Take the chance that a request is."""
        servo = self._bus.servos.get(servo_id)
        if servo is None:
            return
        for kind in f.LASTING_FAULTS:
            if kind not in self._until.get(servo, ()):
                fault = self._mischief.struck(kind, servo_id, now_ns)
                if fault is not None:
                    self.begin(kind, servo, now_ns, self._end_of(fault, now_ns))

    def _end_of(self, fault: f.Fault, now_ns: int) -> int:
        if fault.last_s < math.inf:
            return int(fault.last_s * NS)
        if fault.kind in LASTS_S:
            return now_ns + int(self._rng.uniform(*LASTS_S[fault.kind]) * NS)
        return FOREVER_NS

    def begin(self, kind: str, servo: Servo, now_ns: int, until_ns: int = FOREVER_NS) -> None:
        """Let a servo suffer from now on."""
        self._until.setdefault(servo, {})[kind] = until_ns
        joint, rng = servo.joint, self._rng
        match kind:
            case f.LIMP:
                servo.let_go()
            case f.STALL:
                joint.is_held = True
            case f.OVERHEAT:
                joint.heater = rng.uniform(*HEATER_K_S)
            case f.OVERLOAD:
                joint.burden = rng.choice((-1, 1)) * rng.uniform(*BURDEN)
            case f.SLOW:
                servo.lag_ns = rng.randint(*self._bus.lags_ns)
            case f.RESETS:
                self._next_reset[servo] = now_ns
            case _:
                servo.deaf_until_ns = FOREVER_NS

    def pass_time(self, now_ns: int) -> None:
        """Let time pass: what is over ends, who restarts does."""
        for servo, kinds in self._until.items():
            if now_ns >= self._next_reset.get(servo, FOREVER_NS):
                self._restart(servo, now_ns)
            for kind in [kind for kind, until_ns in kinds.items() if now_ns >= until_ns]:
                del kinds[kind]
                self._end(kind, servo)
            if f.LIMP in kinds and servo.joint.driven:  # it was switched on again
                del kinds[f.LIMP]

    def _restart(self, servo: Servo, now_ns: int) -> None:
        servo.power_on()
        boot_ns = self._rng.randint(*self._bus.boot_ns)
        servo.deaf_until_ns = max(servo.deaf_until_ns, now_ns + boot_ns)
        self._next_reset[servo] = now_ns + boot_ns + int(self._rng.uniform(*RESETS_S) * NS)

    def _end(self, kind: str, servo: Servo) -> None:
        match kind:
            case f.LIMP:
                servo.take_hold()
            case f.STALL:
                servo.joint.is_held = False
            case f.OVERHEAT:
                servo.joint.heater = 0.0
            case f.OVERLOAD:
                servo.joint.burden = 0.0
            case f.SLOW:
                servo.lag_ns = 0
            case f.RESETS:
                del self._next_reset[servo]
            case _:  # somebody has plugged it in again
                servo.deaf_until_ns = 0
                servo.power_on()

    def of(self, servo: Servo) -> str | None:
        """Name what a servo suffers from, the latest."""
        kinds = self._until.get(servo)
        return next(reversed(kinds)) if kinds else None
