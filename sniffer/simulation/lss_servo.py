"""An LSS servo: what it knows and is told, its state, and what it does to save its motor."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sniffer.protocols.lss.grammar import MODELS, WORDS
from sniffer.simulation.talk import Servo, Value

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sniffer.ground.registers import RegisterMap
    from sniffer.simulation.motion import Joint, Rig

TRAVEL_DEG: Final = 180
"""The default angular range. Source: protocol page 106.1, AR."""

PRO: Final = "lss-pro"

MODEL_STRINGS: Final[Mapping[str, str]] = MappingProxyType({"lss": "LSS-ST1", PRO: "LSS-P-S1"})
"""Answers to QMS. Source: protocol page 106.1, Details 20; the register table of the LSS-PRO."""

RPM: Final = 6
"""Degrees per second of one turn a minute."""

FACTORY_ID: Final = 0
"""Source: protocol page 106.1, Details 16. Identification Number."""

DISABLED: Final = "DIS"
"""Answer of a servo without a first position. Source: the same, Details 18."""

LIMIT_DEGC: Final = 85
"""The servo goes limp beyond. Source: protocol page 106.1, Command List 25."""

BLOCKED_BEHIND: Final = 0.07
"""Part of the travel that it must be behind its goal to call itself blocked."""

BLOCKED_AFTER_S, SAFE_AFTER_S = 0.2, 2.0
"""How long a motor is strained before its servo says so, and before it goes into safe mode: figures
of the simulation."""

SAFE_MODE_CAUSES: Final = ("none", "current", "input_voltage", "temperature")
"""Answers to Q1, by number. Source: client libraries for newer firmware."""

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

    follows = frozenset({"target_position", "target_speed", "target_speed_in_rpm"})

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
        self.cause = "none"
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
        if name in self.seen:
            return self.seen[name]
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
            case "safe_mode_cause" if self.low:
                return SAFE_MODE_CAUSES.index("input_voltage")
            case "safe_mode_cause":
                return SAFE_MODE_CAUSES.index(self.cause)
        if name in self.session:
            return self.session[name]
        return self.kept.get(name, self._defaults.get(name, 0))

    def adopt(self, values: Mapping[str, int]) -> None:
        """Take values as they were seen: settings are kept, the rest is the session's."""
        kinds = {r.name: r.kind for r in self.table.registers}
        for name, raw in values.items():
            if name == "servo_id" or name not in kinds:
                continue
            if kinds[name] == "configuration":
                self.kept[name] = raw
                self._carry_over(name, raw)
            else:
                self.session[name] = raw
        limp = self._states.get("limp")
        self.joint.enabled = values.get("present_status", limp) != limp

    def place_in(self, values: Mapping[str, int]) -> float | None:
        """Return the present position in parts of the travel."""
        raw = values.get("present_position")
        return None if raw is None else raw / self.travel + 0.5

    def place(self, position: float) -> int:
        """Return the number for a place 0..1, in parts of a degree."""
        return round((position - 0.5) * self.travel)

    def _status(self, speed_deg_s: float) -> str:
        """Name the state, as the tables name the answers to Q."""
        if self.low or self.cause != "none":
            return "safe_mode" if "safe_mode" in self._states else "error"
        if not self.joint.driven:
            return "limp"
        behind = abs(self.joint.goal - self.joint.position) > BLOCKED_BEHIND
        if behind and self.joint.strained_s > BLOCKED_AFTER_S and abs(speed_deg_s) < 2:
            return "blocked" if "blocked" in self._states else "error"
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

    def guard(self) -> None:
        """Go limp at a current or a temperature that is too high, until a reset.

        Source: protocol page 106.1, Details 23 and Command List 25.
        """
        if self.cause == "none":
            if self.joint.temperature > LIMIT_DEGC:
                self.cause = "temperature"
            elif self.joint.strained_s > SAFE_AFTER_S:
                self.cause = "current"
            if self.cause != "none":
                self.joint.enabled = False

    def _go(self, goal: float) -> None:
        if self.cause == "none":
            self.joint.enabled = True
            self.joint.goal = goal

    def _carry_over(self, name: str, value: int | str) -> None:
        """Let a value that is kept count for the session as well; a new id waits for the next."""
        session = name.removeprefix("configured_")
        if session != name and isinstance(value, int):
            self.session[session] = value
