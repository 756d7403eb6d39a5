"""What controllers do: the loops of usual programs, in any protocol."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from bench.diagnosis.bodies import sway
from bench.diagnosis.dialect import MS, US, Asked
from bench.diagnosis.line import Bench, Pattern, Pause
from sniffer.ground.model import NS

if TYPE_CHECKING:
    import random
    from collections.abc import Callable, Mapping, Sequence

FAST_HOST, USUAL_HOST, SLOW_HOST = (20 * US, 90 * US), (200 * US, 900 * US), (1 * MS, 5 * MS)
"""What a microcontroller, a compiled program and a script leave between two requests."""

SHARE_MOST: Final = 0.6
"""A controller with a rate is given one that fills the line no further."""

GOALS: Final = ("together", "each", "turn", "none")
READS: Final = ("state", "position", "turn", "none")


def rate_that_fits(
    bench: Bench, wanted_hz: float, gap_ns: tuple[int, int], *, goals: str, reads: str
) -> float:
    """Return the rate of a loop, lower than wanted where the line has no time for it."""
    n = 1 if "turn" in (goals, reads) else len(bench.ids)
    # request and answer are 8 to 25 bytes, an answer comes within the longest usual delay
    exchange = 34 * 10 * bench.bit_ns + bench.dialect.delay_ns[1] + gap_ns[1]
    count = n * ((reads != "none") + (goals == "each")) + (goals == "together") * (1 + n // 6)
    return min(wanted_hz, SHARE_MOST * NS / (exchange * max(count, 1)))


def loop(
    bench: Bench,
    rng: random.Random,
    *,
    rate_hz: float,
    goals: str = "together",
    reads: str = "state",
    health_every: int = 0,
    retries: int = 0,
    cycles: int = 1 << 40,
    jitter_ns: int = 60 * US,
) -> Pattern:
    """Send goals and read, cycle after cycle; where a cycle took too long, one is left out."""
    dialect, period = bench.dialect, NS / rate_hz
    ids = list(bench.ids)
    begin = bench.now_ns
    cycle = 0
    while cycle < cycles:
        if goals == "together":
            for request in dialect.move_all({i: bench.goal(i) for i in ids}):
                yield request
        elif goals != "none":
            for i in ids if goals == "each" else [ids[cycle % len(ids)]]:
                yield dialect.move(bench.bodies[i], bench.goal(i))
        if reads != "none":
            for i in ids if reads != "turn" else [ids[cycle % len(ids)]]:
                request = dialect.position(i) if reads == "position" else dialect.state(i)
                for _ in range(retries + 1):
                    if (yield request):
                        break
        if health_every and cycle % health_every == health_every - 1:
            yield dialect.health(ids[cycle // health_every % len(ids)])
        late = max(bench.now_ns - begin, 0)
        cycle = max(cycle + 1, int(late // period) + 1)
        yield Pause(until_ns=int(begin + cycle * period) + rng.randrange(jitter_ns))


def start_up(bench: Bench) -> Pattern:
    """Look for each servo and switch it on."""
    for i in bench.ids:
        yield bench.dialect.ping(i)
    for body in bench.bodies.values():
        yield bench.dialect.switch_on(body)
        yield bench.dialect.health(body.servo_id)


def scan(bench: Bench, ids: Sequence[int], *, patience_ns: int = 8 * MS) -> Pattern:
    """Look for servos under many ids, as a configuration tool does: most are nobody's."""
    for i in ids:
        yield Asked(bench.dialect.ping(i).data, patience_ns)


def flat_out(bench: Bench, *, goals: bool) -> Pattern:
    """Ask the next one as soon as the last one has answered, for ever."""
    while True:
        if goals:
            goal = {i: bench.goal(i) for i in bench.ids}
            yield from (request for request in bench.dialect.move_all(goal))
        for i in bench.ids:
            yield bench.dialect.state(i)


def bursts(bench: Bench, rng: random.Random, *, rate_hz: float) -> Pattern:
    """Write the goals of all in one go, request behind request, and read one servo."""
    cycle = 0
    while True:
        for body in bench.bodies.values():
            yield bench.dialect.move(body, bench.goal(body.servo_id))
        yield bench.dialect.position(rng.choice(list(bench.ids)))
        cycle += 1
        yield Pause(until_ns=int(cycle * NS / rate_hz))


