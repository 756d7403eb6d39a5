"""A Lynxmotion LSS bus: a goal to each servo (D), its position (QD), the other values in turn.

The protocol page gives no times: a servo's turnaround of about 1 ms and the controller's patience
are figures of the simulation, in the range of what client libraries wait.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sniffer.protocols.lss.grammar import MODIFIERS, REGISTERS, WORDS, command, reply
from sniffer.simulation.talk import MS, US, Ask, Bus, Exchange, Message, Servo, Talk, Value

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sniffer.simulation.motion import Joint, Rig

TURNAROUND_NS: Final = 1 * MS
PATIENCE_NS: Final = 200 * MS
TRAVEL: Final = 1800
"""Tenths of a degree: the default angular range. Source: protocol page 106.1, AR."""

LIMP, ACCELERATING, TRAVELING, DECELERATING, HOLDING, SAFE = 1, 3, 4, 5, 6, 10
"""Answers to Q. Source: protocol page 106.1, Query Status."""

TURN: Final = ("QV", "QT", "QC", "Q", "QWD", "QDT")
FACTS: Final = ("QMS", "QN", "QF", "QAR", "QO", "QLED")


class LssServo(Servo):
    """What the servo answers, by word."""

    def __init__(self, servo_id: int, joint: Joint, rig: Rig) -> None:
        self.facts: dict[str, int | str] = {
            "QMS": "LSS-ST1",
            "QN": 12345670 + servo_id,
            "QF": 368,
            "QAR": TRAVEL,
            "QO": 0,
        }
        super().__init__(servo_id, joint, rig)

    def power_on(self) -> None:
        """The session ends: limp, LED as configured."""
        super().power_on()
        self.facts["QLED"] = 7

    def reading(self, word: str) -> int | str:
        """Return what stands behind the word in an answer."""
        joint = self.joint
        speed = joint.speed * TRAVEL
        readings = {
            "QD": tenths(joint.position),
            "QDT": tenths(joint.goal),
            "QWD": round(speed),
            "QV": round(self.voltage * 1000),
            "QT": round(joint.temperature * 10),
            "QC": round(joint.current_ma),
            "Q": self._status(speed),
        }
        return readings.get(word, self.facts.get(word, 0))

    def _status(self, speed: float) -> int:
        if self.low:
            return SAFE
        if not self.joint.enabled:
            return LIMP
        if abs(speed) < 20:
            return HOLDING
        ahead = (self.joint.goal - self.joint.position) * speed
        return DECELERATING if ahead < 0 else TRAVELING if abs(speed) > 300 else ACCELERATING

    def obey(self, word: str, value: int | None) -> None:
        """Do what an action says."""
        if word == "D" and value is not None:
            self.joint.enabled = True
            self.joint.goal = value / TRAVEL + 0.5
        elif word == "L":
            self.joint.enabled = False
        elif word == "LED" and value is not None:
            self.facts["QLED"] = value


def tenths(position: float) -> int:
    """Return tenths of a degree of a place 0..1."""
    return round((position - 0.5) * TRAVEL)


def stated(servo_id: int, register: int, value: int | str | None) -> tuple[Value, ...]:
    """Return what a line says about a register; a text is no value."""
    return ((servo_id, REGISTERS[register].name, value),) if isinstance(value, int) else ()


class LssBus(Bus):
    """See the module."""

    name = "lss"
    baud = 115200
    rate_hz = 50
    servo_ids = (1, 2, 5, 10)
    supply_v = 11.8
    late_ns = (110 * MS, 160 * MS)
    pause_ns = (100 * US, 400 * US)
    servo_type = LssServo
    servos: Mapping[int, LssServo]

    def start(self) -> Talk:
        """Ask who they are, then switch on."""
        for servo_id in self.servos:
            for word in FACTS:
                yield self._ask(servo_id, word)
        for servo_id in self.servos:
            yield self._tell(servo_id, "CSD", 1800)
            yield from self.enable(servo_id)

    def enable(self, servo_id: int) -> Talk:
        """Limit the speed, show a colour, go to the first goal in half a second."""
        yield self._tell(servo_id, "SD", 1800)
        yield self._tell(servo_id, "LED", 2)
        yield self._tell(servo_id, "D", tenths(self.goal(servo_id)), {"T": 500})

    def command(self, cycle: int) -> Talk:
        """Send a goal to each."""
        del cycle
        for servo_id in self.servos:
            yield self._tell(servo_id, "D", tenths(self.goal(servo_id)))

    def poll(self, servo_id: int, cycle: int) -> Ask:
        """Read the position and, in turn, one of the other values."""
        heard = yield self._ask(servo_id, "QD")
        if heard and cycle % 5 == servo_id % 5:
            heard = yield self._ask(servo_id, TURN[cycle // 5 % len(TURN)])
        return heard

    def extra(self, cycle: int) -> Talk:
        """Change a colour now and then, halt one servo."""
        servo_id = self.rng.choice(list(self.servos))
        if cycle % 40 == 25:
            yield self._tell(servo_id, "LED", self.rng.randint(0, 7))
        elif cycle % 60 == 50:
            yield self._tell(servo_id, "H")

    def _ask(self, servo_id: int, word: str) -> Exchange:
        def act(servo: LssServo) -> Message:
            value = servo.reading(word)
            values = stated(servo_id, WORDS[word].selectors[0], value)
            return Message(reply(servo_id, word, value), servo_id, word, values)

        request = Message(command(servo_id, word), servo_id, word)
        return Exchange(request, (servo_id,), act, TURNAROUND_NS, PATIENCE_NS)

    def _tell(
        self,
        servo_id: int,
        word: str,
        value: int | None = None,
        modifiers: Mapping[str, int] = MappingProxyType({}),
    ) -> Exchange:
        values = stated(servo_id, WORDS[word].register, value)
        for modifier, number in modifiers.items():
            values += stated(servo_id, MODIFIERS[modifier].register, number)
        built = command(servo_id, word, value, modifiers)
        request = Message(built, servo_id, word, values)
        return Exchange(request, (servo_id,), lambda servo: servo.obey(word, value))
