"""How a scenario is drawn up: a setting, what happens when, and the truth of it.

What a scenario is about (servos, rates, times, truths) is drawn from its name and a number; what
only gives it life (motion, turnarounds) from the seed it is made with.
"""

from __future__ import annotations

import functools
import random
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from bench.diagnosis.played.robot import ALL, PIPED, SELDOM, TURN, Habit, Robot
from bench.diagnosis.played.stage import Stage
from bench.diagnosis.played.tongues import TONGUES
from bench.diagnosis.scenario import Heard, Scenario, Truth
from sniffer.ground.model import MS, NS
from sniffer.simulation.talk import US, Servo

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bench.diagnosis.played.tongue import Tongue

IDS: Final = {
    "mightyzap": range(1, 30),
    "lss": range(1, 60),
    "rs30x": range(1, 40),
    "wck": range(16),
}
BAUDS: Final = {
    "mightyzap": (57600, 57600, 115200, 200000),
    "lss": (115200, 115200, 230400, 57600),
    "rs30x": (115200, 115200, 230400, 57600),
    "wck": (115200, 115200, 57600, 230400),
}
RATES_HZ: Final = (10, 20, 25, 33, 50, 66, 100)
SELDOM_HZ: Final = 33
"""Whoever looks seldom goes round fast: each servo is looked at once in a second or so."""


class Play(NamedTuple):
    """A scenario while it runs."""

    stage: Stage
    robot: Robot
    tongue: Any

    def servo(self, servo_id: int) -> Any:
        """Return the servo that had this id when the capture began."""
        return self.stage.servo(servo_id)

    def suffer(self, kind: str, servo_id: int, until_s: float) -> None:
        """Let a lasting fault of the simulator begin now."""
        stage = self.stage
        servo: Servo = stage.servo(servo_id)
        stage.ailments.begin(kind, servo, stage.bus.now_ns, int(until_s * NS))

    def tell(self, says: Any) -> bool:
        """Let the controller say something, and wait as it does."""
        return self.robot.say(says)


Act = "Callable[[Play], None]"


@dataclass(slots=True)
class Draft:
    """A scenario as it is drawn up."""

    protocol: str
    rng: random.Random
    baud: int
    ids: list[int]
    habit: Habit
    seconds: float
    plans: list[tuple[float, Callable[[Play], None]]] = field(default_factory=list)
    """What happens at a time, in seconds."""
    cues: list[tuple[float, Callable[[Play], None]]] = field(default_factory=list)
    """What the controller says or does in its first cycle after a time."""
    starts: list[Callable[[Play], None]] = field(default_factory=list)
    """What is so before the first byte."""
    truths: list[Truth] = field(default_factory=list)

    def pick(self) -> int:
        """Choose a servo that nothing is the matter with."""
        ill = {i for truth in self.truths for i in truth.servo_ids}
        return self.rng.choice([i for i in self.ids if i not in ill])

    def at(self, seconds: float, act: Callable[[Play], None]) -> None:
        """Let something happen, whatever the controller does."""
        self.plans.append((seconds, act))

    def cue(self, seconds: float, act: Callable[[Play], None]) -> None:
        """Let the controller do something at the end of a cycle, once it is time."""
        self.cues.append((seconds, act))

    def start(self, act: Callable[[Play], None]) -> None:
        """Let something be so from the start."""
        self.starts.append(act)

    def truth(self, cause: str, who: int | Sequence[int], first_s: float, last_s: float) -> None:
        """Say what is built in."""
        servo_ids = (who,) if isinstance(who, int) else tuple(sorted(who))
        last_s = min(last_s, self.seconds)
        self.truths.append(Truth(cause, servo_ids, round(first_s, 3), round(last_s, 3)))

    def onset(self) -> float:
        """Draw when something begins: well after the start, well before the end."""
        return round(self.seconds * self.rng.uniform(0.25, 0.5), 3)

    def episodes(self, least: float, most: float) -> list[tuple[float, float]]:
        """Draw one to three stretches of time so long, apart from each other."""
        count = self.rng.choice((1, 2, 3)) if self.seconds > 4 * (most + 1.5) else 1
        part = (self.seconds - 2.5) / count
        out = []
        for n in range(count):
            lasts = min(self.rng.uniform(least, most), part - 1)
            first = 2 + n * part + self.rng.uniform(0, part - lasts - 0.5)
            out.append((round(first, 3), round(first + lasts, 3)))
        return out

    def made(self, name: str, draw: int) -> Scenario:
        """Return the scenario."""
        make = functools.partial(_make, self, f"{name} {draw}")
        return Scenario(name, self.protocol, tuple(self.truths), self.baud, make)


def drawn(
    protocol: str,
    name: str,
    *,
    polls: Sequence[str] = (ALL, ALL, TURN),
    servos: tuple[int, int] = (2, 6),
    seconds: tuple[float, float] = (8, 24),
) -> Draft:
    """Draw up the setting of a scenario, without faults so far."""
    rng = random.Random(f"setting {name}")
    usual = [p for p in polls if p != PIPED or protocol == "lss"]
    ids = sorted(rng.sample(IDS[protocol], rng.randint(*servos)))
    way = rng.choice(usual)
    rate_hz = rng.choice(RATES_HZ)
    habit = Habit(
        rate_hz=max(rate_hz, SELDOM_HZ) if way == SELDOM else rate_hz,
        polls=way,
        every=rng.choice((2, 3, 5)),
        pause_ns=rng.choice((60, 150, 400, 1500)) * US,
        tries=rng.choice((1, 1, 1, 2)),
        revives=rng.random() < 0.5,
    )
    baud = rng.choice(BAUDS[protocol])
    return Draft(protocol, rng, baud, ids, habit, round(rng.uniform(*seconds), 1))


def _make(draft: Draft, name: str, seed: int) -> Sequence[Heard]:
    stage = Stage(draft.protocol, f"{name} {seed}", draft.ids, draft.baud)
    tongue: Tongue = TONGUES[draft.protocol](stage, random.Random(f"words {name}"))
    robot = Robot(stage, tongue, draft.habit, stage.rng)
    play = Play(stage, robot, tongue)
    for act in draft.starts:
        act(play)
    for seconds, act in draft.plans:
        stage.at(seconds, functools.partial(act, play))
    left = sorted(draft.cues, key=lambda cue: cue[0])

    def cued(cycle: int) -> None:
        del cycle
        while left and stage.now_s >= left[0][0]:
            left.pop(0)[1](play)

    robot.nature.extras.insert(0, cued)
    robot.run(draft.seconds)
    return stage.heard()


__all__ = ["ALL", "MS", "PIPED", "SELDOM", "TURN", "US", "Draft", "Habit", "Play", "drawn"]
