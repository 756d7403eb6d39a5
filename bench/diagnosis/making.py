"""How a scenario is drawn: who is on the line, at what rate, under which program and host."""

from __future__ import annotations

import random
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from bench.diagnosis import patterns as p
from bench.diagnosis.dialects import DIALECTS
from bench.diagnosis.line import CONTROLLER, Bench, Master

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bench.diagnosis.bodies import Path
    from bench.diagnosis.line import Pattern

HOSTS: Final = (p.FAST_HOST, p.USUAL_HOST, p.USUAL_HOST, p.SLOW_HOST)


@dataclass(frozen=True, slots=True)
class Plan:
    """All of a scenario that a seed does not vary."""

    name: str
    protocol: str
    baud: int
    ids: tuple[int, ...]
    seconds: float
    gap_ns: tuple[int, int]
    goals: str
    reads: str
    rate_hz: float
    health_every: int
    retries: int
    draw: int = 0

    @property
    def rng(self) -> random.Random:
        """A generator of its own, always the same."""
        return random.Random(f"{self.name} {self.draw}")


def plan(
    name: str,
    protocol: str,
    draw: int = 0,
    *,
    seconds: tuple[float, float] = (8, 20),
    servos: tuple[int, int] = (2, 7),
    slow_lines: bool = False,
    **fixed: Any,
) -> Plan:
    """Draw a plan; ``draw`` gives others of the same kind, ``fixed`` what is not to be drawn."""
    dialect = DIALECTS[protocol]
    rng = random.Random(f"{name} {protocol} {draw}")
    bauds = [b for b in dialect.bauds if slow_lines or b >= 38400]
    count = rng.randint(*servos)
    few = rng.random() < 0.7
    first = dialect.ids[0]
    ids = range(first, first + count) if few else sorted(rng.sample(dialect.ids, count))
    drawn = {
        "baud": rng.choice((dialect.baud, rng.choice(bauds))),
        "ids": tuple(ids),
        "seconds": rng.uniform(*seconds),
        "gap_ns": rng.choice(HOSTS),
        "goals": rng.choice(("together", "together", "each", "turn")),
        "reads": rng.choice(("state", "state", "position", "turn")),
        "rate_hz": rng.choice((10, 20, 25, 30, 50, 100)),
        "health_every": rng.choice((0, 5, 10, 25)),
        "retries": rng.choice((0, 0, 1, 2)),
    }
    return Plan(f"{name}-{protocol}", protocol, draw=draw, **{**drawn, **fixed})


def program(it: Plan, bench: Bench, rng: random.Random, **other: Any) -> Pattern:
    """Return the controller's loop of a plan."""
    told = {"goals": it.goals, "reads": it.reads, **other}
    rate = p.rate_that_fits(bench, it.rate_hz, it.gap_ns, goals=told["goals"], reads=told["reads"])
    loop = p.loop(
        bench, rng, rate_hz=rate, health_every=it.health_every, retries=it.retries, **told
    )
    return p.one_after_the_other(p.start_up(bench), loop) if rng.random() < 0.5 else loop


def bench_of(
    it: Plan, seed: int, goals: Callable[[random.Random], Path] | None = None, **other: Any
) -> Bench:
    """Return the line of a plan, with what else there is to it; nobody has spoken yet."""
    paths = None
    if goals is not None:
        rng = random.Random(f"{it.name} goals {seed}")
        paths = {i: goals(rng) for i in it.ids}
    return Bench(it.protocol, seed, it.ids, it.baud, goals=paths, **other)


def talked(
    it: Plan, seed: int, bench: Bench, *others: Master, pattern: Pattern | None = None
) -> Bench:
    """Let the controller of a plan talk, and others beside it."""
    rng = random.Random(f"{it.name} program {seed}")
    first = Master(pattern or program(it, bench, rng), it.gap_ns)
    bench.run([first, *others], it.seconds)
    return bench


def second(pattern: Pattern, gap_ns: tuple[int, int], begin_s: float) -> Master:
    """Return another controller that begins later."""
    return Master(pattern, gap_ns, int(begin_s * 1e9), CONTROLLER - 1)


def episode(it: Plan, *, least: float = 0.4) -> tuple[float, float]:
    """Draw from when to when something is wrong: always, from some time on, or for a while."""
    rng = it.rng
    match rng.choice(("always", "onset", "onset", "while")):
        case "always":
            return 0.0, it.seconds
        case "onset":
            return rng.uniform(0.1, 1 - least) * it.seconds, it.seconds
        case _:
            length = rng.uniform(least, 0.7) * it.seconds
            begin = rng.uniform(0.1 * it.seconds, it.seconds - length)
            return begin, begin + length


def some(rng: random.Random, ids: Sequence[int], count: int = 1) -> tuple[int, ...]:
    """Draw servos."""
    return tuple(sorted(rng.sample(list(ids), count)))
