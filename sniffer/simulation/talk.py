"""What a simulated bus is made of: messages, exchanges, servos with registers, a controller's loop.

A bus is a generator of steps: it yields an ``Delivery`` or a ``Wait`` and is sent whether a good
answer came. It knows no line, no baud rate and no faults: ``buses.simulate`` puts it on a wire.
"""

from __future__ import annotations

import abc
import random
from collections.abc import Callable, Generator, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Final, NamedTuple, Self

from sniffer.ground.codes import KINDS, MEASURED
from sniffer.ground.model import MS, NS
from sniffer.simulation.motion import Joint, Rig, trajectory

if TYPE_CHECKING:
    from sniffer.ground.model import Frames
    from sniffer.ground.registers import RegisterMap

REQUEST, RESPONSE = KINDS
NOISE: Final = "noise"
US: Final = MS // 1000

USUAL: Final[Mapping[int | None, str]] = MappingProxyType({})
"""No servo (and not all of them, None) is of another model than the usual one."""

Value = tuple[int, str, int]
"""What a frame states about a register: (servo id, register name, raw)."""


class TrueFrame(NamedTuple):
    """One frame as it was meant (``data``) and as it was seen on the line (``wire``).

    ``kind`` is request, response or noise; noise has no ``data``. A reply that never came has no
    ``wire``, and both its times are when it was due. ``fault`` names what was done to it, also
    where its bytes stayed whole (a late or a second answer, a servo that reports low voltage).
    """

    t_start_ns: int
    t_end_ns: int
    data: bytes
    wire: bytes
    kind: str
    servo_id: int
    op: str
    fault: str | None = None
    values: tuple[Value, ...] = ()

    @property
    def damaged(self) -> bool:
        """Tell whether the line showed something else than what was meant."""
        return self.wire != self.data


class Message(NamedTuple):
    """A frame about to be said; the ``servo_id`` is the one a decoder can read from it."""

    data: bytes
    servo_id: int
    op: str
    values: tuple[Value, ...] = ()


class HeardFrame(NamedTuple):
    """A frame that a servo hears, in plain numbers; the names are those of ``Frames``."""

    raw: bytes
    kind: int
    servo_id: int
    op: int
    address: int
    data: bytes
    token: int
    flags: int
    reply: int

    @classmethod
    def of(cls, frames: Frames, row: int, said: bytes) -> Self:
        """Return one row; offsets count from the beginning of ``said``."""
        start, first = int(frames.start[row]), int(frames.data_start[row])
        return cls(
            said[start : start + int(frames.length[row])],
            int(frames.kind[row]),
            int(frames.servo_id[row]),
            int(frames.op[row]),
            int(frames.address[row]),
            said[first : first + int(frames.data_length[row])],
            int(frames.token[row]),
            int(frames.flags[row]),
            int(frames.reply[row]),
        )


def by_model(tables: Sequence[RegisterMap]) -> Mapping[str, RegisterMap]:
    """Return register tables by the names of their models."""
    return MappingProxyType({table.model: table for table in tables})


class Servo(abc.ABC):
    """One servo: a joint and, in the protocols that have them, registers."""

    follows: ClassVar[frozenset[str]] = frozenset()
    """Registers that follow from where the joint is going, beside those that are measured."""

    def __init__(self, servo_id: int, joint: Joint, rig: Rig, table: RegisterMap) -> None:
        self.table = table
        self.servo_id = servo_id
        self.joint = joint
        self.rig = rig
        self.deaf_until_ns = 0
        self.low_until_ns = 0
        self.lag_ns = 0
        """How much longer than its protocol says it takes for an answer."""
        self._seen: Mapping[str, int] = {}
        self._seen_at = -1.0
        self.power_on()

    @abc.abstractmethod
    def shipped(self, baud: int) -> None:
        """Come from the factory set to the baud rate of the bus; else nobody would hear it."""

    def power_on(self) -> None:
        """Take the state a servo has after power-on: the motor is off."""
        self.joint.enabled = False
        self.joint.sag = 0.0

    def recall(self, values: Mapping[str, int]) -> None:
        """Be as it was seen last: ``values`` are raw, by register.

        What it measures, it measures as then until its joint moves.
        """
        self.adopt(values)
        place = self.place_in(values)
        if place is not None:
            self.joint.position = self.joint.goal = min(max(place, 0.0), 1.0)
        known = {r.name: r for r in self.table.registers}
        if "present_temperature" in values and "present_temperature" in known:
            heat = known["present_temperature"].scale * values["present_temperature"]
            self.joint.temperature = heat
        if "present_voltage" in values and "present_voltage" in known:
            self.rig.feed(known["present_voltage"].scale * values["present_voltage"])
        measured = {n for n, r in known.items() if r.role == MEASURED and r.quantity}
        measured |= self.follows
        self._seen = {name: raw for name, raw in values.items() if name in measured}
        self._seen_at = self.joint.position

    @property
    def seen(self) -> Mapping[str, int]:
        """What it was seen to measure, as long as its joint has not moved since."""
        return self._seen if self.joint.position == self._seen_at else {}

    @abc.abstractmethod
    def adopt(self, values: Mapping[str, int]) -> None:
        """Take registers as they were seen; its id is its own."""

    @abc.abstractmethod
    def place_in(self, values: Mapping[str, int]) -> float | None:
        """Return where a joint is that measures this, 0..1; None where nothing says so."""

    @abc.abstractmethod
    def guard(self) -> None:
        """Do what the servo does by itself to save its motor, if it is time."""

    def let_go(self) -> None:
        """Lose the joint, whatever the servo is told from now on."""
        self.joint.is_limp = True

    def take_hold(self) -> None:
        """Have the joint again."""
        self.joint.is_limp = False

    @property
    def new_id(self) -> int:
        """The id by which it goes from now on."""
        return self.servo_id

    @property
    def low(self) -> bool:
        """Tell whether the supply is below what the servo accepts."""
        return self.joint.sag > 0

    @property
    def voltage(self) -> float:
        """The voltage that reaches the servo."""
        return self.rig.voltage_at(self.joint)