def taught(bench: Bench, rng: random.Random, *, rate_hz: float) -> Pattern:
    """Let all servos go, and read where a hand moves them."""
    for body in bench.bodies.values():
        body.hand = sway(rng)
        yield bench.dialect.switch_off(body)
    yield from loop(bench, rng, rate_hz=rate_hz, goals="none", reads="position")


def moves(bench: Bench, rng: random.Random) -> Pattern:
    """Send a servo somewhere, ask until it is there, rest; then the next one."""
    while True:
        i = rng.choice(list(bench.ids))
        yield bench.dialect.move(bench.bodies[i], rng.uniform(0.25, 0.75))
        for _ in range(rng.randint(8, 25)):
            yield bench.dialect.position(i)
            yield Pause(rng.randint(18, 24) * MS)
        yield Pause(rng.randint(100, 2500) * MS)


def person(bench: Bench, rng: random.Random) -> Pattern:
    """Type single commands, seconds apart."""
    dialect = bench.dialect
    while True:
        i = rng.choice(list(bench.ids))
        yield rng.choice(
            (dialect.ping(i), dialect.state(i), dialect.position(i), dialect.health(i))
            if rng.random() < 0.7
            else (dialect.move(bench.bodies[i], rng.uniform(0.25, 0.75)),)
        )
        yield Pause(int(rng.lognormvariate(0.2, 0.9) * NS))


def timers(bench: Bench, rng: random.Random) -> Pattern:
    """Let one program do three things at three rates of their own, one at a time."""
    dialect, ids = bench.dialect, bench.ids
    jobs: tuple[tuple[float, Callable[[], Sequence[Asked]]], ...] = (
        (NS / rng.uniform(15, 40), lambda: dialect.move_all({i: bench.goal(i) for i in ids})),
        (NS / rng.uniform(5, 13), lambda: [dialect.position(i) for i in ids]),
        (NS * rng.uniform(0.3, 1.2), lambda: [dialect.health(i) for i in ids]),
    )
    due = [0.0] * len(jobs)
    while True:
        first = due.index(min(due))
        yield Pause(until_ns=int(due[first]))
        period, requests = jobs[first]
        yield from (request for request in requests())
        due[first] = max(due[first] + period, bench.now_ns)


def sweeps(bench: Bench, ids: Sequence[int], *, patience_ns: int) -> Pattern:
    """Ask the servos that are there, and every few seconds look for those that came."""
    while True:
        yield from scan(bench, ids, patience_ns=patience_ns)
        begin = bench.now_ns
        while bench.now_ns < begin + 3 * NS:
            for i in bench.ids:
                yield bench.dialect.state(i)
            yield Pause(20 * MS)


def looks(bench: Bench, rng: random.Random) -> Pattern:
    """Send each servo far, look at it once soon behind, and rest for as long as it takes."""
    while True:
        for body in bench.bodies.values():
            yield bench.dialect.move(body, rng.uniform(0.1, 0.9))
            yield Pause(rng.choice((5, 30, 60)) * MS)
            yield bench.dialect.state(body.servo_id)
        yield Pause(int(rng.uniform(0.2, 0.8) * NS))


def with_pauses(pattern: Pattern, bench: Bench, rng: random.Random) -> Pattern:
    """Let a program rest for seconds now and then: somebody has stopped it, and goes on."""
    answer = b""
    rest_ns = rng.uniform(2, 5) * NS
    while True:
        try:
            step = pattern.send(answer) if answer else next(pattern)
        except StopIteration:
            return
        answer = yield step
        if bench.now_ns > rest_ns and isinstance(step, Pause):
            yield Pause(int(rng.uniform(0.5, 6) * NS))
            rest_ns = bench.now_ns + rng.uniform(2, 5) * NS


def one_after_the_other(*patterns: Pattern) -> Pattern:
    """Do one thing, then the next."""
    for pattern in patterns:
        yield from pattern


def in_turns(parts: Mapping[str, Pattern]) -> Pattern:
    """Let two programs of one controller speak in turns, an exchange each; rests are common."""
    held: dict[str, bytes] = {}
    began: set[str] = set()
    while True:
        for name, pattern in parts.items():
            while True:
                step = pattern.send(held.pop(name, b"")) if name in began else next(pattern)
                began.add(name)
                held[name] = yield step
                if isinstance(step, Pause):
                    break
