"""What goes wrong in a simulated controller: it hangs, it trembles, it wears memories out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.ground.model import NS
from sniffer.simulation import faults as f

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.simulation.faults import Mischief
    from sniffer.simulation.talk import Bus, Delivery

HANGS_NS: Final = (50 * NS // 1000, 500 * NS // 1000)
"""How long the loop of a controller stops: a garbage collection, a disk, another process."""

TREMBLES: Final = 0.35
"""Part of a cycle by which it begins too early or too late, at most."""

ANYBODY: Final = -1
"""Whom a fault of the controller strikes that is no servo's."""


class Nerves:
    """Draws what the controller does between two cycles, beside what it should."""

    def __init__(self, bus: Bus, mischief: Mischief) -> None:
        self._bus = bus
        self._mischief = mischief
        self._turn = 0
        self.struck: str | None = None
        """What kept it from waiting as long as it meant to, or made it wait longer."""

    def waits(self, until_ns: int, now_ns: int) -> int:
        """Return until when it really waits, whatever it means to."""
        self.struck = None
        if self._mischief.strikes(f.HANG, ANYBODY, now_ns):
            until_ns += self._mischief.rng.randint(*HANGS_NS)
            self.struck = f.HANG
        if self._mischief.strikes(f.JITTER, ANYBODY, now_ns):
            most = int(TREMBLES * self._bus.cycle_ns)
            until_ns += self._mischief.rng.randint(-most, most)
            self.struck = self.struck or f.JITTER
        return until_ns

    def wear(self, now_ns: int) -> Iterator[Delivery]:
        """Yield the writes of this cycle that no cycle should have."""
        self._turn += 1
        for servo_id in self._bus.servos:
            if self._mischief.strikes(f.WEAR, servo_id, now_ns):
                yield self._bus.keep(servo_id, self._turn)
