"""Scenarios of the line itself: noise, motors, edges, drivers, contacts, a line that is held."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from bench.diagnosis.bodies import steps
from bench.diagnosis.dialects import DIALECTS
from bench.diagnosis.ear import tapped
from bench.diagnosis.line import CONTROLLER
from bench.diagnosis.making import Plan, bench_of, episode, plan, some, talked
from bench.diagnosis.scenario import Heard, Scenario, Truth
from bench.diagnosis.troubles import (
    BrokenWire,
    EarlyRelease,
    HeldLine,
    LateDriver,
    LooseContact,
    MotorNoise,
    Noise,
    SlowEdges,
    StrayTurn,
    StuckLine,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from bench.diagnosis.line import Trouble
    from bench.diagnosis.troubles import Windows

PROTOCOLS: Final = tuple(DIALECTS)


def troubled(
    it: Plan,
    truths: Sequence[Truth],
    trouble: Callable[[int], Sequence[Trouble]],
    **other: Any,
) -> Scenario:
    """Return a scenario of one controller on a line that something is wrong with."""

    def make(seed: int) -> list[Heard]:
        return tapped(talked(it, seed, bench_of(it, seed, troubles=trouble(seed), **other)))

    return Scenario(it.name, it.protocol, tuple(truths), it.baud, make)


def scenarios(draw: int = 0) -> Iterator[Scenario]:
    """Yield all of these, drawn anew for each number."""
    for protocol in PROTOCOLS:
        yield noise(protocol, draw)
        yield hum(protocol, draw)
        yield motors(protocol, draw)
        yield slow_edges(protocol, draw)
        yield long_lows(protocol, draw)
        yield last_byte(protocol, draw)
        yield held_line(protocol, draw)
        yield stray_turn(protocol, draw)
        yield late_driver(protocol, draw)
        yield early_driver(protocol, draw)
        yield late_controller(protocol, draw)
        yield stuck(protocol, draw)
        yield chatter(protocol, draw)
        yield loose_servo(protocol, draw)
        yield loose_branch(protocol, draw)
        yield plug_falls_out(protocol, draw)


def noise(protocol: str, draw: int) -> Scenario:
    """Pulses hit whoever speaks, and the silent line, too."""
    it = plan("bus-noise", protocol, draw, seconds=(10, 25))
    rng, (a, b) = it.rng, episode(it)
    rate, bits, low = rng.uniform(8, 60), rng.uniform(0.5, 2), rng.uniform(0.3, 0.7)
    truth = Truth("bus-noise", (), a, b)
    return troubled(it, [truth], lambda seed: [Noise([(a, b)], rate, bits, low)])


def hum(protocol: str, draw: int) -> Scenario:
    """Noise in episodes: something near by is switched on and off."""
    it = plan("bus-noise-episodes", protocol, draw, seconds=(15, 25))
    rng = it.rng
    windows, t = [], rng.uniform(0.5, 2)
    while t < it.seconds - 1:
        windows.append((t, min(t + rng.uniform(0.3, 1.5), it.seconds)))
        t = windows[-1][1] + rng.uniform(0.5, 3)
    rate = rng.uniform(40, 150)
    truth = Truth("bus-noise", (), windows[0][0], windows[-1][1])
    return troubled(it, [truth], lambda seed: [Noise(windows, rate)])


def motors(protocol: str, draw: int) -> Scenario:
    """Damage comes with the motors' currents: behind each jump of the goals."""
    it = plan("emi-load", protocol, draw, seconds=(18, 30), servos=(3, 7), reads="state")
    rng, (a, b) = it.rng, episode(it, least=0.6)
    every, rate = rng.uniform(1.2, 3), rng.uniform(800, 2500)
    truth = Truth("emi-load", (), a, b)
    return troubled(
        it,
        [truth],
        lambda seed: [MotorNoise([(a, b)], rate)],
        goals=lambda rng: steps(rng, every),
    )


def slow_edges(protocol: str, draw: int) -> Scenario:
    """Rising edges are nearly too late: single high bits between low ones fall out."""
    it = plan("signal-integrity-edges", protocol, draw)
    rng, (a, b) = it.rng, episode(it)
    first = rng.uniform(0.41, 0.45)
    truth = Truth("signal-integrity", (), a, b)
    return troubled(it, [truth], lambda seed: [SlowEdges([(a, b)], first)])


def long_lows(protocol: str, draw: int) -> Scenario:
    """Behind a long row of low bits the line rises too late: always the same bits of a byte."""
    it = plan("signal-integrity-bit", protocol, draw)
    rng, (a, b) = it.rng, episode(it)
    first, whole = rng.uniform(0.05, 0.2), rng.uniform(0.47, 0.53)
    truth = Truth("signal-integrity", (), a, b)
    return troubled(it, [truth], lambda seed: [SlowEdges([(a, b)], first, whole - first)])


def last_byte(protocol: str, draw: int) -> Scenario:
    """The controller's driver lets go before its last byte is over."""
    it = plan("signal-integrity-last-byte", protocol, draw, retries=0)
    rng, (a, b) = it.rng, episode(it)
    share = rng.uniform(0.05, 0.3)
    truth = Truth("signal-integrity", (), a, b)
    senders = frozenset({-1})
    return troubled(it, [truth], lambda seed: [EarlyRelease([(a, b)], (1.5, 6.0), senders, share)])


def held_line(protocol: str, draw: int) -> Scenario:
    """The controller's driver is on for too long and speaks into the first byte of answers."""
    it = plan("turnaround-first-byte", protocol, draw)
    rng, (a, b) = it.rng, episode(it)
    earliest, latest = DIALECTS[protocol].delay_ns
    byte_ns = int(1e10 / it.baud)
    hold = (earliest, latest + byte_ns)
    share = rng.uniform(0.1, 0.6)
    truth = Truth("turnaround", (), a, b)
    return troubled(it, [truth], lambda seed: [HeldLine([(a, b)], hold_ns=hold, share=share)])


