"""A mightyZAP L12 bus: goals to all by Symmetric Store, the present_* block of each by Load Data.

Sources of times: user manual v1.02, Data Map 0x05 (return delay), and the vendor's guide for
controllers (e-Manual: 5 ms between writes, 10 ms around reads; clients give up after 20 ms).
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any, Final

from sniffer.model import MALFORMED, UNKNOWN
from sniffer.protocols.mightyzap.block import MODELS
from sniffer.protocols.mightyzap.grammar import (
    BROADCAST,
    COMMANDS,
    ECHO,
    EXECUTE,
    FEEDBACK,
    LOAD,
    PACKET,
    SEND,
    STAND_ALONE,
    STORE,
    SYMMETRIC_STORE,
)
from sniffer.simulation.memory import Memory, pack
from sniffer.simulation.talk import (
    MS,
    US,
    Ask,
    Bus,
    Exchange,
    Message,
    Servo,
    Talk,
    Value,
    silently,
    unheeded,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sniffer.protocols.base import SlowFrame
    from sniffer.simulation.motion import Joint, Rig

TABLE: Final = MODELS[0]
PATIENCE_NS: Final = 20 * MS
TOP: Final = 4095
"""Position counts of the full stroke. Source: user manual v1.02, (5) 19) Goal Position."""

OVERLOAD: Final = 0.85
"""Part of the greatest load beyond which the simulated servo complains."""

KEPT: Final = 1 << 14
"""Packets that are not built anew: a bus repeats itself."""

PRESENT: Final = ("present_position", "present_temperature")
"""First and last register of the block that the controller polls."""

READS: Final = (COMMANDS[ECHO].name, COMMANDS[LOAD].name)


LONGEST_LOAD: Final = 253
"""Bytes that SIZE, which also counts error and checksum, has room for."""

SHIPPED: Final = {
    "model_number": 12,
    "firmware_version": 14,
    "lowest_limit_voltage": 70,
    "highest_limit_voltage": 130,
    "short_stroke_pulse_width": 900,
    "d_gain": 40,
    "i_gain": 5,
    "p_gain": 60,
}
"""Registers for which the table has no default."""


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
    return bytes(COMMANDS[code].factors.build(told))


def command(servo_id: int, code: int, values: tuple[Value, ...] = (), **factors: Any) -> Message:
    """Build a command from its factors by name; ``targets`` are pairs of servo and data."""
    built = _factors(code, tuple(factors.items()))
    return Message(packet(servo_id, code, built), servo_id, COMMANDS[code].name, values)


@functools.cache
def error_byte(*errors: str) -> int:
    """Return the error byte of a feedback that reports these."""
    return int(FEEDBACK.build({"error": dict.fromkeys(errors, True), "data": b""})[0])


class MightyZapServo(Servo):
    """Registers of the L12; its answers follow its Feedback Return Mode."""

    def __init__(self, servo_id: int, joint: Joint, rig: Rig) -> None:
        self.memory = Memory(TABLE)
        self.staged: list[tuple[str, int]] = []
        self.memory.raw |= SHIPPED | {"servo_id": servo_id}
        super().__init__(servo_id, joint, rig)

    def power_on(self) -> None:
        """Volatile registers go back to their defaults."""
        super().power_on()
        self.staged.clear()
        self.memory.reset(volatile_only=True)
        self.memory.put("force_limit", self.memory.raw["max_force"])
        self.memory.raw["goal_position"] = round(self.joint.position * TOP)

    def measure(self) -> None:
        """Fill the present_* registers."""
        joint, memory = self.joint, self.memory
        memory.raw["present_position"] = round(joint.position * TOP)
        memory.put("present_speed", 640 * joint.speed)
        memory.put("present_load", 1023 * joint.load)
        memory.put("present_voltage", self.voltage)
        memory.put("present_temperature", joint.temperature)
        memory.raw["moving"] = int(abs(joint.speed) > 0.02)

    @property
    def new_id(self) -> int:
        """The id register."""
        return self.memory.raw["servo_id"]

    def answer(
        self, op: str, data: bytes = b"", values: tuple[Value, ...] = (), *, error: str = ""
    ) -> Message:
        """Build a feedback with the servo's errors of the moment, and that of the command."""
        errors = ["input_voltage"] if self.low else []
        if abs(self.joint.load) > OVERLOAD:
            errors.append("overload")
        if error:
            errors.append(error)
        return Message(packet(self.servo_id, error_byte(*errors), data), self.servo_id, op, values)

    def acknowledge(self, op: str, *, error: str = "") -> Message | None:
        """Answer a command that is no read, in mode 2."""
        if self.memory.raw["feedback_return_mode"] != 2:
            return None
        return self.answer(op, error=error)

    def load(self, address: int, length: int) -> Message | None:
        """Answer a Load Data, in mode 1 and 2."""
        if not self.memory.raw["feedback_return_mode"]:
            return None
        self.measure()
        values = self.memory.values(self.servo_id, address, length)
        return self.answer(COMMANDS[LOAD].name, self.memory.read(address, length), values)

    def stage(self, name: str, raw: int) -> None:
        """Keep a value until it is told to take effect."""
        self.staged.append((name, raw))
        self.memory.raw["received_data"] = 1

    def execute(self) -> Message | None:
        """Let staged values take effect; without any that is an error."""
        nothing = not self.staged
        for name, raw in self.staged:
            self.store(name, raw)
        self.staged.clear()
        self.memory.raw["received_data"] = 0
        return self.acknowledge(COMMANDS[EXECUTE].name, error="instruction" if nothing else "")

    def store(self, name: str, raw: int) -> None:
        """Take a value; the motor follows."""
        self.memory.raw[name] = raw
        if name == "force_on":
            self.joint.enabled = bool(raw)
        elif name == "goal_position":
            self.joint.goal = raw / TOP

    def store_own(self, values: tuple[Value, ...]) -> None:
        """Take those values that are meant for it."""
        for servo_id, name, raw in values:
            if servo_id == self.servo_id:
                self.store(name, raw)

    def take(self, code: int, address: int, data: bytes) -> Message | None:
        """Obey a write from an address on, unless a value is out of its range."""
        op = COMMANDS[code].name
        values = self.memory.written(address, data)
        if not self.memory.allows(values):
            return self.acknowledge(op, error="range")
        answer = self.acknowledge(op)  # by the mode in force when the command came
        for name, raw in values.items():
            self.store(name, raw) if code == STORE else self.stage(name, raw)
        return answer

    def restart(self, op: str, *, shipped: bool) -> Message | None:
        """Begin anew, as shipped but for id and baud rate."""
        answer = self.acknowledge(op)
        if shipped:
            kept = {name: self.memory.raw[name] for name in ("servo_id", "baud_rate")}
            self.memory.reset(volatile_only=False)
            self.memory.raw |= SHIPPED | kept
        self.power_on()
        return answer


