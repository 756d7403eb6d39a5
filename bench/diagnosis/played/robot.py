"""A controller: what it does cycle by cycle, how it polls, and what it makes of silence."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from sniffer.ground.model import MS, NS
from sniffer.simulation.talk import US

if TYPE_CHECKING:
    import random
    from collections.abc import Callable, Iterable

    from bench.diagnosis.played.stage import Stage
    from bench.diagnosis.played.tongue import Say, Tongue

ALL, TURN, SELDOM, PIPED = "all", "turn", "seldom", "piped"
"""Poll all servos in each cycle, one in turn, one every few cycles; or ask all, then listen."""

BRIEFLY_NS: Final = 30 * US

LONGEST: Final = 28
"""Bytes that an answer has at most; whoever waits less never hears one."""

PIPED_BYTES: Final = 14
"""Longest answer to a query of the position, with some room."""

COMES_S: Final = 1.5
"""How long servos take to where their motion begins."""


@dataclass(frozen=True, slots=True)
class Habit:
    """How a controller goes about it.

    ``tries``: how often it asks before it gives a servo up for this cycle. ``revives``: it switches
    a servo on again that was away for some cycles. ``spare``: a cycle takes at least so much longer
    than what is said in it.
    """

    rate_hz: float
    polls: str = ALL
    every: int = 8
    pause_ns: int = 300 * US
    tries: int = 1
    revives: bool = False
    spare: float = 1.25
    rests: bool = False


@dataclass(slots=True)
class Nature:
    """What a scenario makes of a controller while it runs."""

    bends: dict[int, Callable[[float, int], int | None]] = field(default_factory=dict)
    """What a servo's goal becomes: by time and raw goal another one; None sends none."""
    extras: list[Callable[[int], None]] = field(default_factory=list)
    """Done at the end of each cycle."""
    hang_ns: int = 0
    """How long the next cycle is late."""
    jitter: float = 0.0
    """Part of a cycle by which each begins too early or too late, at most."""
    mute: set[int] = field(default_factory=set)
    """Servos that are not switched on at the beginning."""
    haste: Callable[[int], int | None] = lambda servo_id: None
    """How long it waits for an answer of a servo that it shall not hear out, in ns."""
    stubborn: int = 0
    """How often it asks a silent servo again at once, without a pause."""
    next_s: float = 0.0
    """When it asks the next time for what it does not ask in each cycle."""


