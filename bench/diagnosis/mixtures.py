"""Scenarios with two faults that have nothing to do with each other."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.diagnosis.dialect import US
from bench.diagnosis.ear import tapped
from bench.diagnosis.making import Plan, bench_of, plan, talked
from bench.diagnosis.scenario import Heard, Scenario, Truth
from bench.diagnosis.taps import echoed, with_holes
from bench.diagnosis.troubles import DriftingClock, LooseContact, Noise, StrayTurn, StuckLine
from bench.diagnosis.uart import Clash
from bench.diagnosis.wires import PROTOCOLS
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from bench.diagnosis.line import Trouble

Part = tuple[Truth, "Callable[[int], Trouble]"]


def scenarios(draw: int = 0) -> Iterator[Scenario]:
    """Yield all of these, drawn anew for each number."""
    for protocol in PROTOCOLS:
        for name, first, other in (
            ("noise-then-cable", _noise, _cable),
            ("drift-and-cable", _drift, _cable),
            ("stray-and-cable", _stray, _cable),
            ("stuck-and-drift", _stuck, _drift),
        ):
            it = _plan(name, protocol, draw)
            yield _both(it, first(it, 0), other(it, 1))
        yield twins_and_noise(protocol, draw)
        yield echo_and_cable(protocol, draw)
        yield holes_and_drift(protocol, draw)


def _plan(name: str, protocol: str, draw: int) -> Plan:
    return plan(f"mixed-{name}", protocol, draw, seconds=(18, 28), servos=(4, 7))


def _window(it: Plan, half: int) -> tuple[float, float]:
    """Return the first or the second part of the time; they overlap now and then."""
    middle = it.seconds * it.rng.uniform(0.4, 0.6)
    spill = it.seconds * it.rng.choice((-0.03, 0.1))
    return (1.0, middle + spill) if not half else (middle - spill, it.seconds)


def _noise(it: Plan, half: int) -> Part:
    a, b = _window(it, half)
    rate = it.rng.uniform(15, 60)
    return Truth("bus-noise", (), a, b), lambda seed: Noise([(a, b)], rate)


def _cable(it: Plan, half: int) -> Part:
    window = _window(it, half)
    who = it.ids[-1]
    truth = Truth("bad-cable", (who,), *window)
    return truth, lambda seed: LooseContact([window], frozenset({who}), 0.3, 0.05, seed)


def _drift(it: Plan, half: int) -> Part:
    a, b = _window(it, half)
    who, error = it.ids[0], it.rng.uniform(0.055, 0.065)

    def at(t: float) -> float:
        return error if a <= t < b else 0.0

    return Truth("clock-drift", (who,), a, b), lambda seed: DriftingClock(who, at, 0.36, 0.24)


def _stray(it: Plan, half: int) -> Part:
    a, b = _window(it, half)
    truth = Truth("turnaround", (), a, b)
    return truth, lambda seed: StrayTurn([(a, b)], bits=(0.6, 6.0), share=0.4)


def _stuck(it: Plan, half: int) -> Part:
    a, b = _window(it, half)
    count = it.rng.randint(3, 5)
    apart = (b - a) / count
    windows = [(a + k * apart, a + k * apart + apart * 0.2) for k in range(count)]
    truth = Truth("line-stuck", (), windows[0][0], windows[-1][1])
    return truth, lambda seed: StuckLine(windows)


def _both(it: Plan, *parts: Part) -> Scenario:
    def make(seed: int) -> list[Heard]:
        bench = bench_of(it, seed, troubles=[trouble(seed) for _, trouble in parts])
        return tapped(talked(it, seed, bench))

    return Scenario(it.name, it.protocol, tuple(truth for truth, _ in parts), it.baud, make)


def twins_and_noise(protocol: str, draw: int) -> Scenario:
    """Two servos of one id answer one after the other, and noise hits everybody."""
    it = _plan("duplicate-and-noise", protocol, draw)
    who = it.ids[1]
    truth, trouble = _noise(it, 1)
    shift = round(26 * 10 * NS / it.baud) + 150 * US

    def make(seed: int) -> list[Heard]:
        bench = bench_of(it, seed, troubles=[trouble(seed)], twins=(who,), clash=Clash.AND)
        first, last = bench.delays[bench.bodies[who]]
        bench.delays[bench.shadows[who]] = (first + shift, last + shift)
        return tapped(talked(it, seed, bench))

    truths = (Truth("duplicate-id", (who,), 0.0, it.seconds), truth)
    return Scenario(it.name, protocol, truths, it.baud, make)


def echo_and_cable(protocol: str, draw: int) -> Scenario:
    """An adapter that echoes, and a servo with a bad plug."""
    it = _plan("echo-and-cable", protocol, draw)
    truth, trouble = _cable(it, 1)

    def make(seed: int) -> list[Heard]:
        heard = tapped(talked(it, seed, bench_of(it, seed, troubles=[trouble(seed)])))
        return echoed(heard, heard)

    truths = (Truth("echo", (), 0.0, it.seconds), truth)
    return Scenario(it.name, protocol, truths, it.baud, make)


def holes_and_drift(protocol: str, draw: int) -> Scenario:
    """The tap loses bytes, and a servo's clock is off."""
    it = _plan("tap-loss-and-drift", protocol, draw)
    truth, trouble = _drift(it, 1)
    a, b = _window(it, 0)

    def make(seed: int) -> Sequence[Heard]:
        heard = tapped(talked(it, seed, bench_of(it, seed, troubles=[trouble(seed)])))
        return with_holes(
            heard, it, seed, window=(a, b), size=(20, 150), every_s=0.5, told=seed % 2 == 0
        )

    return Scenario(it.name, protocol, (Truth("tap-loss", (), a, b), truth), it.baud, make)
