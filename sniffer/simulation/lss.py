"""A Lynxmotion LSS bus: a goal to each servo (D), its position (QD), the other values in turn.

The protocol page gives no times: a servo's turnaround of about 1 ms and the controller's patience
are figures of the simulation, in the range of what client libraries wait.
"""

from __future__ import annotations

import functools
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sniffer.ground.model import MALFORMED, UNKNOWN
from sniffer.protocols.lss.grammar import (
    BROADCAST,
    MODELS,
    MODIFIERS,
    REGISTERS,
    SERVO_IDS,
    WORDS,
    command,
    reply,
)
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
    Value,
    by_model,
    unheeded,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sniffer.ground.registers import RegisterMap
    from sniffer.simulation.motion import Joint, Rig

TURNAROUND_NS: Final = 1 * MS
PATIENCE_NS: Final = 200 * MS
TRAVEL_DEG: Final = 180
"""The default angular range. Source: protocol page 106.1, AR."""

PRO: Final = "lss-pro"

MODEL_STRINGS: Final[Mapping[str, str]] = MappingProxyType({"lss": "LSS-ST1", PRO: "LSS-P-S1"})
"""Answers to QMS. Source: protocol page 106.1, Details 20; the register table of the LSS-PRO."""

RPM: Final = 6
"""Degrees per second of one turn a minute."""

TURN: Final = ("QV", "QT", "QC", "Q", "QWD", "QDT")
FACTS: Final = ("QMS", "QN", "QF", "QAR", "QO", "QLED")


KEPT: Final = 1 << 14
"""Lines that are not built anew: a bus repeats itself."""

_reply = functools.lru_cache(KEPT)(reply)


@functools.lru_cache(KEPT)
def _command(
    servo_id: int, word: str, value: int | None, modifiers: tuple[tuple[str, int], ...]
) -> bytes:
    return command(servo_id, word, value, dict(modifiers))


FACTORY_ID: Final = 0
"""Source: protocol page 106.1, Details 16. Identification Number."""

DISABLED: Final = "DIS"
"""Answer of a servo without a first position. Source: the same, Details 18."""

FIRST: Final = ("first_position", "first_position_pulse")
"""Each takes the place of the other. Source: protocol page 106.1, Command List 18 and 19."""

SPEEDS: Final = tuple(
    (f"{kept}{name}", f"{kept}{name}_in_rpm")
    for kept in ("", "configured_")
    for name in ("max_speed",)
)
"""One value in two units: whichever was set last counts. Source: Details 12 and 13, CSD and CSR."""

AWAITING_CONFIRM: Final = ("DEFAULT", "UPDATE")
"""Take effect with CONFIRM; any other command ends them. Source: Details 29 and 30."""

RC_MODES: Final = (1, 2)
"""After a reset the servo hears no serial commands any more, and only its button brings it back.
Source: Details 27. Configure RC Mode."""


