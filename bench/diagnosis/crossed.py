"""Scenarios of those who speak when they should not: twins, second masters, wrong rates, others."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

from bench.diagnosis import patterns as p
from bench.diagnosis.bodies import stays
from bench.diagnosis.dialect import US
from bench.diagnosis.ear import tapped
from bench.diagnosis.making import (
    HOSTS,
    Plan,
    bench_of,
    episode,
    plan,
    program,
    second,
    some,
    talked,
)
from bench.diagnosis.scenario import Heard, Scenario, Truth
from bench.diagnosis.troubles import DriftingClock
from bench.diagnosis.uart import Clash, Receiver
from bench.diagnosis.wires import PROTOCOLS, troubled
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Iterator


def scenarios(draw: int = 0) -> Iterator[Scenario]:
    """Yield all of these, drawn anew for each number."""
    for protocol in PROTOCOLS:
        yield twins(protocol, draw, "overlap")
        yield twins(protocol, draw, "together")
        yield twins(protocol, draw, "apart")
        yield two_masters(protocol, draw)
        yield intruder(protocol, draw)
        yield slow_clock(protocol, draw)
        yield fast_clock(protocol, draw)
        yield tap_rate(protocol, draw, half=False)
        yield tap_rate(protocol, draw, half=True)
        yield tap_rate(protocol, draw, half=None)
        yield controller_rate(protocol, draw)
        yield other_protocol(protocol, draw)


def twins(protocol: str, draw: int, how: str) -> Scenario:
    """Two servos of one id answer: a few bits apart, nearly together, or one after the other."""
    it = plan(f"duplicate-id-{how}", protocol, draw, goals="none" if how == "together" else "each")
    rng = it.rng
    (who,) = some(rng, it.ids)
    bit_ns = NS / it.baud
    clash = rng.choice((Clash.AND, Clash.AND, Clash.MIX, Clash.OR))
    answer_ns = 26 * 10 * bit_ns
    shifts = {"together": (0, 20 * US), "overlap": (bit_ns, 40 * bit_ns)}
    low, high = shifts.get(how, (answer_ns, answer_ns + 400 * US))
    shift = round(rng.uniform(low, high))
    # at rest both say the same but for noise of the sensors
    goals = stays if how == "together" and rng.random() < 0.5 else None

    def make(seed: int) -> list[Heard]:
        bench = bench_of(it, seed, goals, twins=(who,), clash=clash)
        body, twin = bench.bodies[who], bench.shadows[who]
        # each has its own jitter, and the shift is what it is on average
        first, last = bench.delays[body]
        bench.delays[twin] = (first + shift, last + shift)
        return tapped(talked(it, seed, bench))

    truth = Truth("duplicate-id", (who,), 0.0, it.seconds)
    return Scenario(it.name, protocol, (truth,), it.baud, make)


def two_masters(protocol: str, draw: int) -> Scenario:
    """Two controllers, each with its own period, neither listens before it talks."""
    it = plan("two-masters", protocol, draw, servos=(3, 5), retries=0, seconds=(12, 20))
    hz = min(max(it.rate_hz, 15), 40)
    return _two(it, hz, it.rng.uniform(0.6, 1.5), begin=0.0)


def intruder(protocol: str, draw: int) -> Scenario:
    """Somebody plugs in a second controller that asks slowly."""
    it = plan("two-masters-later", protocol, draw, servos=(3, 5), retries=0, seconds=(15, 25))
    begin = it.rng.uniform(0.2, 0.5) * it.seconds
    hz = min(max(it.rate_hz, 30), 60)
    return _two(it, hz, it.rng.uniform(0.3, 0.7), begin)


def _two(it: Plan, rate_hz: float, ratio: float, begin: float) -> Scenario:
    rng = it.rng
    their_hz, their_gap = rate_hz * ratio, rng.choice(HOSTS)
    their_reads, their_goals = rng.choice(
        (("state", "none"), ("position", "none"), ("turn", "turn"))
    )
    # where the line sets both rates, they would keep step
    off = rng.uniform(0.72, 0.95)
    clash = rng.choice((Clash.AND, Clash.MIX))

    def make(seed: int) -> list[Heard]:
        bench = bench_of(it, seed, clash=clash)
        own = random.Random(f"{it.name} second {seed}")

        def fitting(hz: float, gap: tuple[int, int], goals: str, reads: str) -> float:
            # together they fill the line no further than one alone would
            return p.rate_that_fits(bench, 2 * hz, gap, goals=goals, reads=reads) / 2

        theirs = p.loop(
            bench,
            own,
            rate_hz=off * fitting(their_hz, their_gap, their_goals, their_reads),
            goals=their_goals,
            reads=their_reads,
        )
        ours = p.loop(
            bench,
            own,
            rate_hz=fitting(rate_hz, it.gap_ns, it.goals, it.reads),
            goals=it.goals,
            reads=it.reads,
        )
        return tapped(talked(it, seed, bench, second(theirs, their_gap, begin), pattern=ours))

    truth = Truth("two-masters", (), begin, it.seconds)
    return Scenario(it.name, it.protocol, (truth,), it.baud, make)


def slow_clock(protocol: str, draw: int) -> Scenario:
    """A servo's clock is slow and its edges are weak: its last bits are read too early."""
    it = plan("clock-drift-slow", protocol, draw)
    rng = it.rng
    error, rise = rng.uniform(0.052, 0.065), rng.uniform(0.18, 0.28)
    # it samples early, so that it still understands what it answers to
    return _drifting(it, error, point=0.36, rise=rise)


