"""A wCK bus: goals to all by Synchronized Position Move, load and position of each by Status Read.

Modules with an id above 30 hear the two commands of 10 bits only: a move and a read of each.

Source of times: user's manual 1.07, 2-3, table Command Response Time, less the bytes on the wire;
the time a module is deaf after power-on: the same section, Reset Time after Power Supply.
"""

from __future__ import annotations

import functools
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

from sniffer.ground.model import MS, UNKNOWN
from sniffer.protocols.wck.grammar import (
    COMMANDS,
    INDEX,
    MODELS,
    OPS,
    REPLIES,
    build,
)
from sniffer.simulation import faults
from sniffer.simulation.memory import Memory
from sniffer.simulation.talk import (
    US,
    Ask,
    Bus,
    Delivery,
    HeardFrame,
    Message,
    Servo,
    Talk,
    Value,
    by_model,
    unheeded,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from sniffer.ground.registers import RegisterMap
    from sniffer.simulation.motion import Joint, Rig

TURNAROUND_NS: Final = {
    4800: 659 * US,
    9600: 833 * US,
    38400: 955 * US,
    57600: 312 * US,
    115200: 659 * US,
}
"""By baud rate; the table ends at 115200, faster lines are taken like it."""

EEPROM_NS: Final = 120_451 * US
"""A set command at 115200 bit/s, which writes the EEPROM before it is answered."""

PATIENCE_NS, EEPROM_PATIENCE_NS = 20 * MS, 400 * MS
"""How long the controller waits for an answer: figures of the simulation."""

PASSIVE_AFTER_S: Final = 1.0
"""How long a module is overloaded before it turns passive; the manual names no time."""

FIVE_BITS: Final = 30
"""Greatest id of a command that names it in five bits; 31 is everybody.
Source: manual 1.07, A-1-1."""

TOP, TOP_10BIT = 254, 1022
"""Greatest positions. Source: manual 1.07, 3-1 Position Control, Control Angle."""

ALL: Final = -1
"""What a decoder knows of whom a command to all modules is for."""

TORQUE: Final = 1
"""Torque level of the moves, 0 the greatest, 4 the least."""


KEPT: Final = 1 << 14
"""Commands and replies that are not built anew: a bus repeats itself."""

Items = tuple[tuple[str, Any], ...]
"""A mapping, also one of mappings, as a key of a cache."""


def _items(fields: Mapping[str, Any]) -> Items:
    return tuple((k, _items(v) if isinstance(v, dict) else v) for k, v in fields.items())


@functools.lru_cache(KEPT)
def _command(op: str, fields: Items) -> bytes:
    told = {k: dict(v) if k in ("data1", "data2") else v for k, v in fields}
    return build(op, **told)


@functools.lru_cache(KEPT)
def _reply(op: str, fields: Items) -> bytes:
    return bytes(REPLIES[INDEX[op]].build(dict(fields)))


class WckServo(Servo):
    """Settings and readings of a module by their register names."""

    def __init__(self, servo_id: int, joint: Joint, rig: Rig, table: RegisterMap) -> None:
        self.memory = Memory(table)
        self.memory.raw["servo_id"] = servo_id
        super().__init__(servo_id, joint, rig, table)

    def shipped(self, baud: int) -> None:
        """Come from the factory set to a baud rate."""
        self.memory.choose("baud_rate", str(baud))

    @property
    def new_id(self) -> int:
        """The id register."""
        return self.memory.raw["servo_id"]

    def measure(self) -> None:
        """Fill what is measured."""
        joint, raw = self.joint, self.memory.raw
        raw["position"] = round(joint.position * TOP)
        raw["position_10bit"] = round(joint.position * TOP_10BIT)
        raw["load"] = round(min(abs(joint.load), 1.0) * 200)
        raw["ad_input"] = round(120 + 60 * joint.position)
        raw |= self.seen

    def adopt(self, values: Mapping[str, int]) -> None:
        """Take registers as they were seen."""
        self.memory.adopt(values)

    def place_in(self, values: Mapping[str, int]) -> float | None:
        """Return the position in parts of the travel; the finer one if both are known."""
        for name, top in (("position_10bit", TOP_10BIT), ("position", TOP)):
            if name in values:
                return values[name] / top
        return None

    def guard(self) -> None:
        """Turn passive at an overload. Source: manual 1.07, (18) Over Load Set."""
        if self.joint.strained_s > PASSIVE_AFTER_S:
            self.joint.enabled = False
            self.joint.strained_s = 0.0  # the next move has it try again

    def move(self, goal: float) -> None:
        """Go there."""
        raw = self.memory.raw
        low, high = raw["lower_boundary"] / TOP, raw["upper_boundary"] / TOP
        self.joint.enabled = True
        self.joint.goal = min(max(goal, low), high)

    def obey(self, op: str, values: tuple[Value, ...]) -> None:
        """Do what a command says."""
        told = {name: raw for servo_id, name, raw in values if servo_id == self.servo_id}
        if op in ("passive", "break"):
            self.joint.enabled = False
        elif "goal_position" in told:
            self.move(told["goal_position"] / TOP)
        elif "goal_position_10bit" in told:
            self.move(told["goal_position_10bit"] / TOP_10BIT)
        else:
            self.memory.raw.update(told)

    def answer(self, op: str, *, echo: Mapping[str, int]) -> Message:
        """Answer with the two bytes of the command's reply; ``echo`` is what the command said."""
        self.measure()
        raw = self.memory.raw
        names = OPS[INDEX[op]].reply
        fields: dict[str, int] = {}
        values: list[Value] = []
        if names == ("h3", "l7"):
            fields = split(raw["position_10bit"])
            values = [(self.servo_id, "position_10bit", raw["position_10bit"])]
        for i, name in enumerate(names):
            if name == "again":
                fields[name] = fields[names[i - 1]]
            elif name not in fields:
                fields[name] = raw[name] if name in raw else echo[name]
                if name in raw:
                    values.append((self.servo_id, name, raw[name]))
        return Message(_reply(op, tuple(fields.items())), self.servo_id, op, tuple(values))


def split(position: int) -> dict[str, int]:
    """Return H3 and L7 of a 10-bit position, L7 in bits 7..1. Source: manual 1.07, A-1-4 (26)."""
    return {"h3": position >> 7, "l7": (position & 0x7F) << 1}


class WckBus(Bus):
    """See the module."""

    name = "wck"
    ids = range(254)
    most = 31
    baud = 115200
    rate_hz = 50
    servo_ids = (0, 1, 2, 3)
    supply_v = 8.4
    late_ns = (7 * MS, 15 * MS)
    pause_ns = (100 * US, 400 * US)
    lags_ns = (1500 * US, 3800 * US)
    boot_ns = (65 * MS, 75 * MS)  # Source: manual 1.07, 2-3, Reset Time after Power Supply
    unknown_faults = frozenset({faults.OVERHEAT, faults.REFUSE})
    servo_type = WckServo
    tables = by_model(MODELS)
    servos: Mapping[int, WckServo]

    def start(self) -> Talk:
        """Read the settings; give two modules other ones, which takes an EEPROM write each."""
        reads = ("status_read", "pd_gain_read", "i_gain_read", "speed_read", "overload_read")
        near = self._near()
        for servo_id in near:
            for op in (*reads, "boundary_read"):
                yield self._plain(op, servo_id)
        if not near:
            return
        first, last = min(near), max(near)
        yield self._set("overload_set", first, overload=104)
        yield self._set("pd_gain_set", first, p_gain=24, d_gain=36)
        yield self._set("boundary_set", last, lower_boundary=4, upper_boundary=250)
        yield self._set("runtime_pd_gain_set", last, runtime_p_gain=30, runtime_d_gain=40)
        for servo_id in near:
            yield from self.enable(servo_id)

    def _near(self) -> list[int]:
        """Return the ids that five bits reach."""
        return [i for i in self.servos if i <= FIVE_BITS]

    def enable(self, servo_id: int) -> Talk:
        """Choose speed and acceleration, which is not answered; moves switch the motor on."""
        if servo_id > FIVE_BITS:
            return
        yield self._set("runtime_speed_set", servo_id, runtime_speed=18, runtime_acceleration=60)

    def command(self, cycle: int) -> Talk:
        """Send the goals of all modules from 0 to 30 at once, then each of the others its own."""
        del cycle
        near = self._near()
        if near:
            yield self._sync(near)
        for servo_id in self.servos:
            if servo_id > FIVE_BITS:
                yield self._move_10bit(servo_id)

    def _sync(self, near: Sequence[int]) -> Delivery:
        count = max(near) + 1
        targets = [127] * count
        for servo_id in near:
            targets[servo_id] = round(self.goal(servo_id) * TOP)
        fields = {"data1": {"torque_level": TORQUE}, "data2": {"count": count}}
        built = _command("sync_position_move", (*_items(fields), ("targets", tuple(targets))))
        values = tuple(
            value
            for i, target in enumerate(targets)
            for value in ((i, "torque_level", TORQUE), (i, "goal_position", target))
        )

        def act(servo: WckServo) -> None:
            servo.move(targets[servo.servo_id] / TOP)

        return Delivery(Message(built, ALL, "sync_position_move", values), tuple(near), act)

    def poll(self, servo_id: int, cycle: int) -> Ask:
        """Read load and position; beyond five bits, the position only."""
        del cycle
        if servo_id > FIVE_BITS:
            return (yield self._read_10bit(servo_id))
        return (yield self._plain("status_read", servo_id))

    def extra(self, cycle: int) -> Talk:
        """Move single modules, one in 10 bits; use the external port; relax one for a cycle."""
        near = self._near()
        if not near:
            return
        servo_id = self.rng.choice(near)
        if cycle % 20 == 6:
            yield self._move(servo_id)
        elif cycle % 20 == 12:
            yield self._move_10bit(servo_id)
            yield self._read_10bit(servo_id)
        elif cycle % 40 == 18:
            outputs = self.rng.randrange(4)
            yield self._set("io_write", servo_id, digital_output=outputs)
            yield self._plain("io_read", servo_id)
        elif cycle % 40 == 38:
            yield self._passive(servo_id)
        elif cycle % 60 == 30:
            speed = self.rng.randrange(8, 31)
            yield self._set(
                "runtime_speed_set", servo_id, runtime_speed=speed, runtime_acceleration=60
            )

    def keep(self, servo_id: int, turn: int) -> Delivery:
        """Set the gains, which are kept in the EEPROM."""
        return self._set("pd_gain_set", servo_id, p_gain=20 + turn % 10, d_gain=30)

    def heard(self, frame: HeardFrame, request: Message) -> Delivery:
        """Obey any command of the manual; a break is answered by the lowest id."""
        op = request.op
        if frame.flags & UNKNOWN or op not in INDEX:  # packets for the controller among them
            return unheeded(request)
        known, fields = OPS[INDEX[op]], _fields(op, frame.raw)
        everyone = frame.servo_id == ALL
        to = [i for i in sorted(self.servos) if everyone or i == frame.servo_id]
        if not to:
            return unheeded(request)
        # a break names who answers in five bits
        first = to[0] if not everyone or to[0] <= FIVE_BITS else None

        def act(servo: WckServo) -> Message | None:
            servo.obey(op, request.values)
            if not known.reply or servo.servo_id != first:
                return None
            return servo.answer(op, echo={**fields, "id": servo.servo_id})

        return Delivery(request, tuple(to), act, self._delay(op), chorus=everyone)

    def _delay(self, op: str) -> int:
        if OPS[INDEX[op]].slow and not op.startswith("runtime"):
            return EEPROM_NS
        return TURNAROUND_NS.get(self.bits_per_s, TURNAROUND_NS[115200])

    def _exchange(
        self,
        op: str,
        servo_id: int,
        fields: Mapping[str, Any],
        values: Mapping[str, int],
        act: Callable[[WckServo], None] = lambda servo: None,
        echo: Mapping[str, int] = MappingProxyType({}),
    ) -> Delivery:
        known, delay = OPS[INDEX[op]], self._delay(op)
        patience = EEPROM_PATIENCE_NS if delay == EEPROM_NS else PATIENCE_NS

        def obey(servo: WckServo) -> Message | None:
            act(servo)
            return servo.answer(op, echo=echo) if known.reply else None

        told = tuple((servo_id, name, raw) for name, raw in values.items())
        request = Message(_command(op, _items(fields)), servo_id, op, told)
        return Delivery(request, (servo_id,), obey, delay, patience if known.reply else 0)

    def _plain(self, op: str, servo_id: int) -> Delivery:
        """Return a command that says nothing but what it asks for."""
        return self._exchange(op, servo_id, {"data1": {"id": servo_id}, "data2": {}}, {})

    def _set(self, op: str, servo_id: int, **values: int) -> Delivery:
        fields = {"data1": {"id": servo_id}, "data2": {}, **values}
        return self._exchange(
            op, servo_id, fields, values, lambda servo: servo.memory.raw.update(values)
        )

    def _move(self, servo_id: int) -> Delivery:
        target = round(self.goal(servo_id) * TOP)
        values = {"torque_level": TORQUE, "goal_position": target}
        fields = {
            "data1": {"torque_level": TORQUE, "id": servo_id},
            "data2": {"goal_position": target},
        }
        return self._exchange(
            "position_move", servo_id, fields, values, lambda servo: servo.move(target / TOP)
        )

    def _move_10bit(self, servo_id: int) -> Delivery:
        target = round(self.goal(servo_id) * TOP_10BIT)
        halves = {f"target_{name}": byte for name, byte in split(target).items()}
        fields = {"data1": {}, "data2": {}, "id": servo_id, "torque_10bit": 200, **halves}
        values = {"torque_10bit": 200, "goal_position_10bit": target}
        return self._exchange(
            "position_move_10bit",
            servo_id,
            fields,
            values,
            lambda servo: servo.move(target / TOP_10BIT),
        )

    def _read_10bit(self, servo_id: int) -> Delivery:
        fields = {"data1": {}, "data2": {}, "id": servo_id}
        return self._exchange("position_read_10bit", servo_id, fields, {})

    def _passive(self, servo_id: int) -> Delivery:
        fields = {"data1": {"id": servo_id}, "data2": {}}

        def act(servo: WckServo) -> None:
            servo.joint.enabled = False

        data2 = _command("passive", _items(fields))[2]
        return self._exchange("passive", servo_id, fields, {}, act, {"data2": data2})


@functools.lru_cache(KEPT)
def _fields(op: str, raw: bytes) -> Mapping[str, int]:
    """Return the bytes of a command that its reply may repeat."""
    if op == "position_read_10bit":  # two forms, and nothing is repeated
        return {}
    body = COMMANDS[INDEX[op]].parse(raw).body.value
    return {"data2": raw[2], **{k: v for k, v in body.items() if isinstance(v, int)}}
