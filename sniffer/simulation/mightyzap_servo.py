"""A mightyZAP servo: its registers, what it does about a command, and the errors it reports."""

from __future__ import annotations

import functools
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

from sniffer.protocols.mightyzap.grammar import (
    COMMANDS,
    EXECUTE,
    FEEDBACK,
    LOAD,
    OPTION_ID,
    PACKET,
    STORE,
)
from sniffer.simulation.memory import Memory
from sniffer.simulation.motion import STRAIN
from sniffer.simulation.talk import Message, Servo, Value

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sniffer.ground.registers import RegisterMap
    from sniffer.simulation.motion import Joint, Rig

TOP: Final = 4095
"""Position counts of the full stroke in the finest resolution; a coarser one halves them, once or
more. Source: user manual v1.02, (5) 11) Resolution Factor, 19) Goal Position."""

OVERLOAD: Final = STRAIN
"""Part of the greatest load beyond which the simulated servo complains."""

SHUT_DOWN_S: Final = 1.0
"""How long it is overloaded before its force goes off; the manual names no time."""

KEPT: Final = 1 << 14
"""Packets that are not built anew: a bus repeats itself."""

MAP_END: Final = 0x9A
"""Addresses from here on are beyond the map of every model: a range error.
Source: user manual v1.02, (3) Data Map, (2) Feedback Packet, 4. ERROR."""

OPTION_BAUD: Final = 2
"""Factory reset option bit 1: the baud rate goes back to 57600. Source: (4) 6) Factory Reset."""

SHIPPED: Final[Mapping[str, int]] = MappingProxyType(
    {
        "model_number": 12,
        "firmware_version": 14,
        "lowest_limit_voltage": 70,
        "highest_limit_voltage": 130,
        "short_stroke_pulse_width": 900,
        "d_gain": 40,
        "i_gain": 5,
        "p_gain": 60,
        "force_on": 0,
        "long_stroke_limit": TOP,
        "current_i_gain": 5,
        "current_p_gain": 60,
        "speed_d_gain": 40,
        "speed_i_gain": 5,
        "speed_p_gain": 60,
    }
)
"""Registers for which a table has no default, or a servo of this bus another one: figures of the
simulation."""

AT_POWER_ON: Final[Mapping[str, str]] = MappingProxyType(
    {
        "force_limit": "max_force",
        "goal_speed": "speed_limit",
        "goal_current": "current_limit",
        "punch": "punch_initial_value",
    }
)
"""Registers that start as others say. Source: user manual v1.02, (5) 7) Max Force, 30) Punch; 12Lf
User Manual, 4.4, Speed Limit and Current Limit."""

FULL_CURRENT_MA: Final = 1600
"""Greatest current of the 12Lf. Source: 12Lf User Manual, 4.3.1, 0x8E."""


@functools.lru_cache(KEPT)
def packet(servo_id: int, code: int, factors: bytes = b"") -> bytes:
    """Build a packet."""
    body = {"servo_id": servo_id, "size": len(factors) + 2, "code": code, "factors": factors}
    return bytes(PACKET.build({"body": {"value": body}}))


@functools.lru_cache(KEPT)
def _factors(code: int, factors: tuple[tuple[str, Any], ...]) -> bytes:
    told = dict(factors)
    if "targets" in told:
        told["targets"] = [{"servo_id": i, "data": data} for i, data in told["targets"]]
    return bytes(COMMANDS[code].params.build(told))


def command(servo_id: int, code: int, values: tuple[Value, ...] = (), **factors: Any) -> Message:
    """Build a command from its factors by name; ``targets`` are pairs of servo and data."""
    built = _factors(code, tuple(factors.items()))
    return Message(packet(servo_id, code, built), servo_id, COMMANDS[code].name, values)


@functools.cache
def error_byte(*errors: str) -> int:
    """Return the error byte of a feedback that reports these."""
    return int(FEEDBACK.build({"error": dict.fromkeys(errors, True), "data": b""})[0])


