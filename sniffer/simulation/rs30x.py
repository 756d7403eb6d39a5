"""An RS30x bus: goals and times to all by long packets, the block 42..59 of each by nibble 9.

Source of times: RS305CR manual, 4.2 No. 7, return delay: 100 us + 50 us * n behind the request.
What is written to the ROM area holds at once, but for the baud rate, and survives a restart only if
a flash write came before it. Source: RS305CR manual, table 4.1, bits 6 to 4.
"""

from __future__ import annotations

import functools
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

from sniffer.ground.model import MALFORMED, UNKNOWN
from sniffer.protocols.rs30x.grammar import (
    ACK,
    ACK_BYTE,
    ACK_TOKEN,
    ASKS_ACK,
    ASKS_ADDRESS,
    EVERYONE,
    FLAGS,
    LONG,
    LONG_WRITE,
    MODELS,
    NO_TOKEN,
    OPS,
    PACKET,
    READ,
    REPLIES,
    RETURN,
    WRITE,
    long_data,
)
from sniffer.simulation.memory import Memory, pack
from sniffer.simulation.talk import (
    MS,
    US,
    Ask,
    Bus,
    Delivery,
    HeardFrame,
    Message,
    Servo,
    Talk,
    by_model,
    silently,
    unheeded,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sniffer.ground.registers import RegisterMap
    from sniffer.simulation.motion import Joint, Rig

PATIENCE_NS: Final = 30 * MS
"""How long the controller waits for an answer, a figure of the simulation."""

DELAY_NS, DELAY_STEP_NS = 100 * US, 50 * US
TRAVEL: Final = 2400
"""Tenths of a degree between the ends that the simulated trajectories use, of 3000."""

IDENTITY, PRESENT, GOALS = 0x3, 0x9, 0xB
"""Reply nibbles that the controller asks for. Source: RS305CR manual, table 4.2."""


KEPT: Final = 1 << 14
"""Packets that are not built anew: a bus repeats itself."""

SHIPPED: Final[Mapping[str, int]] = MappingProxyType(
    {"firmware_version": 3, "punch": 180, "servo_id": 1}
)
"""Registers for which a table has no default; the id is that of a factory reset."""

ROM: Final = range(0x04, 0x1E)
"""Addresses that a flash write keeps and a factory reset clears. Source: RS305CR manual, bit 4."""


@functools.cache
def flag_byte(reply: int = 0) -> int:
    """Return the FLAG byte of a request that asks for a reply and commands nothing else."""
    bits = {"unused": 0, "flash_write": 0, "reboot": 0, "factory_reset": 0, "reply": reply}
    return int(FLAGS.build(bits)[0])


@functools.lru_cache(KEPT)
def request(
    servo_id: int, flags: int, address: int, length: int, count: int, data: bytes = b""
) -> bytes:
    """Build a short or a long packet."""
    body = {"servo_id": servo_id, "flags": flags, "address": address}
    body |= {"length": length, "count": count}
    return bytes(PACKET.build({"body": {"value": {**body, "data": data}}}))


@functools.lru_cache(KEPT)
def returned(servo_id: int, address: int, data: bytes) -> bytes:
    """Build a return packet."""
    body = {"servo_id": servo_id, "flags": 0, "address": address, "length": len(data), "count": 1}
    return bytes(RETURN.build({"body": {"value": {**body, "data": data}}}))


@functools.lru_cache(KEPT)
def joined(length: int, servos: tuple[tuple[int, bytes], ...]) -> bytes:
    """Build the data of a long packet from pairs of servo and data."""
    parts = [{"servo_id": i, "data": data} for i, data in servos]
    return bytes(long_data(length).build({"servos": parts}))


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

    @property
    def new_id(self) -> int:
        """The id register."""
        return self.memory.raw["servo_id"]

    def give(self, address: int, length: int, op: str = OPS[READ]) -> Message:
        """Answer with a return packet."""
        self.measure()
        built = returned(self.servo_id, address, self.memory.read(address, length))
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

    def _follow(self) -> None:
        self.joint.enabled = self.memory.raw["torque_enable"] == 1
        if self.joint.enabled:
            self.joint.goal = self.memory.raw["goal_position"] / TRAVEL + 0.5


ACKNOWLEDGED: Final = bytes(ACK.build({"answer": ACK_BYTE}))


def tenths(position: float) -> int:
    """Return the register value, 0.1 degrees, of a place 0..1."""
    return round((position - 0.5) * TRAVEL)


class Rs30xBus(Bus):
    """See the module."""

    name = "rs30x"
    ids = range(1, 128)
    most = 50
    baud = 115200
    rate_hz = 50
    servo_ids = (1, 2, 5)
    supply_v = 7.4
    late_ns = (14 * MS, 24 * MS)  # return delay 255 would be 12.85 ms
    pause_ns = (150 * US, 500 * US)
    servo_type = Rs30xServo
    tables = by_model(MODELS)
    servos: Mapping[int, Rs30xServo]

    def start(self) -> Talk:
        """Read the fixed and the ROM area, set compliance and delays, switch the torque on."""
        for servo_id in self.servos:
            yield self._read(servo_id, IDENTITY)
        soft = ("cw_compliance_margin", "ccw_compliance_margin")
        slope = ("cw_compliance_slope", "ccw_compliance_slope")
        values = dict.fromkeys(soft, 3) | dict.fromkeys(slope, 20) | {"punch": 100}
        for servo_id in self.servos:
            yield self._write(servo_id, values, 0)
        yield self._write(max(self.servos), {"return_delay": 4}, ASKS_ACK)
        for servo_id in self.servos:
            yield from self.enable(servo_id)

    def enable(self, servo_id: int) -> Talk:
        """Switch the torque on, and have it acknowledged."""
        yield self._write(servo_id, {"torque_enable": 1}, ASKS_ACK)

    def command(self, cycle: int) -> Talk:
        """Send goal and time to all in one long packet."""
        time = 10 if not cycle else self.cycle_ns // (10 * MS)
        goals = {i: {"goal_position": tenths(self.goal(i)), "goal_time": time} for i in self.servos}
        address, _ = self._span(next(iter(goals.values())))
        servos = tuple((i, self._data(v)) for i, v in goals.items())
        length = 1 + len(servos[0][1])
        built = request(LONG, flag_byte(), address, length, len(servos), joined(length, servos))
        values = tuple((i, name, raw) for i, v in goals.items() for name, raw in v.items())
        yield Delivery(
            Message(built, LONG, OPS[LONG_WRITE], values),
            tuple(self.servos),
            lambda s: s.take(goals[s.servo_id]),
        )

    def poll(self, servo_id: int, cycle: int) -> Ask:
        """Read position, time, speed, current, temperature and voltage in one go."""
        del cycle
        return (yield self._read(servo_id, PRESENT))

    def extra(self, cycle: int) -> Talk:
        """Look at other spans now and then, change the torque limit."""
        servo_id = self.rng.choice(list(self.servos))
        if cycle % 20 == 7:
            position = self.table.register("present_position")
            yield self._read(servo_id, ASKS_ADDRESS, position.address, position.width)
        elif cycle % 20 == 15:
            yield self._read(servo_id, GOALS)
        elif cycle % 50 == 33:
            torque = self.rng.randrange(60, 101, 5)
            reply = self.rng.choice((0, ASKS_ACK))
            yield self._write(servo_id, {"max_torque": torque}, reply)

    def heard(self, frame: HeardFrame, request: Message) -> Delivery:
        """Obey any packet; none answers one to all, or one that resets."""
        long, everyone = frame.op == LONG_WRITE, frame.servo_id == EVERYONE
        to = [i for i in self.servos if long or everyone or i == frame.servo_id]
        act = self._obedience(frame, request)
        if act is None or not to:
            return unheeded(request)
        if long or everyone:
            return Delivery(request, tuple(to), silently(act))
        return Delivery(request, tuple(to), act, self._delay(to[0]))

    @staticmethod
    def _obedience(
        frame: HeardFrame, request: Message
    ) -> Callable[[Rs30xServo], Message | None] | None:
        """Return what a servo does about a packet, None if it does not know it."""
        if frame.flags & (MALFORMED | UNKNOWN):
            return None
        answer = _answer(frame, request.op)

        def write(servo: Rs30xServo) -> Message | None:
            servo.write(frame.address, frame.data)
            return answer(servo)

        match request.op:
            case "read":
                return answer
            case "write":
                return write
            case "long_write":
                targets = _targets(frame.raw)
                return lambda s: s.write(frame.address, targets.get(s.servo_id, b""))
            case "flash_write":
                return lambda s: s.burn()
            case "reboot":
                return lambda s: s.power_on()
            case "factory_reset":
                return lambda s: s.clear()
        return None

    def _span(self, values: Mapping[str, int]) -> tuple[int, int]:
        """Return address and length of registers that lie side by side, in order."""
        registers = [self.table.register(name) for name in values]
        return registers[0].address, sum(r.width for r in registers)

    def _data(self, values: Mapping[str, int]) -> bytes:
        registers = {name: self.table.register(name) for name in values}
        return b"".join(pack(registers[name].type, raw) for name, raw in values.items())

    def _delay(self, servo_id: int) -> int:
        n = self.servos[servo_id].memory.raw["return_delay"]
        return DELAY_NS + n * DELAY_STEP_NS

    def _read(self, servo_id: int, reply: int, address: int = 0, length: int = 0) -> Delivery:
        asked = REPLIES[reply]
        count = 0 if reply == ASKS_ADDRESS else 1
        message = Message(
            request(servo_id, flag_byte(reply), address, length, count), servo_id, OPS[READ]
        )
        if reply != ASKS_ADDRESS:
            address, length = asked.address, asked.length
        return self._exchange(message, lambda s: s.give(address, length), PATIENCE_NS)

    def _write(self, servo_id: int, values: Mapping[str, int], reply: int) -> Delivery:
        address, length = self._span(values)
        built = request(servo_id, flag_byte(reply), address, length, 1, self._data(values))
        told = tuple((servo_id, name, raw) for name, raw in values.items())

        def act(servo: Rs30xServo) -> Message | None:
            servo.take(values)
            return servo.acknowledge(OPS[WRITE]) if reply else None

        message = Message(built, servo_id, OPS[WRITE], told)
        return self._exchange(message, act, PATIENCE_NS if reply else 0)

    def _exchange(
        self, message: Message, act: Callable[[Any], Message | None], patience_ns: int
    ) -> Delivery:
        delay = self._delay(message.servo_id)
        return Delivery(message, (message.servo_id,), act, delay, patience_ns)


def _answer(frame: HeardFrame, op: str) -> Callable[[Rs30xServo], Message | None]:
    """Return what a servo says to the reply bits of a short packet."""
    if frame.token == ACK_TOKEN:
        return lambda s: s.acknowledge(op)
    if frame.token == NO_TOKEN:
        return lambda s: None
    address, length = divmod(frame.token, 256)
    return lambda s: s.give(address, length, op)


def _targets(raw: bytes) -> dict[int, bytes]:
    """Return what a long packet tells each servo."""
    body = PACKET.parse(raw).body.value
    return {t.servo_id: t.data for t in long_data(body.length).parse(body.data).servos}
