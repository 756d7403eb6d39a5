"""What a simulated bus is made of: messages, exchanges, servos with registers, a controller's loop.

A bus is a generator of steps: it yields an ``Exchange`` or a ``Wait`` and is sent whether a good
answer came. It knows no line, no baud rate and no faults: ``buses.simulate`` puts it on a wire.
"""

from __future__ import annotations

import abc
import random
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final

from sniffer.model import KINDS, NS
from sniffer.registers import TYPES, Register, RegisterMap
from sniffer.simulation.motion import Joint, Rig, trajectory

REQUEST, RESPONSE = KINDS
NOISE: Final = "noise"
MS: Final = NS // 1000
US: Final = NS // 1_000_000

Value = tuple[int, str, int]
"""What a frame states about a register: (servo id, register name, raw)."""


@dataclass(frozen=True, slots=True)
class TrueFrame:
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


@dataclass(frozen=True, slots=True)
class Message:
    """A frame about to be said; the ``servo_id`` is the one a decoder can read from it."""

    data: bytes
    servo_id: int
    op: str
    values: tuple[Value, ...] = ()


class Servo:
    """One servo: a joint and, in the protocols that have them, registers."""

    def __init__(self, servo_id: int, joint: Joint, rig: Rig) -> None:
        self.servo_id = servo_id
        self.joint = joint
        self.rig = rig
        self.deaf_until_ns = 0
        self.low_until_ns = 0
        self.power_on()

    def power_on(self) -> None:
        """Take the state a servo has after power-on: the motor is off."""
        self.joint.enabled = False
        self.joint.sag = 0.0

    @property
    def low(self) -> bool:
        """Tell whether the supply is below what the servo accepts."""
        return self.joint.sag > 0

    @property
    def voltage(self) -> float:
        """The voltage that reaches the servo."""
        return self.rig.voltage_at(self.joint)


@dataclass(frozen=True, slots=True)
class Exchange:
    """A request, who obeys it, and what each of them does and answers.

    ``act`` is called for every servo that hears the request; only where ``to`` is one servo does
    its answer go on the line. ``patience_ns`` is how long the controller waits for the answer.
    """

    request: Message
    to: tuple[int, ...]
    act: Callable[[Any], Message | None]
    turnaround_ns: int = 0
    patience_ns: int = 0


@dataclass(frozen=True, slots=True)
class Wait:
    """The controller says nothing until then, in nanoseconds since the bus was switched on."""

    until_ns: int


Talk = Generator[Exchange | Wait, bool, None]
Ask = Generator[Exchange | Wait, bool, bool]


class Bus(abc.ABC):
    """One controller and its servos; a protocol fills in the class variables and ``talk``."""

    name: ClassVar[str]
    baud: ClassVar[int]
    rate_hz: ClassVar[int]
    servo_ids: ClassVar[tuple[int, ...]]
    supply_v: ClassVar[float]
    late_ns: ClassVar[tuple[int, int]]
    """How long a late answer takes: beyond the window, within the controller's patience."""
    pause_ns: ClassVar[tuple[int, int]]
    """What the controller lets pass between two exchanges."""
    servo_type: ClassVar[type[Servo]]
    servos: Mapping[int, Servo]

    def __init__(self, seed: int, *, baud: int, rate_hz: int, servo_ids: Sequence[int]) -> None:
        self.bits_per_s = baud
        self.cycle_ns = NS // rate_hz
        self.rng = random.Random(f"{self.name} controller {seed}")
        rng = random.Random(f"{self.name} motion {seed}")
        self.goals = {i: trajectory(rng) for i in servo_ids}
        joints = [Joint(rng, self.goals[i](0.0)) for i in servo_ids]
        # a twin of each servo, for the day when two share an id: the same goal, other mechanics
        twins = [Joint(rng, self.goals[i](0.0) + rng.uniform(-0.01, 0.01)) for i in servo_ids]
        self.rig = Rig([*joints, *twins], self.supply_v)
        kind = self.servo_type
        pairs = zip(servo_ids, joints, strict=True)
        self.servos = {i: kind(i, joint, self.rig) for i, joint in pairs}
        pairs = zip(servo_ids, twins, strict=True)
        self.twins: Mapping[int, Servo] = {i: kind(i, joint, self.rig) for i, joint in pairs}
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

    def goal(self, servo_id: int) -> float:
        """Return where a servo is to be now, 0..1."""
        return self.goals[servo_id](self.now_ns / NS)


def pack(kind: str, raw: int) -> bytes:
    """Return a register's bytes; ``kind`` as the register tables name it."""
    dtype = TYPES[kind]
    return raw.to_bytes(
        dtype.itemsize, "big" if dtype.byteorder == ">" else "little", signed=dtype.kind == "i"
    )


class Memory:
    """A servo's registers by name, read and written in spans of bytes by the model's table."""

    def __init__(self, table: RegisterMap) -> None:
        self.table = table
        self.raw: dict[str, int] = {}
        self.reset(volatile_only=False)

    def reset(self, *, volatile_only: bool) -> None:
        """Take the defaults of the table, zero where it has none."""
        for register in self.table.registers:
            if register.volatile or not volatile_only:
                self.raw[register.name] = register.default or 0

    def register(self, name: str) -> Register:
        """Return a register's entry in the table."""
        return self.table.registers[self.table.index[name] - self.table.first]

    def put(self, name: str, value: float) -> None:
        """Set a register to ``value`` in its unit, as its table codes it, within its range."""
        r = self.register(name)
        raw = round(value / r.scale)
        if r.sign_bit is not None:
            top = (1 << r.sign_bit) - 1
            raw = min(abs(raw), top) | (raw > 0) << r.sign_bit
        elif r.range is not None:
            raw = min(max(raw, r.range[0]), r.range[1])
        self.raw[name] = raw

    def read(self, address: int, length: int) -> bytes:
        """Return the bytes of a span; those of no register are zero."""
        out = bytearray(length)
        for e in self.table.span(address, length):
            r = self.table.registers[e.register - self.table.first]
            data = pack(r.type, self.raw[r.name])
            if e.part:
                at = address + e.at - r.address
                data = data[at : at + 1]
            out[e.at : e.at + len(data)] = data
        return bytes(out)

    def values(self, servo_id: int, address: int, length: int) -> tuple[Value, ...]:
        """Return what a span of whole registers states."""
        entries = self.table.span(address, length)
        names = [self.table.registers[e.register - self.table.first].name for e in entries]
        return tuple((servo_id, name, self.raw[name]) for name in names)