class MightyZapServo(Servo):
    """Registers of a model; its answers follow its Feedback Return Mode."""

    def __init__(self, servo_id: int, joint: Joint, rig: Rig, table: RegisterMap) -> None:
        self.memory = Memory(table, SHIPPED)
        self.staged: list[tuple[str, int]] = []
        self.memory.raw["servo_id"] = servo_id
        super().__init__(servo_id, joint, rig, table)

    def shipped(self, baud: int) -> None:
        """Come from the factory set to a baud rate."""
        self.memory.choose("baud_rate", str(baud))

    def power_on(self) -> None:
        """Volatile registers go back to their defaults."""
        super().power_on()
        self.staged.clear()
        raw = self.memory.raw
        self.memory.reset(volatile_only=True)
        raw |= {now: raw[kept] for now, kept in AT_POWER_ON.items() if self.memory.has(now)}
        raw["goal_position"] = round(self.joint.position * self.top)

    @property
    def top(self) -> int:
        """Position counts of the full stroke."""
        factor = self.memory.raw.get("resolution_factor", 1)
        return TOP >> min(max(factor - 1, 0), 3)

    def measure(self) -> None:
        """Fill the present_* registers."""
        joint, memory = self.joint, self.memory
        memory.raw["present_position"] = round(joint.position * self.top)
        memory.put("present_speed", 640 * joint.speed)
        memory.put("present_load", 1023 * joint.load)
        memory.put("present_current", FULL_CURRENT_MA * abs(joint.load) / 1000)
        memory.put("present_motor_operating_rate", 1023 * joint.load)
        memory.put("present_voltage", self.voltage)
        memory.put("present_temperature", joint.temperature)
        memory.raw["moving"] = int(abs(joint.speed) > 0.02)
        memory.raw |= self.seen

    def adopt(self, values: Mapping[str, int]) -> None:
        """Take registers as they were seen; the force is on if they say so."""
        self.memory.adopt(values)
        self.store("force_on", self.memory.raw["force_on"])

    def place_in(self, values: Mapping[str, int]) -> float | None:
        """Return the present position in parts of the stroke."""
        raw = values.get("present_position")
        return None if raw is None else raw / self.top

    @property
    def new_id(self) -> int:
        """The id register."""
        return self.memory.raw["servo_id"]

    def answer(
        self, op: str, data: bytes = b"", values: tuple[Value, ...] = (), *, error: str = ""
    ) -> Message:
        """Build a feedback with the servo's errors of the moment, and that of the command."""
        errors = self._errors()
        if error:
            errors.append(error)
        return Message(packet(self.servo_id, error_byte(*errors), data), self.servo_id, op, values)

    def _errors(self) -> list[str]:
        """Name what is wrong at this moment."""
        raw, errors = self.memory.raw, []
        least, most = (raw[f"{side}_limit_voltage"] for side in ("lowest", "highest"))
        if self.low or not least <= round(self.voltage * 10) <= most:
            errors.append("input_voltage")
        if self.joint.temperature > raw.get("highest_limit_temperature", 255):
            errors.append("overheating")
        if abs(self.joint.load) > OVERLOAD:
            errors.append("overload")
        return errors

    def guard(self) -> None:
        """Switch the force off at an alarm that Alarm Shutdown has a bit for.

        Source: user manual v1.02, (5) 10) Alarm Shutdown.
        """
        errors, raw = self._errors(), self.memory.raw
        if self.joint.strained_s < SHUT_DOWN_S and "overload" in errors:
            errors.remove("overload")
        if "input_voltage" in errors:  # its force is gone anyway, and with it what it was told
            errors.remove("input_voltage")
        if errors and raw["force_on"] and error_byte(*errors) & raw["alarm_shutdown"]:
            self.store("force_on", 0)

    def let_go(self) -> None:
        """Lose the force until it is switched on again."""
        self.store("force_on", 0)
        self.joint.is_limp = True

    def acknowledge(self, op: str, *, error: str = "") -> Message | None:
        """Answer a command that is no read, in mode 2."""
        if self.memory.raw["feedback_return_mode"] != 2:
            return None
        return self.answer(op, error=error)

    def load(self, address: int, length: int) -> Message | None:
        """Answer a Load Data, in mode 1 and 2; beyond the map there is nothing to tell."""
        if not self.memory.raw["feedback_return_mode"]:
            return None
        if address + length > MAP_END:
            return self.answer(COMMANDS[LOAD].name, error="range")
        self.measure()
        values = self.memory.values(self.servo_id, address, length)
        return self.answer(COMMANDS[LOAD].name, self.memory.read(address, length), values)

    def stage(self, name: str, raw: int) -> None:
        """Keep a value until it is told to take effect."""
        self.staged.append((name, raw))
        self.memory.raw["received_data"] = 1

    def execute(self) -> Message | None:
        """Let staged values take effect; without any that is an error."""
        error = "instruction" if not self.staged else self._beyond(dict(self.staged))
        for name, raw in self.staged:
            self.store(name, raw)
        self.staged.clear()
        self.memory.raw["received_data"] = 0
        return self.acknowledge(COMMANDS[EXECUTE].name, error=error)

    def _beyond(self, values: Mapping[str, int]) -> str:
        """Name the error of a goal outside the stroke limits: it is taken, and not reached."""
        goal, raw = values.get("goal_position"), self.memory.raw
        if goal is None:
            return ""
        counts = goal * (TOP + 1) // (self.top + 1)  # limits are in the finest resolution
        inside = raw["short_stroke_limit"] <= counts <= raw["long_stroke_limit"]
        return "" if inside else "stroke_limit"

    def store(self, name: str, raw: int) -> None:
        """Take a value; the motor follows."""
        self.memory.raw[name] = raw
        if name in ("force_on", "goal_speed"):  # a goal speed of 0 is force off
            told = self.memory.raw
            self.joint.enabled = bool(told["force_on"] and told.get("goal_speed", 1))
            self.joint.is_limp &= not self.joint.enabled
        elif name == "goal_position":
            limits = (self.memory.raw[f"{end}_stroke_limit"] / TOP for end in ("short", "long"))
            short, long = limits
            self.joint.goal = max(min(raw / self.top, long), short)
        # a joint whose motor is gone stays limp whatever it is told, but for the force itself
        if self.memory.register("force_on").on_with == name and not self.joint.is_limp:
            self.store("force_on", 1)

    def store_own(self, address: int, targets: Mapping[int, bytes]) -> None:
        """Take what is meant for it."""
        data = targets.get(self.servo_id, b"")
        if data and not self._refuses(address, data):
            for name, raw in self.memory.written(address, data).items():
                self.store(name, raw)

    def _refuses(self, address: int, data: bytes) -> bool:
        """Tell whether a write leaves the map, or a value its range; a goal may."""
        values = self.memory.written(address, data)
        bounded = {name: raw for name, raw in values.items() if name != "goal_position"}
        return address + len(data) > MAP_END or not self.memory.allows(bounded)

    def take(self, code: int, address: int, data: bytes) -> Message | None:
        """Obey a write from an address on, unless it leaves the map or a value its range."""
        op = COMMANDS[code].name
        if self._refuses(address, data):
            return self.acknowledge(op, error="range")
        values = self.memory.written(address, data)
        if self.memory.raw.get("lock"):
            registers = {name: self.memory.register(name) for name in values}
            values = {name: raw for name, raw in values.items() if registers[name].volatile}
        # by the mode in force when the command came
        answer = self.acknowledge(op, error=self._beyond(values) if code == STORE else "")
        for name, raw in values.items():
            self.store(name, raw) if code == STORE else self.stage(name, raw)
        return answer

    def restart(self, op: str) -> Message | None:
        """Begin anew."""
        answer = self.acknowledge(op)
        self.power_on()
        return answer

    def clear(self, op: str, option: int) -> Message | None:
        """Begin anew as shipped; bits of ``option`` say whether id and baud rate are so, too."""
        answer = self.acknowledge(op)
        held = {"servo_id": not option & OPTION_ID, "baud_rate": not option & OPTION_BAUD}
        kept = {name: self.memory.raw[name] for name, holds in held.items() if holds}
        self.memory.reset(volatile_only=False)
        self.memory.raw |= kept
        self.power_on()
        return answer
