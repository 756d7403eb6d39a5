"""An RS305CR bus: goals and times to all by long packets, the block 42..59 of each by nibble 9.

Source of times: RS305CR manual, 4.2 No. 7, return delay: 100 us + 50 us * n behind the request.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from sniffer.protocols.rs30x.block import MODELS
from sniffer.protocols.rs30x.grammar import (
    ACK,
    ACK_BYTE,
    ASKS_ACK,
    ASKS_ADDRESS,
    FLAGS,
    LONG,
    LONG_WRITE,
    OPS,
    PACKET,
    READ,
    REPLIES,
    RETURN,
    WRITE,
    long_data,
)
from sniffer.simulation.talk import (
    MS,
    US,
    Ask,
    Bus,
    Exchange,
    Memory,
    Message,
    Servo,
    Talk,
    Value,
    pack,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sniffer.simulation.motion import Joint, Rig

TABLE: Final = MODELS[0]
PATIENCE_NS: Final = 30 * MS
"""How long the controller waits for an answer, a figure of the simulation."""

DELAY_NS, DELAY_STEP_NS = 100 * US, 50 * US
TRAVEL: Final = 2400
"""Tenths of a degree between the ends that the simulated trajectories use, of 3000."""

IDENTITY, PRESENT, GOALS = 0x3, 0x9, 0xB
"""Reply nibbles that the controller asks for. Source: RS305CR manual, table 4.2."""


def flag_byte(reply: int = 0) -> int:
    """Return the FLAG byte of a request that asks for a reply and commands nothing else."""
    bits = {"unused": 0, "flash_write": 0, "reboot": 0, "factory_reset": 0, "reply": reply}
    return int(FLAGS.build(bits)[0])


def request(
    servo_id: int, flags: int, address: int, length: int, count: int, data: bytes = b""
) -> bytes:
    """Build a short or a long packet."""
    body = {"servo_id": servo_id, "flags": flags, "address": address}
    body |= {"length": length, "count": count}
    return bytes(PACKET.build({"body": {"value": {**body, "data": data}}}))


class Rs305Servo(Servo):
    """The memory map of the RS305CR."""

    def __init__(self, servo_id: int, joint: Joint, rig: Rig) -> None:
        self.memory = Memory(TABLE)
        self.memory.raw |= {"servo_id": servo_id, "firmware_version": 3, "punch": 180}
        super().__init__(servo_id, joint, rig)

    def power_on(self) -> None:
        """Volatile registers go back to their defaults; the torque is off."""
        super().power_on()
        self.memory.reset(volatile_only=True)
        self.memory.raw["max_torque"] = 100

    def measure(self) -> None:
        """Fill the block 42..59."""
        joint, memory = self.joint, self.memory
        memory.raw["present_position"] = tenths(joint.position)
        memory.raw["present_time"] = memory.raw["goal_time"]
        memory.put("present_speed", joint.speed * TRAVEL / 10)
        memory.put("present_current", joint.current_ma)
        memory.put("present_temperature", joint.temperature)
        memory.put("present_voltage", self.voltage)

    def give(self, address: int, length: int) -> Message:
        """Answer with a return packet."""
        self.measure()
        body = {"servo_id": self.servo_id, "flags": 0, "address": address}
        body |= {"length": length, "count": 1}
        data = self.memory.read(address, length)
        built = bytes(RETURN.build({"body": {"value": {**body, "data": data}}}))
        values = self.memory.values(self.servo_id, address, length)
        return Message(built, self.servo_id, OPS[READ], values)

    def take(self, values: tuple[Value, ...]) -> None:
        """Store what is meant for this servo; the motor follows."""
        for servo_id, name, raw in values:
            if servo_id == self.servo_id:
                self.memory.raw[name] = raw
        self.joint.enabled = self.memory.raw["torque_enable"] == 1
        if self.joint.enabled:
            self.joint.goal = self.memory.raw["goal_position"] / TRAVEL + 0.5


def tenths(position: float) -> int:
    """Return the register value, 0.1 degrees, of a place 0..1."""
    return round((position - 0.5) * TRAVEL)


class Rs30xBus(Bus):
    """See the module."""

    name = "rs30x"
    baud = 115200
    rate_hz = 50
    servo_ids = (1, 2, 5)
    supply_v = 7.4
    late_ns = (14 * MS, 24 * MS)  # return delay 255 would be 12.85 ms
    pause_ns = (150 * US, 500 * US)
    servo_type = Rs305Servo
    servos: Mapping[int, Rs305Servo]

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
        servos = [{"servo_id": i, "data": self._data(v)} for i, v in goals.items()]
        length = 1 + len(self._data(next(iter(goals.values()))))
        data = bytes(long_data(length).build({"servos": servos}))
        built = request(LONG, flag_byte(), address, length, len(servos), data)
        values = tuple((i, name, raw) for i, v in goals.items() for name, raw in v.items())
        yield Exchange(
            Message(built, LONG, OPS[LONG_WRITE], values),
            tuple(self.servos),
            lambda s: s.take(values),
        )

    def poll(self, servo_id: int, cycle: int) -> Ask:
        """Read position, time, speed, current, temperature and voltage in one go."""
        del cycle
        return (yield self._read(servo_id, PRESENT))

    def extra(self, cycle: int) -> Talk:
        """Look at other spans now and then, change the torque limit."""
        servo_id = self.rng.choice(list(self.servos))
        if cycle % 20 == 7:
            position = TABLE.registers[TABLE.index["present_position"]]
            yield self._read(servo_id, ASKS_ADDRESS, position.address, position.width)
        elif cycle % 20 == 15:
            yield self._read(servo_id, GOALS)
        elif cycle % 50 == 33:
            torque = self.rng.randrange(60, 101, 5)
            reply = self.rng.choice((0, ASKS_ACK))
            yield self._write(servo_id, {"max_torque": torque}, reply)

    @staticmethod
    def _span(values: dict[str, int]) -> tuple[int, int]:
        """Return address and length of registers that lie side by side, in order."""
        registers = [TABLE.registers[TABLE.index[name]] for name in values]
        return registers[0].address, sum(r.width for r in registers)

    @staticmethod
    def _data(values: dict[str, int]) -> bytes:
        registers = {name: TABLE.registers[TABLE.index[name]] for name in values}
        return b"".join(pack(registers[name].type, raw) for name, raw in values.items())

    def _delay(self, servo_id: int) -> int:
        n = self.servos[servo_id].memory.raw["return_delay"]
        return DELAY_NS + n * DELAY_STEP_NS

    def _read(self, servo_id: int, reply: int, address: int = 0, length: int = 0) -> Exchange:
        asked = REPLIES[reply]
        count = 0 if reply == ASKS_ADDRESS else 1
        message = Message(
            request(servo_id, flag_byte(reply), address, length, count), servo_id, OPS[READ]
        )
        if reply != ASKS_ADDRESS:
            address, length = asked.address, asked.length
        return self._exchange(message, lambda s: s.give(address, length), PATIENCE_NS)

    def _write(self, servo_id: int, values: dict[str, int], reply: int) -> Exchange:
        address, length = self._span(values)
        built = request(servo_id, flag_byte(reply), address, length, 1, self._data(values))
        told = tuple((servo_id, name, raw) for name, raw in values.items())

        def act(servo: Rs305Servo) -> Message | None:
            servo.take(told)
            if not reply:
                return None
            return Message(bytes(ACK.build({"answer": ACK_BYTE})), servo_id, OPS[WRITE])

        message = Message(built, servo_id, OPS[WRITE], told)
        return self._exchange(message, act, PATIENCE_NS if reply else 0)

    def _exchange(
        self, message: Message, act: Callable[[Any], Message | None], patience_ns: int
    ) -> Exchange:
        delay = self._delay(message.servo_id)
        return Exchange(message, (message.servo_id,), act, delay, patience_ns)
