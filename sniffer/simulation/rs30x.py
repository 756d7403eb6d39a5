"""An RS30x bus: goals and times to all by long packets, the block 42..59 of each by nibble 9.

Source of times: RS305CR manual, 4.2 No. 7, return delay: 100 us + 50 us * n behind the request.
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any, Final

from sniffer.ground.model import MALFORMED, MS, UNKNOWN
from sniffer.protocols.rs30x.grammar import (
    ACK_TOKEN,
    ASKS_ACK,
    ASKS_ADDRESS,
    EVERYONE,
    FLAGS,
    FLASH_WRITE,
    LONG,
    LONG_WRITE,
    MODELS,
    NO_TOKEN,
    OPS,
    PACKET,
    READ,
    REPLIES,
    WRITE,
    long_data,
)
from sniffer.simulation.memory import pack
from sniffer.simulation.rs30x_servo import ON, Rs30xServo, tenths
from sniffer.simulation.talk import (
    US,
    Ask,
    Bus,
    Delivery,
    HeardFrame,
    Message,
    Talk,
    by_model,
    silently,
    unheeded,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping


PATIENCE_NS: Final = 30 * MS
"""How long the controller waits for an answer, a figure of the simulation."""

DELAY_NS, DELAY_STEP_NS = 100 * US, 50 * US

IDENTITY, PRESENT, GOALS = 0x3, 0x9, 0xB
"""Reply nibbles that the controller asks for. Source: RS305CR manual, table 4.2."""


KEPT: Final = 1 << 14
"""Packets that are not built anew: a bus repeats itself."""

FLASH_BIT: Final = 1 << 6
"""Flag of a request. Source: RS305CR manual, 4.1, bit 6."""


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
def joined(length: int, servos: tuple[tuple[int, bytes], ...]) -> bytes:
    """Build the data of a long packet from pairs of servo and data."""
    parts = [{"servo_id": i, "data": data} for i, data in servos]
    return bytes(long_data(length).build({"servos": parts}))


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
    lags_ns = (2 * MS, 9 * MS)
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
        yield self._write(servo_id, {"torque_enable": ON}, ASKS_ACK)

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

    def refused(self, servo: Rs30xServo, request: Message) -> Message | None:
        """Refuse a write with the bare byte for that."""
        return servo.refuse(request.op) if request.op == OPS[WRITE] else None

    def keep(self, servo_id: int, turn: int) -> Delivery:
        """Write the ROM area to the flash. Source: RS305CR manual, bit 6."""
        del turn
        built = request(servo_id, FLASH_BIT, 0xFF, 0, 0)
        message = Message(built, servo_id, OPS[FLASH_WRITE])
        return self._exchange(message, lambda servo: servo.burn(), 0)

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
