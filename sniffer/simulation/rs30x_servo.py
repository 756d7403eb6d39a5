"""An RS30x servo: its memory map, the flash that keeps a part of it, and what it answers.

What is written to the ROM area holds at once, but for the baud rate, and survives a restart only if
a flash write came before it. Source: RS305CR manual, table 4.1, bits 6 to 4.
"""

from __future__ import annotations

import functools
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sniffer.protocols.rs30x.grammar import ACK, ACK_BYTE, NACK_BYTE, OPS, READ, RETURN
from sniffer.simulation.memory import Memory
from sniffer.simulation.talk import Message, Servo

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sniffer.ground.registers import RegisterMap
    from sniffer.simulation.motion import Joint, Rig

TRAVEL: Final = 2400
"""Tenths of a degree between the ends that the simulated trajectories use, of 3000."""

KEPT: Final = 1 << 14
"""Packets that are not built anew: a bus repeats itself."""

SHIPPED: Final[Mapping[str, int]] = MappingProxyType(
    {"firmware_version": 3, "punch": 180, "servo_id": 1}
)
"""Registers for which a table has no default; the id is that of a factory reset."""

OFF, ON, BRAKE = 0, 1, 2
"""Values of Torque Enable. Source: RS305CR manual, 4.3 No. 36."""

LIMIT_DEGC, ALARM_BEFORE_K = 80, 10
"""Where a table names no limit, that of the RS305CR; the alarm comes so much earlier.
Source: RS305CR manual, 4.2 No. 14, 4.3 No. 50."""

LIMIT_BIT, ALARM_BIT = 1 << 7, 1 << 5
"""Flags of a return packet. Source: RS305CR manual, table 4.3."""

ROM: Final = range(0x04, 0x1E)
"""Addresses that a flash write keeps and a factory reset clears. Source: RS305CR manual, bit 4."""


@functools.lru_cache(KEPT)
def returned(servo_id: int, address: int, data: bytes, flags: int = 0) -> bytes:
    """Build a return packet."""
    body = {"servo_id": servo_id, "flags": flags, "address": address}
    body |= {"length": len(data), "count": 1}
    return bytes(RETURN.build({"body": {"value": {**body, "data": data}}}))


class Rs30xServo(Servo):
    """A memory map, and the flash that keeps the ROM area of it."""

    def __init__(self, servo_id: int, joint: Joint, rig: Rig, table: RegisterMap) -> None:
        self.memory = Memory(table, SHIPPED)
        self.memory.raw["servo_id"] = servo_id
        self.flash: dict[str, int] = {}
        self.burn()
        super().__init__(servo_id, joint, rig, table)

    def shipped(self, baud: int) -> None:
        """Come from the factory set to a baud rate."""
        self.memory.choose("baud_rate", str(baud))
        self.burn()

    def power_on(self) -> None:
        """Volatile registers go back to their defaults, others to the flash; the torque is off."""
        super().power_on()
        self.memory.reset(volatile_only=True)
        self.memory.raw["max_torque"] = 100
        self.memory.raw |= self.flash
        self.tripped = False

    def burn(self) -> None:
        """Write the ROM area to the flash."""
        self.flash = {name: self.memory.raw[name] for name in self._rom()}

    def clear(self) -> None:
        """Let the ROM area be as shipped: also the id. The flash keeps what it has."""
        for name in self._rom():
            self.memory.raw[name] = self.memory.default(name)

    def _rom(self) -> list[str]:
        return [r.name for r in self.memory.table.registers if r.address in ROM]

    def measure(self) -> None:
        """Fill the block 42..59."""
        joint, memory = self.joint, self.memory
        memory.raw["present_position"] = tenths(joint.position)
        memory.raw["present_time"] = memory.raw["goal_time"]
        memory.put("present_speed", joint.speed * TRAVEL / 10)
        memory.put("present_current", joint.current_ma)
        memory.put("present_temperature", joint.temperature)
        memory.put("present_voltage", self.voltage)
        memory.raw |= self.seen

    def adopt(self, values: Mapping[str, int]) -> None:
        """Take registers as they were seen; the flash keeps them."""
        self.memory.adopt(values)
        self.burn()
        self._follow()

    def place_in(self, values: Mapping[str, int]) -> float | None:
        """Return the present position in parts of the travel."""
        raw = values.get("present_position")
        return None if raw is None else raw / TRAVEL + 0.5

    @property
    def new_id(self) -> int:
        """The id register."""
        return self.memory.raw["servo_id"]

    def give(self, address: int, length: int, op: str = OPS[READ]) -> Message:
        """Answer with a return packet."""
        self.measure()
        data = self.memory.read(address, length)
        built = returned(self.servo_id, address, data, self._status())
        values = self.memory.values(self.servo_id, address, length)
        return Message(built, self.servo_id, op, values)

    def take(self, values: Mapping[str, int]) -> None:
        """Store values; the motor follows."""
        self.memory.raw |= values
        self._follow()

    def write(self, address: int, data: bytes) -> None:
        """Store bytes from an address on; values out of their range are not taken."""
        for name, raw in self.memory.written(address, data).items():
            if self.memory.allows({name: raw}):
                self.memory.raw[name] = raw
        self._follow()

    def acknowledge(self, op: str) -> Message:
        """Answer with the bare byte."""
        return Message(ACKNOWLEDGED, self.servo_id, op)

    def refuse(self, op: str) -> Message:
        """Answer with the other one."""
        return Message(REFUSED, self.servo_id, op)

    def guard(self) -> None:
        """Brake at the temperature limit; only a restart lets it drive again.

        Source: RS305CR manual, 4.3 No. 50.
        """
        if self.joint.temperature > self._limit_degc and not self.tripped:
            self.tripped = True
            self._follow()

    def let_go(self) -> None:
        """Lose the torque until it is switched on again."""
        self.memory.raw["torque_enable"] = OFF
        self._follow()
        self.joint.is_limp = True

    @property
    def _limit_degc(self) -> int:
        return self.memory.raw.get("temperature_limit") or LIMIT_DEGC

    def _status(self) -> int:
        """Return the flags of a return packet."""
        is_warm = self.joint.temperature > self._limit_degc - ALARM_BEFORE_K
        return LIMIT_BIT * self.tripped | ALARM_BIT * is_warm

    def _follow(self) -> None:
        if self.tripped:
            self.memory.raw["torque_enable"] = BRAKE
        self.joint.enabled = self.memory.raw["torque_enable"] == ON
        if self.joint.enabled:
            self.joint.is_limp = False
            # beyond its limits it goes to the limit. Source: RS305CR manual, 4.3 No. 30
            raw = self.memory.raw
            low, high = (raw.get(f"{side}_angle_limit", 0) for side in ("ccw", "cw"))
            goal = min(max(raw["goal_position"], low), high) if low < high else raw["goal_position"]
            self.joint.goal = goal / TRAVEL + 0.5


ACKNOWLEDGED: Final = bytes(ACK.build({"answer": ACK_BYTE}))
REFUSED: Final = bytes(ACK.build({"answer": NACK_BYTE}))


def tenths(position: float) -> int:
    """Return the register value, 0.1 degrees, of a place 0..1."""
    return round((position - 0.5) * TRAVEL)