class Delivery(NamedTuple):
    """A request, who obeys it, and what each of them does and answers.

    ``act`` is called for every servo that hears the request; only where ``to`` is one servo does
    its answer go on the line, or in a ``chorus``, where each answers behind the other.
    ``patience_ns`` is how long the controller waits for the answer.
    """

    request: Message
    to: tuple[int, ...]
    act: Callable[[Any], Message | None]
    turnaround_ns: int = 0
    patience_ns: int = 0
    chorus: bool = False
    is_refused: bool = False


class Broken(NamedTuple):
    """A broken frame that a servo complains of: where it ends, and what the servo does."""

    end: int
    exchange: Delivery


def unheeded(request: Message) -> Delivery:
    """Return the exchange of a request that no servo acts on."""
    return Delivery(request, (), lambda servo: None)


def silently(act: Callable[[Any], Message | None]) -> Callable[[Any], None]:
    """Return what obeys in the same way and answers nothing."""

    def obey(servo: Any) -> None:
        act(servo)

    return obey


class Wait(NamedTuple):
    """The controller says nothing until then, in nanoseconds since the bus was switched on."""

    until_ns: int


Talk = Generator[Delivery | Wait, bool, None]
Ask = Generator[Delivery | Wait, bool, bool]


class Bus(abc.ABC):
    """One controller and its servos; a protocol fills in the class variables and ``talk``."""

    name: ClassVar[str]
    ids: ClassVar[range]
    """Ids that a servo can have and a cycle of the controller can reach."""
    most: ClassVar[int]
    """Servos that fit the frame which sets the goals of all."""
    baud: ClassVar[int]
    rate_hz: ClassVar[int]
    servo_ids: ClassVar[tuple[int, ...]]
    supply_v: ClassVar[float]
    begins: ClassVar[bytes] = b""
    """First bytes of a frame, in protocols whose servos complain of broken ones."""
    late_ns: ClassVar[tuple[int, int]]
    """How long a late answer takes: beyond the window, within the controller's patience."""
    pause_ns: ClassVar[tuple[int, int]]
    """What the controller lets pass between two exchanges."""
    lags_ns: ClassVar[tuple[int, int]]
    """How much longer a slow servo takes, still within what clients wait."""
    boot_ns: ClassVar[tuple[int, int]] = (80 * MS, 300 * MS)
    """How long a servo is deaf when it restarts. Most manuals do not say it: a figure of ours."""
    unknown_faults: ClassVar[frozenset[str]] = frozenset()
    """Kinds of faults that nothing on the line would show: the protocol has no word for them."""
    servo_type: ClassVar[type[Servo]]
    tables: ClassVar[Mapping[str, RegisterMap]]
    """Models that can be played, the usual one first."""
    servos: Mapping[int, Servo]

    def __init__(
        self,
        seed: int,
        *,
        baud: int,
        rate_hz: int,
        servo_ids: Sequence[int],
        models: Mapping[int | None, str] = USUAL,
    ) -> None:
        self.bits_per_s = baud
        self.cycle_ns = NS // rate_hz
        self.rng = random.Random(f"{self.name} controller {seed}")
        rng = random.Random(f"{self.name} motion {seed}")
        self.goals = {i: trajectory(rng) for i in servo_ids}
        joints = [Joint(rng, self.goals[i](0.0)) for i in servo_ids]
        # a twin of each servo, for the day when two share an id: the same goal, other mechanics
        twins = [Joint(rng, self.goals[i](0.0) + rng.uniform(-0.01, 0.01)) for i in servo_ids]
        self.rig = Rig([*joints, *twins], self.supply_v)
        usual = models.get(None, next(iter(self.tables)))
        self.table = self.tables[usual]
        """That of the servos of whom nothing else is said."""
        tables = {i: self.tables[models.get(i, usual)] for i in servo_ids}
        kind = self.servo_type
        pairs = zip(servo_ids, joints, strict=True)
        self.servos = {i: kind(i, joint, self.rig, tables[i]) for i, joint in pairs}
        pairs = zip(servo_ids, twins, strict=True)
        self.twins: Mapping[int, Servo] = {
            i: kind(i, joint, self.rig, tables[i]) for i, joint in pairs
        }
        for servo in (*self.servos.values(), *self.twins.values()):
            servo.shipped(baud)
        self.guests: Mapping[int, Sequence[tuple[Servo, Servo]]] = {}
        """Servos, each with its twin, that were given an id which another one has already."""
        self.now_ns = 0

    def talk(self) -> Talk:
        """Yield what the controller does, for ever."""
        yield from self.start()
        tick = self.now_ns
        cycle = 0
        missed = dict.fromkeys(self.servos, 0)
        while True:
            yield from self.command(cycle)
            for servo_id in self.servos:
                if (yield from self.poll(servo_id, cycle)):
                    back = missed[servo_id] > 2
                    missed[servo_id] = 0
                    if back:  # it was away for a while: its motor may be off
                        yield from self.enable(servo_id)
                else:
                    missed[servo_id] += 1
            yield from self.extra(cycle)
            cycle += 1
            late = max(self.now_ns - tick, 0)
            tick += self.cycle_ns * max(1, -(-late // self.cycle_ns))
            yield Wait(tick)

    @abc.abstractmethod
    def start(self) -> Talk:
        """Yield what the controller says once, before the loop."""

    @abc.abstractmethod
    def enable(self, servo_id: int) -> Talk:
        """Yield what switches one servo on."""

    @abc.abstractmethod
    def command(self, cycle: int) -> Talk:
        """Yield the goals of this cycle."""

    @abc.abstractmethod
    def poll(self, servo_id: int, cycle: int) -> Ask:
        """Yield the reads of one servo; return whether it answered."""

    def extra(self, cycle: int) -> Talk:
        """Yield what the controller does now and then."""
        del cycle
        yield from ()

    @abc.abstractmethod
    def heard(self, frame: HeardFrame, request: Message) -> Delivery:
        """Return what the servos do about a request that another controller sent.

        ``request.values`` are those that the frame states, whole ones.
        """

    def refused(self, servo: Any, request: Message) -> Message | None:
        """Return what a servo says that does not do what it is told; None where it cannot."""
        del servo, request
        return None

    @abc.abstractmethod
    def keep(self, servo_id: int, turn: int) -> Delivery:
        """Return a write of what a servo keeps without power; another value with each turn."""

    def damaged(self, data: bytes, at: int) -> Broken | None:
        """Return what is done about a broken frame at ``at``, where no good one begins.

        None where there is none, and where the protocol lets servos be silent about it.
        """
        del data, at
        return None

    def renumber(self) -> None:
        """Let servos that were given a new id go by it, also beside one that has it already."""
        pairs = [(self.servos[i], self.twins[i]) for i in self.servos]
        pairs += [pair for guests in self.guests.values() for pair in guests]
        if all(self._goes_by(servo) == servo.servo_id for servo, _ in pairs):
            return
        # who had an id before stays the first one
        pairs.sort(key=lambda pair: self._goes_by(pair[0]) != pair[0].servo_id)
        servos: dict[int, Servo] = {}
        twins: dict[int, Servo] = {}
        guests: dict[int, list[tuple[Servo, Servo]]] = {}
        for servo, twin in pairs:
            servo_id = servo.servo_id = twin.servo_id = self._goes_by(servo)
            if servo_id in servos:
                guests.setdefault(servo_id, []).append((servo, twin))
            else:
                servos[servo_id], twins[servo_id] = servo, twin
        self.servos, self.twins, self.guests = servos, twins, guests

    def _goes_by(self, servo: Servo) -> int:
        return servo.new_id if servo.new_id in self.ids else servo.servo_id

    def goal(self, servo_id: int) -> float:
        """Return where a servo is to be now, 0..1."""
        return self.goals[servo_id](self.now_ns / NS)