class LssServo(Servo):
    """What the servo knows, by the register names of the table."""

    def __init__(self, servo_id: int, joint: Joint, rig: Rig, table: RegisterMap) -> None:
        self._facts: dict[str, int | str] = {
            "model_string": MODEL_STRINGS[table.model],
            "serial_number": 12345670 + servo_id,
            "firmware_version": 368,
        }
        self.model = MODELS.index(table)
        self.per_deg = round(1 / table.register("present_position").scale)
        self.travel = TRAVEL_DEG * self.per_deg
        self._amperes = table.register("present_current").unit == "A"
        self._states = {
            name: code for code, name in table.register("present_status").values.items()
        }
        self._defaults = {r.name: r.default for r in table.registers if r.default is not None}
        self.kept: dict[str, int | str] = self._facts | {"servo_id": servo_id}
        self.session: dict[str, int] = {}
        self.deaf = False
        super().__init__(servo_id, joint, rig, table)

    def shipped(self, baud: int) -> None:
        """Come from the factory set to a baud rate."""
        self.kept["baud_rate"] = baud

    def power_on(self) -> None:
        """The session ends: limp or on the way to the first position, LED as configured."""
        super().power_on()
        self.session.clear()
        self._awaited = ""
        self._id = int(self.kept["servo_id"])
        self.deaf = self.kept.get("rc_mode") in RC_MODES
        for name, value in self.kept.items():
            self._carry_over(name, value)
        first = self.kept.get("first_position")
        if isinstance(first, int):
            self._go(first / self.travel + 0.5)

    def reading(self, name: str) -> int | str:
        """Return what stands behind the word in an answer that states a register."""
        joint = self.joint
        match name:
            case "present_position":
                return self.place(joint.position)
            case "target_position":
                return self.place(joint.goal)
            case "present_speed" | "current_speed":
                return round(joint.speed * self.travel)
            case "present_voltage":
                return round(self.voltage * 1000)
            case "present_temperature" | "motor_temperature" | "mcu_temperature":
                return round(joint.temperature * 10)
            case "present_current":
                return round(joint.current_ma / (1000 if self._amperes else 1))
            case "present_status":
                return self._states.get(self._status(joint.speed * TRAVEL_DEG), 0)
            case "present_speed_in_rpm":
                return round(joint.speed * TRAVEL_DEG / RPM)
            case "present_position_pulse":
                return round(500 + 2000 * joint.position)
            case "target_speed" | "target_speed_in_rpm":
                return self.reading(name.replace("target", "max"))
            case "first_position" | "first_position_pulse":
                return self.kept.get(name, DISABLED)
        if name in self.session:
            return self.session[name]
        return self.kept.get(name, self._defaults.get(name, 0))

    def place(self, position: float) -> int:
        """Return the number for a place 0..1, in parts of a degree."""
        return round((position - 0.5) * self.travel)

    def _status(self, speed_deg_s: float) -> str:
        """Name the state, as the tables name the answers to Q."""
        if self.low:
            return "safe_mode" if "safe_mode" in self._states else "error"
        if not self.joint.enabled:
            return "limp"
        if abs(speed_deg_s) < 2:
            return "holding"
        ahead = (self.joint.goal - self.joint.position) * speed_deg_s
        fast = abs(speed_deg_s) > 30
        return "decelerating" if ahead < 0 else "traveling" if fast else "accelerating"

    def obey(self, word: str, values: tuple[Value, ...]) -> None:
        """Do what an action or a configuration says."""
        told = {name: value for _, name, value in values}
        for by_degrees, by_turns in SPEEDS:
            if by_degrees in told:
                told[by_turns] = round(told[by_degrees] / (RPM * self.per_deg))
            elif by_turns in told:
                told[by_degrees] = told[by_turns] * RPM * self.per_deg
        awaited, self._awaited = self._awaited, word if word in AWAITING_CONFIRM else ""
        match word:
            case "CONFIRM":
                self._confirmed(awaited)
            case "D" if "goal_position" in told:
                self._go(told["goal_position"] / self.travel + 0.5)
            case "MD" if "relative_move" in told:
                self._go(self.joint.position + told["relative_move"] / self.travel)
            case "P" if "goal_position_pulse" in told:
                self._go((told["goal_position_pulse"] - 500) / 2000)
            case "L":
                self.joint.enabled = False
            case "RESET":
                self.power_on()
            case "CFD" | "CFP":
                for name in FIRST:
                    self.kept.pop(name, None)
                self.kept |= told
            case _ if WORDS[word].kind == "configuration":
                self.kept |= told
                for name, value in told.items():
                    self._carry_over(name, value)
            case _:
                self.session |= told

    def asked(self) -> None:
        """Hear a query: whatever waits for its confirmation does not any more."""
        self._awaited = ""

    def _confirmed(self, word: str) -> None:
        if word == "DEFAULT":
            # the line keeps its rate: at the one of the factory nobody would hear it any more
            rate = self.kept["baud_rate"]
            self.kept = self._facts | {"servo_id": FACTORY_ID, "baud_rate": rate}
        if word in AWAITING_CONFIRM:
            self.power_on()

    def halt(self) -> None:
        """Stay where it is."""
        self._awaited = ""
        self._go(self.joint.position)

    @property
    def new_id(self) -> int:
        """The id since the last power-on."""
        return self._id

    def _go(self, goal: float) -> None:
        self.joint.enabled = True
        self.joint.goal = goal

    def _carry_over(self, name: str, value: int | str) -> None:
        """Let a value that is kept count for the session as well; a new id waits for the next."""
        session = name.removeprefix("configured_")
        if session != name and isinstance(value, int):
            self.session[session] = value


def stated(servo_id: int, register: int, value: int | str | None) -> tuple[Value, ...]:
    """Return what a line says about a register; a text is no value."""
    return ((servo_id, REGISTERS[register].name, value),) if isinstance(value, int) else ()


