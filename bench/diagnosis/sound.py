"""Sound traffic of many kinds: whatever a diagnosis warns of here is a false alarm."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

from bench.diagnosis import patterns as p
from bench.diagnosis.bodies import ramps, stays, steps, sway
from bench.diagnosis.dialect import MS
from bench.diagnosis.ear import tapped
from bench.diagnosis.hosts import TwoWires
from bench.diagnosis.line import Bench, Pattern
from bench.diagnosis.making import Plan, bench_of, plan, talked
from bench.diagnosis.scenario import Heard, Scenario
from bench.diagnosis.wires import PROTOCOLS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

Build = Callable[[Plan, Bench, random.Random], Pattern]


def _loop(**how: Any) -> Build:
    def build(it: Plan, bench: Bench, rng: random.Random) -> Pattern:
        told = {"goals": "together", "reads": "state", **how}
        rate = p.rate_that_fits(
            bench, it.rate_hz, it.gap_ns, goals=str(told["goals"]), reads=str(told["reads"])
        )
        return p.loop(bench, rng, **{"rate_hz": rate, "health_every": it.health_every, **told})

    return build


def _slow(it: Plan, bench: Bench, rng: random.Random) -> Pattern:
    return p.loop(bench, rng, rate_hz=0.5, goals="none", reads="state", jitter_ns=4 * MS)


def _scan(it: Plan, bench: Bench, rng: random.Random) -> Pattern:
    ids = [i for i in bench.dialect.ids if i <= max(40, max(bench.ids))]
    looking = p.scan(
        bench, ids, patience_ns=rng.choice((5, 12, 30)) * MS + bench.dialect.delay_ns[1]
    )
    return p.one_after_the_other(looking, p.start_up(bench), _loop()(it, bench, rng))


def _sweeps(it: Plan, bench: Bench, rng: random.Random) -> Pattern:
    del it
    ids = [i for i in bench.dialect.ids if i <= max(30, *bench.ids)]
    return p.sweeps(bench, ids, patience_ns=rng.choice((5, 12)) * MS + bench.dialect.delay_ns[1])


def _pauses(it: Plan, bench: Bench, rng: random.Random) -> Pattern:
    return p.with_pauses(_loop(goals="each")(it, bench, rng), bench, rng)


PATTERNS: Final[Mapping[str, tuple[Build, Mapping[str, Any]]]] = {
    "poll-all": (_loop(), {}),
    "poll-each": (_loop(goals="each"), {}),
    "round-robin": (_loop(goals="turn", reads="turn"), {"rate_hz": 100}),
    "positions": (_loop(goals="none", reads="position"), {}),
    "write-only": (_loop(goals="together", reads="none"), {}),
    "write-each": (_loop(goals="each", reads="none"), {}),
    "retries-unused": (_loop(retries=2), {}),
    "bursts": (lambda it, bench, rng: p.bursts(bench, rng, rate_hz=it.rate_hz / 4), {}),
    "one-servo": (_loop(goals="each"), {"servos": (1, 1)}),
    "sixteen": (_loop(), {"servos": (16, 16), "rate_hz": 10}),
    "slow": (_slow, {"seconds": (60, 90)}),
    "full-load": (lambda it, bench, rng: p.flat_out(bench, goals=rng.random() < 0.5), {}),
    "scan": (_scan, {}),
    "pauses": (_pauses, {"seconds": (20, 40)}),
    "moves": (lambda it, bench, rng: p.moves(bench, rng), {"seconds": (20, 40)}),
    "person": (lambda it, bench, rng: p.person(bench, rng), {"seconds": (60, 120)}),
    "still": (_loop(goals="each"), {}),
    "steps": (_loop(goals="each"), {}),
    "taught": (lambda it, bench, rng: p.taught(bench, rng, rate_hz=it.rate_hz / 5), {}),
    "timers": (lambda it, bench, rng: p.timers(bench, rng), {}),
    "sweeps": (_sweeps, {"seconds": (15, 25)}),
    "looks": (lambda it, bench, rng: p.looks(bench, rng), {"seconds": (20, 40)}),
    "start-up": (
        lambda it, bench, rng: p.one_after_the_other(p.start_up(bench), _loop()(it, bench, rng)),
        {},
    ),
}
"""Kinds of sound traffic by name: who talks, and what of a plan is fixed."""


def scenarios(draw: int = 0) -> Iterator[Scenario]:
    """Yield all of these, drawn anew for each number."""
    for protocol in PROTOCOLS:
        for name in PATTERNS:
            yield of(name, protocol, draw)
        yield two_wires(protocol, draw)
        yield cut(protocol, draw)


def of(name: str, protocol: str, draw: int = 0) -> Scenario:
    """Return sound traffic of one kind; rates, hosts and ids are drawn."""
    build, fixed = PATTERNS[name]
    told = {"seconds": (8, 16), "servos": (1, 9), "slow_lines": True, **fixed}
    it = plan(f"sound-{name}", protocol, draw, **told)
    paths = {"still": stays, "steps": steps}.get(name) or it.rng.choice((sway, ramps))

    def make(seed: int) -> list[Heard]:
        bench = bench_of(it, seed, paths)
        rng = random.Random(f"{it.name} {draw} {seed}")
        return tapped(talked(it, seed, bench, pattern=build(it, bench, rng)))

    return Scenario(it.name, protocol, (), it.baud, make)


def two_wires(protocol: str, draw: int) -> Scenario:
    """Return the log of a tap that tells the wires apart, rightly."""
    it = of("poll-each", protocol, draw)
    return TwoWires(f"sound-two-wires-{protocol}", protocol, (), it.baud, it.make)


def cut(protocol: str, draw: int) -> Scenario:
    """Return a capture that begins and ends in the middle of a frame."""
    it = of("poll-all", protocol, draw)

    def make(seed: int) -> list[Heard]:
        rng = random.Random(f"{it.name} cut {seed}")
        first, *between, last = it.make(seed)[rng.randint(5, 60) : -rng.randint(1, 20)]
        byte_ns = (first.t_end_ns - first.t_start_ns) // len(first.wire)
        lost, kept = rng.randrange(1, len(first.wire)), rng.randrange(1, len(last.wire))
        begins = first.t_start_ns + lost * byte_ns
        ends = last.t_start_ns + kept * byte_ns
        return [
            first._replace(t_start_ns=begins, wire=first.wire[lost:]),
            *between,
            last._replace(t_end_ns=ends, wire=last.wire[:kept]),
        ]

    return Scenario(f"sound-cut-{protocol}", protocol, (), it.baud, make)