def stray_turn(protocol: str, draw: int) -> Scenario:
    """Nobody drives the line for a moment behind a request, and a byte of nobody appears."""
    it = plan("turnaround-stray", protocol, draw)
    rng, (a, b) = it.rng, episode(it)
    wide = rng.choice(((0.55, 0.95), (2.0, 9.0), (0.55, 9.0)))
    share = rng.uniform(0.15, 0.9)
    truth = Truth("turnaround", (), a, b)
    return troubled(it, [truth], lambda seed: [StrayTurn([(a, b)], bits=wide, share=share)])


def late_driver(protocol: str, draw: int) -> Scenario:
    """The driver of one servo is on too late: the beginning of its answers is nobody's."""
    it = plan("turnaround-late-servo", protocol, draw, servos=(3, 7))
    return _switched(it, LateDriver, some(it.rng, it.ids))


def early_driver(protocol: str, draw: int) -> Scenario:
    """The driver of one servo lets go before its last byte is over."""
    it = plan("turnaround-early-servo", protocol, draw, servos=(3, 7))
    return _switched(it, EarlyRelease, some(it.rng, it.ids))


def late_controller(protocol: str, draw: int) -> Scenario:
    """The controller's driver is on too late: the beginning of its requests is nobody's."""
    it = plan("turnaround-late-controller", protocol, draw, retries=0)
    return _switched(it, LateDriver, (CONTROLLER,))


def _switched(it: Plan, kind: type[EarlyRelease], who: tuple[int, ...]) -> Scenario:
    """Return a scenario of drivers that are on or off at the wrong time, seldom or each time."""
    rng, (a, b) = it.rng, episode(it)
    least = rng.uniform(1.0, 6.0)
    bits, share = (least, least + rng.uniform(1.0, 9.0)), rng.choice((0.03, 0.3, 1.0))
    truth = Truth("turnaround", (), a, b)
    return troubled(it, [truth], lambda seed: [kind([(a, b)], bits, frozenset(who), share)])


def _holes(it: Plan, length: tuple[float, float], apart: tuple[float, float]) -> Windows:
    rng = it.rng
    windows, t = [], rng.uniform(1, 4)
    while t < it.seconds - length[0]:
        windows.append((t, min(t + rng.uniform(*length), it.seconds)))
        t = windows[-1][1] + rng.uniform(*apart)
    return windows


def stuck(protocol: str, draw: int) -> Scenario:
    """The line is held low, for milliseconds or for seconds, again and again."""
    it = plan("line-stuck-low", protocol, draw, seconds=(12, 20))
    length = it.rng.choice(((0.03, 0.2), (0.2, 1.0), (1.0, 3.0)))
    windows = _holes(it, length, (0.5, 3))
    truth = Truth("line-stuck", (), windows[0][0], windows[-1][1])
    return troubled(it, [truth], lambda seed: [StuckLine(windows)])


def chatter(protocol: str, draw: int) -> Scenario:
    """The line falls thousands of times a second: rows of FF and 00, and nothing else gets by."""
    it = plan("line-stuck-chatter", protocol, draw, seconds=(12, 20))
    rng = it.rng
    windows = _holes(it, (0.3, 1.5), (1, 4))
    rate, bits = rng.uniform(800, 4000), rng.uniform(0.7, 3)
    truth = Truth("line-stuck", (), windows[0][0], windows[-1][1])
    return troubled(it, [truth], lambda seed: [StuckLine(windows, rate, bits)])


def loose_servo(protocol: str, draw: int) -> Scenario:
    """The plug of one servo: it is silent or cut off for moments, the others are well."""
    it = plan("bad-cable-one", protocol, draw, seconds=(14, 25), servos=(3, 7))
    rng, (a, b) = it.rng, episode(it)
    who = some(rng, it.ids)
    return _loose("bad-cable", it, who, (a, b))


def loose_branch(protocol: str, draw: int) -> Scenario:
    """A plug in the chain: all servos behind it are gone for moments, together."""
    it = plan("bad-cable-behind", protocol, draw, seconds=(14, 25), servos=(4, 7))
    rng, (a, b) = it.rng, episode(it)
    chain = rng.sample(it.ids, len(it.ids))
    who = tuple(sorted(chain[rng.randint(1, len(chain) - 2) :]))
    return _loose("bad-cable", it, who, (a, b))


def plug_falls_out(protocol: str, draw: int) -> Scenario:
    """A plug in the chain falls out, and somebody puts it back: all behind it go and come."""
    it = plan("bad-cable-falls-out", protocol, draw, seconds=(18, 28), servos=(4, 7))
    rng = it.rng
    chain = rng.sample(it.ids, len(it.ids))
    who = tuple(sorted(chain[rng.randint(1, len(chain) - 2) :]))
    windows, t = [], rng.uniform(2, 5)
    for _ in range(rng.randint(2, 4)):
        windows.append((t, t + rng.uniform(0.6, 2.5)))
        t = windows[-1][1] + rng.uniform(0.8, 3)
    truth = Truth("bad-cable", who, windows[0][0], windows[-1][1])
    return troubled(it, [truth], lambda seed: [BrokenWire(windows, frozenset(who))])


def _loose(cause: str, it: Plan, who: tuple[int, ...], window: tuple[float, float]) -> Scenario:
    rng = it.rng
    closed, opened = rng.uniform(0.15, 0.7), rng.uniform(0.01, 0.12)
    truth = Truth(cause, who, *window)
    return troubled(
        it,
        [truth],
        lambda seed: [LooseContact([window], frozenset(who), closed, opened, seed)],
    )