class LssBus(Bus):
    """See the module."""

    name = "lss"
    ids = SERVO_IDS
    most = len(SERVO_IDS)
    baud = 115200
    rate_hz = 50
    servo_ids = (1, 2, 5, 10)
    supply_v = 11.8
    late_ns = (110 * MS, 160 * MS)
    pause_ns = (100 * US, 400 * US)
    servo_type = LssServo
    tables = by_model(MODELS)
    servos: Mapping[int, LssServo]
    twins: Mapping[int, LssServo]

    def start(self) -> Talk:
        """Ask who they are, then switch on."""
        for servo_id in self.servos:
            for word in FACTS:
                yield self._ask(servo_id, word)
        for servo_id in self.servos:
            yield self._tell(servo_id, "CSD", self.servos[servo_id].travel)
            yield from self.enable(servo_id)

    def enable(self, servo_id: int) -> Talk:
        """Limit the speed, show a colour, go to the first goal in half a second."""
        yield self._tell(servo_id, "SD", self.servos[servo_id].travel)
        yield self._tell(servo_id, "LED", 2)
        yield self._tell(servo_id, "D", self._place(servo_id), {"T": 500})

    def command(self, cycle: int) -> Talk:
        """Send a goal to each."""
        del cycle
        for servo_id in self.servos:
            yield self._tell(servo_id, "D", self._place(servo_id))

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

    def _place(self, servo_id: int) -> int:
        """Return where a servo is to be now, in its own parts of a degree."""
        return self.servos[servo_id].place(self.goal(servo_id))

    def heard(self, frame: HeardFrame, request: Message) -> Delivery:
        """Obey any line that the page explains; a query to all is answered by one after another."""
        everyone = frame.servo_id == BROADCAST
        here = (i for i, servo in self.servos.items() if not servo.deaf)
        to = tuple(i for i in here if everyone or i == frame.servo_id)
        if frame.flags & (MALFORMED | UNKNOWN) or not to:
            return unheeded(request)
        word = WORDS[request.op]
        if not word.is_query:
            return Delivery(request, to, lambda s: _obey(s, request))
        selector = max(frame.address, 0)
        to = tuple(i for i in to if _asked(self.servos[i], word.name, selector) is not None)
        if not to:
            return unheeded(request)
        return Delivery(
            request, to, lambda s: _answer(s, word.name, selector), TURNAROUND_NS, chorus=everyone
        )

    def _ask(self, servo_id: int, word: str) -> Delivery:
        request = Message(_command(servo_id, word, None, ()), servo_id, word)
        return Delivery(
            request,
            (servo_id,),
            lambda servo: _answer(servo, word, 0),
            TURNAROUND_NS,
            PATIENCE_NS,
        )

    def _tell(
        self,
        servo_id: int,
        word: str,
        value: int | None = None,
        modifiers: Mapping[str, int] = MappingProxyType({}),
    ) -> Delivery:
        model = self.servos[servo_id].model
        values = stated(servo_id, WORDS[word].registers[model], value)
        for modifier, number in modifiers.items():
            values += stated(servo_id, MODIFIERS[modifier].registers[model], number)
        built = _command(servo_id, word, value, tuple(modifiers.items()))
        request = Message(built, servo_id, word, values)
        return Delivery(request, (servo_id,), lambda servo: servo.obey(word, values))


def _asked(servo: LssServo, word: str, selector: int) -> int | None:
    """Return the register that a query is about; None where the servo's model knows no such one."""
    register = WORDS[word].answers[servo.model].get(selector)
    if register is None or REGISTERS[register].model != servo.table.model:
        return None
    return register


def _answer(servo: LssServo, word: str, selector: int) -> Message | None:
    servo.asked()
    register = _asked(servo, word, selector)
    if register is None:  # another servo of that id is of a model that has it
        return None
    value = servo.reading(REGISTERS[register].name)
    values = stated(servo.servo_id, register, value)
    return Message(_reply(servo.servo_id, word, value), servo.servo_id, word, values)


def _obey(servo: LssServo, request: Message) -> None:
    # the controller of the simulation halts a servo until the goal of the next cycle, which the
    # mechanics do not show; another one means it
    if request.op == "H":
        servo.halt()
    else:
        servo.obey(request.op, request.values)