def fast_clock(protocol: str, draw: int) -> Scenario:
    """A servo's clock is fast: its stop bits stand where the last data bits should be."""
    it = plan("clock-drift-fast", protocol, draw)
    rng = it.rng
    # it samples late, so that it still understands what it answers to
    return _drifting(it, -rng.uniform(0.056, 0.064), point=0.62, rise=0.0)


def _drifting(it: Plan, error: float, *, point: float, rise: float) -> Scenario:
    (who,), (a, b) = some(it.rng, it.ids), episode(it, least=0.5)

    def at(t: float) -> float:
        # it warms up or cools down within a tenth of the time
        if not a <= t < b:
            return 0.0
        return error * min(1.0, 0.8 + 2 * (t - a) / (b - a)) if a else error

    truth = Truth("clock-drift", (who,), a, b)
    return troubled(it, [truth], lambda seed: [DriftingClock(who, at, point, rise)])


def tap_rate(protocol: str, draw: int, *, half: bool | None) -> Scenario:
    """The tap listens at another rate than the bus has: the half, the double, some other one."""
    kind = {True: "half", False: "double", None: "other"}[half]
    it = plan(f"wrong-baud-{kind}", protocol, draw, seconds=(5, 10))
    if half is None:
        others = [b for b in (9600, 19200, 38400, 57600, 115200, 230400) if b != it.baud]
        tap = it.rng.choice([b for b in others if not 0.9 < b / it.baud < 1.1])
    else:
        tap = it.baud // 2 if half else it.baud * 2

    def make(seed: int) -> list[Heard]:
        return tapped(talked(it, seed, bench_of(it, seed)), Receiver(tap))

    truth = Truth("wrong-baud", (), 0.0, it.seconds)
    return Scenario(it.name, protocol, (truth,), tap, make)


def controller_rate(protocol: str, draw: int) -> Scenario:
    """The controller speaks at a rate that no servo is set to: it is heard, and nobody answers."""
    it = plan("wrong-baud-controller", protocol, draw, seconds=(6, 12), servos=(3, 6))

    def make(seed: int) -> list[Heard]:
        return tapped(talked(it, seed, bench_of(it, seed, deaf=frozenset(it.ids))))

    truth = Truth("wrong-baud", (), 0.0, it.seconds)
    return Scenario(it.name, protocol, (truth,), it.baud, make)


def other_protocol(protocol: str, draw: int) -> Scenario:
    """One controller has servos of two makes on its wire, and asks them in turns."""
    it = plan("mixed-protocols", protocol, draw, seconds=(8, 15), servos=(2, 4))
    other = it.rng.choice([name for name in PROTOCOLS if name != protocol])
    theirs = plan("mixed-protocols-guest", other, draw, servos=(1, 3), baud=it.baud)

    def make(seed: int) -> list[Heard]:
        guests = bench_of(theirs, seed)
        bench = bench_of(it, seed, also=[guests])
        rng = random.Random(f"{it.name} turns {seed}")
        pattern = p.in_turns(
            {protocol: program(it, bench, rng), other: program(theirs, guests, rng)}
        )
        return tapped(talked(it, seed, bench, pattern=pattern))

    truth = Truth("mixed-protocols", (), 0.0, it.seconds)
    return Scenario(f"{it.name}-{other}", protocol, (truth,), it.baud, make)
