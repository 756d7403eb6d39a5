"""A Lynxmotion LSS bus: a goal to each servo (D), its position (QD), the other values in turn.

The protocol page gives no times: a servo's turnaround of about 1 ms and the controller's patience
are figures of the simulation, in the range of what client libraries wait.
"""

from __future__ import annotations

import functools
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sniffer.ground.model import MALFORMED, MS, UNKNOWN
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
from sniffer.simulation import faults
from sniffer.simulation.lss_servo import LssServo
from sniffer.simulation.talk import (
    US,
    Ask,
    Bus,
    Delivery,
    HeardFrame,
    Message,
    Talk,
    Value,
    by_model,
    unheeded,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

TURNAROUND_NS: Final = 1 * MS
PATIENCE_NS: Final = 200 * MS

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
    lags_ns = (8 * MS, 40 * MS)
    unknown_faults = frozenset({faults.REFUSE})
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

    def keep(self, servo_id: int, turn: int) -> Delivery:
        """Configure the colour that it has after a restart."""
        return self._tell(servo_id, "CLED", 1 + turn % 7)

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