class MightyZapBus(Bus):
    """See the module."""

    name = "mightyzap"
    ids = range(1, 254)
    most = 83
    baud = 57600
    rate_hz = 25
    servo_ids = (1, 2, 3)
    supply_v = 12.2
    late_ns = (12 * MS, 18 * MS)
    pause_ns = (300 * US, 900 * US)
    servo_type = MightyZapServo
    servos: Mapping[int, MightyZapServo]

    def start(self) -> Talk:
        """Ping, read the non-volatile registers, choose the return mode, switch on."""
        for servo_id in self.servos:
            yield self._exchange(command(servo_id, ECHO), lambda s: s.answer(COMMANDS[ECHO].name))
        for servo_id in self.servos:
            yield self._load(servo_id, "model_number", "punch_initial_value")
        last = max(self.servos)
        for servo_id in self.servos:
            # one servo answers reads only, as the newer models do from the factory
            mode = 1 if servo_id == last else 2
            yield self._store(servo_id, "feedback_return_mode", mode)
            yield from self.enable(servo_id)

    def enable(self, servo_id: int) -> Talk:
        """Switch the force on at a modest speed."""
        yield self._store(servo_id, "moving_speed", 600)
        yield self._store(servo_id, "force_on", 1)

    def command(self, cycle: int) -> Talk:
        """Send goals to all at once."""
        del cycle
        goals = {i: round(self.goal(i) * TOP) for i in self.servos}
        register = TABLE.registers[TABLE.index["goal_position"]]
        targets = tuple((i, pack(register.type, g)) for i, g in goals.items())
        request = command(
            BROADCAST,
            SYMMETRIC_STORE,
            tuple((i, register.name, raw) for i, raw in goals.items()),
            address=register.address,
            length=register.width,
            targets=targets,
        )

        def act(servo: MightyZapServo) -> None:
            servo.store(register.name, goals[servo.servo_id])

        yield Exchange(request, tuple(self.servos), act)

    def poll(self, servo_id: int, cycle: int) -> Ask:
        """Read position, speed, load, voltage and temperature in one go."""
        del cycle
        return (yield self._load(servo_id, *PRESENT))

    def extra(self, cycle: int) -> Talk:
        """Look at the rest now and then: limits, moving; a staged write to one servo."""
        servo_id = self.rng.choice(list(self.servos))
        if cycle % 10 == 4:
            yield self._load(servo_id, "moving", "lock")
        elif cycle % 25 == 11:
            raw = self.rng.randrange(300, 1000)
            if (yield self._write(servo_id, SEND, "moving_speed", raw)):
                yield self._exchange(command(servo_id, EXECUTE), lambda s: s.execute())
        elif cycle % 25 == 21:
            yield self._store(servo_id, "led", self.rng.choice((0, 2, 4, 8)))
        elif cycle % 50 == 47:
            yield self._load(servo_id, "goal_position", "force_limit")

    def heard(self, frame: SlowFrame, request: Message) -> Exchange:
        """Obey any command; all servos obey the ids 0 and 254, and none answers the latter."""
        everyone = frame.servo_id in (STAND_ALONE, BROADCAST)
        to = [i for i in self.servos if everyone or i == frame.servo_id]
        act = self._obedience(frame, request)
        if act is None or not to:
            return unheeded(request)
        if frame.servo_id == BROADCAST:
            return Exchange(request, tuple(to), silently(act))
        delay = self.servos[to[0]].memory.raw["return_delay_time"] * US
        return Exchange(request, tuple(to), act, delay, chorus=everyone)

    @staticmethod
    def _obedience(
        frame: SlowFrame, request: Message
    ) -> Callable[[MightyZapServo], Message | None] | None:
        """Return what a servo does about a command, None if it does not know it."""
        if frame.flags & (MALFORMED | UNKNOWN):
            return None
        match request.op:
            case "echo":
                return lambda s: s.answer(request.op)
            case "load_data" if frame.token <= LONGEST_LOAD:
                return lambda s: s.load(frame.address, frame.token)
            case "store_data" | "send_data":
                return lambda s: s.take(frame.op, frame.address, frame.data)
            case "execution":
                return lambda s: s.execute()
            case "restart":
                return lambda s: s.restart(request.op, shipped=False)
            case "factory_reset" | "mightyzap_factory_reset":
                return lambda s: s.restart(request.op, shipped=True)
            case "symmetric_store":
                return lambda s: s.store_own(request.values)
        return None

    def _exchange(self, request: Message, act: Callable[[Any], Message | None]) -> Exchange:
        memory = self.servos[request.servo_id].memory
        answered = request.op in READS or memory.raw["feedback_return_mode"] == 2
        patience = PATIENCE_NS if answered else 0
        delay = memory.raw["return_delay_time"] * US
        return Exchange(request, (request.servo_id,), act, delay, patience)

    def _load(self, servo_id: int, first: str, last: str) -> Exchange:
        a, z = (TABLE.registers[TABLE.index[name]] for name in (first, last))
        length = z.address + z.width - a.address
        request = command(servo_id, LOAD, address=a.address, length=length)
        return self._exchange(request, lambda s: s.load(a.address, length))

    def _store(self, servo_id: int, name: str, raw: int) -> Exchange:
        return self._write(servo_id, STORE, name, raw)

    def _write(self, servo_id: int, code: int, name: str, raw: int) -> Exchange:
        register = TABLE.registers[TABLE.index[name]]
        value = (servo_id, name, raw)
        data = pack(register.type, raw)
        request = command(servo_id, code, (value,), address=register.address, data=data)

        def act(servo: MightyZapServo) -> Message | None:
            answer = servo.acknowledge(request.op)  # by the mode in force when the command came
            servo.store(name, raw) if code == STORE else servo.stage(name, raw)
            return answer

        return self._exchange(request, act)