class Robot:
    """Runs cycles until the capture is over."""

    def __init__(self, stage: Stage, tongue: Tongue, habit: Habit, rng: random.Random) -> None:
        self.stage = stage
        self.tongue = tongue
        self.habit = habit
        self.nature = Nature()
        self.rng = rng
        self._begins = {i: servo.joint.position for i, servo in stage.bus.servos.items()}
        self.asked = list(stage.bus.servos)
        """Whom it polls."""
        self.moved = list(stage.bus.servos)
        """To whom it sends goals."""
        self._looks: dict[int, int] = {}
        self._away: dict[int, int] = {}
        self._period_ns = int(NS / habit.rate_hz)

    def run(self, seconds: float) -> None:
        """Say hello, switch on, go round."""
        until_ns = int(seconds * NS)
        if self.habit.polls == PIPED:  # they answer when all are asked, one behind the other
            for servo in self.stage.bus.servos.values():
                servo.lag_ns = len(self.asked) * self._slot_ns
        for servo_id in self.asked:
            self.say(self.tongue.hello(servo_id))
        for servo_id in self.moved:
            if servo_id not in self.nature.mute:
                self.say(self.tongue.switch(servo_id, on=True))
        tick, cycle = self.stage.now_ns, 0
        while self.stage.now_ns < until_ns:
            begun = self.stage.now_ns
            self._cycle(cycle)
            if cycle == 0:
                took = int((self.stage.now_ns - begun) * self.habit.spare)
                self._period_ns = max(self._period_ns, took)
            cycle += 1
            tick = max(tick + self._period_ns, self.stage.now_ns)
            self.stage.wait(self._due(tick))
            tick = max(tick, self.stage.now_ns - self._period_ns)
        self.stage.pass_time(self.stage.now_ns)

    def _due(self, tick: int) -> int:
        nature = self.nature
        hang_ns, nature.hang_ns = nature.hang_ns, 0
        sway = int(nature.jitter * self._period_ns)
        return tick + hang_ns + (self.rng.randint(-sway, sway) if sway else 0)

    def _cycle(self, cycle: int) -> None:
        self.send_goals()
        habit = self.habit
        match habit.polls:
            case "all":
                whom = self.asked
            case "piped":
                self._piped()
                whom = []
            case "turn":
                whom = [self.asked[cycle % len(self.asked)]]
            case _:
                turn, rest = divmod(cycle, habit.every)
                whom = [self.asked[turn % len(self.asked)]] if rest == 0 else []
        for servo_id in whom:
            self.look(servo_id)
        for extra in self.nature.extras:
            extra(cycle)

    def send_goals(self) -> None:
        """Send all servos their goals of now."""
        now_s, raws = self.stage.now_s, {}
        for servo_id in self.moved:
            # it lets its servos come to their first goals, instead of jumping there
            begun, share = self._begins[servo_id], min(now_s / COMES_S, 1.0)
            place = begun + (self.stage.bus.goals[servo_id](now_s) - begun) * share
            raw = self.tongue.raw(servo_id, place)
            bend = self.nature.bends.get(servo_id)
            bent = raw if bend is None else bend(now_s, raw)
            if bent is not None:
                raws[servo_id] = bent
        if raws:
            self.say(self.tongue.goals(raws))

    def look(self, servo_id: int) -> None:
        """Read what there is to know of a servo."""
        turn = self._looks.get(servo_id, 0)
        self._looks[servo_id] = turn + 1
        answered = self.say(self.tongue.look(servo_id, turn), self.nature.haste(servo_id))
        back = answered and self._away.get(servo_id, 0) > 2
        self._away[servo_id] = 0 if answered else self._away.get(servo_id, 0) + 1
        if back and self.habit.revives:
            self.say(self.tongue.switch(servo_id, on=True))

    def say(self, says: Iterable[Say], haste_ns: int | None = None) -> bool:
        """Say it all, one after the other; return whether all was answered that should be."""
        heard = True
        for say in says:
            if not say.is_answered:
                self.stage.ask(say.raw, 0, pause_ns=self._pause())
            elif haste_ns is not None:
                heard &= bool(self.stage.ask(say.raw, haste_ns))
            else:
                heard &= self._insist(say.raw, say.patience_ns or self.tongue.patience)
        return heard

    def _insist(self, raw: bytes, patience: int) -> bool:
        nature = self.nature
        for _ in range(self.habit.tries):
            if self.stage.ask(raw, patience, pause_ns=self._pause()):
                return True
        for _ in range(nature.stubborn):
            short = self.stage.wire_ns(LONGEST) + 2 * MS
            if self.stage.ask(raw, min(patience, short), pause_ns=BRIEFLY_NS):
                return True
        return False

    def _piped(self) -> None:
        """Ask for the position of all, with time between for each other's answers; then listen."""
        stage = self.stage
        asked = {i: next(iter(self.tongue.look(i, 0))).raw for i in self.asked}
        ends = []
        for raw in asked.values():
            begun = stage.now_ns
            ends += [answer.t_end_ns for answer in stage.post(raw)]
            stage.wait(begun + self._slot_ns)
        all_there = len(ends) == len(asked)
        stage.wait(max(ends) if all_there else stage.now_ns + self.tongue.patience)
        stage.wait(stage.now_ns + self._pause())

    @property
    def _slot_ns(self) -> int:
        """From one question of many to the next: an answer's time, and some room."""
        return self.stage.wire_ns(PIPED_BYTES)

    def _pause(self) -> int:
        return self.habit.pause_ns + self.rng.randrange(self.habit.pause_ns // 3 + 1)
