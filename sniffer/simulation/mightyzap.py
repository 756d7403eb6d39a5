"""A mightyZAP bus: goals to all by Symmetric Store, the present_* block of each by Load Data.

Sources of times: user manual v1.02, Data Map 0x05 (return delay), and the vendor's guide for
controllers (e-Manual: 5 ms between writes, 10 ms around reads; clients give up after 20 ms).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from sniffer.ground.model import MALFORMED, MS, UNKNOWN
from sniffer.protocols.mightyzap.grammar import (
    BROADCAST,
    COMMANDS,
    ECHO,
    EXECUTE,
    HEADER,
    LOAD,
    MODELS,
    SEND,
    STAND_ALONE,
    STORE,
    SYMMETRIC,
    SYMMETRIC_STORE,
)
from sniffer.simulation.memory import pack
from sniffer.simulation.mightyzap_servo import TOP, MightyZapServo, command
from sniffer.simulation.talk import (
    US,
    Ask,
    Broken,
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


PATIENCE_NS: Final = 20 * MS

PRESENT: Final = ("present_position", ("present_temperature", "present_voltage"))
"""First and last register of the block that the controller polls; the last one that a model has."""

READS: Final = (COMMANDS[ECHO].name, COMMANDS[LOAD].name)

LONGEST_LOAD: Final = 253
"""Bytes that SIZE, which also counts error and checksum, has room for."""


class MightyZapBus(Bus):
    """See the module."""

    name = "mightyzap"
    ids = range(254)
    most = 83
    baud = 57600
    rate_hz = 25
    servo_ids = (1, 2, 3)
    supply_v = 12.2
    late_ns = (12 * MS, 18 * MS)
    pause_ns = (300 * US, 900 * US)
    lags_ns = (2 * MS, 7 * MS)
    begins = HEADER
    servo_type = MightyZapServo
    tables = by_model(MODELS)
    servos: Mapping[int, MightyZapServo]

    def start(self) -> Talk:
        """Ping, read the non-volatile registers, choose the return mode, switch on."""
        for servo_id in self.servos:
            yield self._exchange(command(servo_id, ECHO), lambda s: s.answer(COMMANDS[ECHO].name))
        for servo_id in self.servos:
            yield self._load(servo_id, "model_number", "punch_initial_value", "current_limit")
        last = max(self.servos)
        for servo_id in self.servos:
            # one servo answers reads only, as the newer models do from the factory
            mode = 1 if servo_id == last else 2
            yield self._store(servo_id, "feedback_return_mode", mode)
            yield from self.enable(servo_id)

    def enable(self, servo_id: int) -> Talk:
        """Switch the force on at a modest speed."""
        yield self._store(servo_id, self._speed(servo_id), 600)
        yield self._store(servo_id, "force_on", 1)

    def command(self, cycle: int) -> Talk:
        """Send goals to all at once."""
        del cycle
        goals = {i: round(self.goal(i) * TOP) for i in self.servos}
        register = self.table.register("goal_position")
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

        yield Delivery(request, tuple(self.servos), act)

    def _speed(self, servo_id: int) -> str:
        """Return the name that a model has for the speed of its moves."""
        has = self.servos[servo_id].memory.has
        return next(name for name in ("moving_speed", "goal_speed") if has(name))

    def poll(self, servo_id: int, cycle: int) -> Ask:
        """Read position, speed, load, voltage and temperature in one go, or what there is of it."""
        del cycle
        first, last = PRESENT
        return (yield self._load(servo_id, first, *last))

    def extra(self, cycle: int) -> Talk:
        """Look at the rest now and then: limits, moving; a staged write to one servo."""
        servo_id = self.rng.choice(list(self.servos))
        if cycle % 10 == 4:
            yield self._load(servo_id, "moving", "lock", "moving")
        elif cycle % 25 == 11:
            raw = self.rng.randrange(300, 1000)
            if (yield self._write(servo_id, SEND, self._speed(servo_id), raw)):
                yield self._exchange(command(servo_id, EXECUTE), lambda s: s.execute())
        elif cycle % 25 == 21:
            yield self._store(servo_id, "led", self.rng.choice((0, 2, 4, 8)))
        elif cycle % 50 == 47:
            yield self._load(servo_id, "goal_position", "force_limit", "goal_current")

    def refused(self, servo: MightyZapServo, request: Message) -> Message | None:
        """Refuse a write as one out of range."""
        return None if request.op in READS else servo.acknowledge(request.op, error="range")

    def keep(self, servo_id: int, turn: int) -> Delivery:
        """Write a gain."""
        memory = self.servos[servo_id].memory
        name = next(name for name in ("p_gain", "current_p_gain") if memory.has(name))
        return self._store(servo_id, name, 50 + turn % 20)

    def heard(self, frame: HeardFrame, request: Message) -> Delivery:
        """Obey any command; all servos obey the ids 0 and 254, and none answers the latter.

        Echo and Load Data are for the servo of that very id, also where it is 0.
        Source: user manual v1.02, (2) 2. ID.
        """
        alone = frame.servo_id == STAND_ALONE and request.op not in READS
        everyone = alone or frame.servo_id == BROADCAST
        to = [i for i in self.servos if everyone or i == frame.servo_id]
        act = self._obedience(frame, request)
        if act is None or not to:
            return unheeded(request)
        if frame.servo_id == BROADCAST:
            return Delivery(request, tuple(to), silently(act))
        delay = self.servos[to[0]].memory.raw.get("return_delay_time", 0) * US
        return Delivery(request, tuple(to), act, delay, chorus=everyone)

    def damaged(self, data: bytes, at: int) -> Broken | None:
        """Let whom a packet seems to be for complain if its checksum is wrong.

        Source: user manual v1.02, (2) Feedback Packet, 4. ERROR, bit 4.
        """
        servo_id, size, code = (*data[at + 3 : at + 6], 0, 0, 0)[:3]
        end = at + len(HEADER) + 2 + size
        whole = data.startswith(HEADER, at) and size >= 2 and end <= len(data)
        if not whole or servo_id not in self.servos:
            return None
        return Broken(end, self._refusal(servo_id, reads=code == LOAD))

    def _refusal(self, servo_id: int, *, reads: bool) -> Delivery:
        def act(servo: MightyZapServo) -> Message | None:
            asked = 1 if reads else 2
            told = servo.memory.raw["feedback_return_mode"] >= asked
            return servo.answer("", error="checksum") if told else None

        delay = self.servos[servo_id].memory.raw.get("return_delay_time", 0) * US
        return Delivery(Message(b"", servo_id, ""), (servo_id,), act, delay)

    @staticmethod
    def _obedience(
        frame: HeardFrame, request: Message
    ) -> Callable[[MightyZapServo], Message | None] | None:
        """Return what a servo does about a command, None if it makes nothing of it."""
        if frame.flags & MALFORMED:
            return None
        if frame.flags & UNKNOWN:
            return lambda s: s.acknowledge(request.op, error="instruction")
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
                return lambda s: s.restart(request.op)
            case "factory_reset" | "mightyzap_factory_reset":
                return lambda s: s.clear(request.op, frame.data[0])
            case "symmetric_store":
                told = SYMMETRIC.parse(bytes([frame.address]) + frame.data)
                targets = {t.servo_id: t.data for t in told.targets}
                return lambda s: s.store_own(frame.address, targets)
        return None

    def _exchange(self, request: Message, act: Callable[[Any], Message | None]) -> Delivery:
        memory = self.servos[request.servo_id].memory
        answered = request.op in READS or memory.raw["feedback_return_mode"] == 2
        patience = PATIENCE_NS if answered else 0
        delay = memory.raw.get("return_delay_time", 0) * US
        return Delivery(request, (request.servo_id,), act, delay, patience)

    def _load(self, servo_id: int, first: str, *last: str) -> Delivery:
        """Read from one register to another: to the first of ``last`` that the model has."""
        memory = self.servos[servo_id].memory
        a, z = memory.register(first), memory.register(next(filter(memory.has, last)))
        length = z.address + z.width - a.address
        request = command(servo_id, LOAD, address=a.address, length=length)
        return self._exchange(request, lambda s: s.load(a.address, length))

    def _store(self, servo_id: int, name: str, raw: int) -> Delivery:
        return self._write(servo_id, STORE, name, raw)

    def _write(self, servo_id: int, code: int, name: str, raw: int) -> Delivery:
        register = self.servos[servo_id].memory.register(name)
        value = (servo_id, name, raw)
        data = pack(register.type, raw)
        request = command(servo_id, code, (value,), address=register.address, data=data)

        def act(servo: MightyZapServo) -> Message | None:
            answer = servo.acknowledge(request.op)  # by the mode in force when the command came
            servo.store(name, raw) if code == STORE else servo.stage(name, raw)
            return answer

        return self._exchange(request, act)
