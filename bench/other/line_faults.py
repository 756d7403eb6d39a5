"""Faults of the line and of what hangs on it: noise, contacts, drivers, levels, clocks, twins."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.other.wire import Bus, Fault, Say

if TYPE_CHECKING:
    from collections.abc import Callable


def flip(bus: Bus, say: Say, at: int) -> None:
    if 0 <= at < len(say.wire) and say.wire[at] >= 0:
        say.wire[at] ^= 1 << bus.rng.randrange(8)


class Noise(Fault):
    """Spikes on the line, whoever speaks; bursts of `burst` bytes."""

    def __init__(
        self, rate: float, when: Callable[[Bus], bool] = lambda b: True, burst: int = 1
    ) -> None:
        self.rate, self.when, self.burst = rate, when, burst

    def line(self, bus: Bus, say: Say) -> None:
        if not self.when(bus):
            return
        k = 0
        while k < len(say.wire):
            if bus.rng.random() < self.rate / self.burst:
                for j in range(self.burst):
                    flip(bus, say, k + j)
            k += 1


class MotorNoise(Fault):
    """The motor's PWM disturbs the line while it pushes: as often as its current says."""

    def __init__(self, rate: float, place: int | None = None, above: float = 0.25) -> None:
        self.rate, self.place, self.above = rate, place, above

    def line(self, bus: Bus, say: Say) -> None:
        pull = max((s.load for s in bus.servos if self.place in (None, s.place)), default=0.0)
        if pull > self.above:
            for k in range(len(say.wire)):
                if bus.rng.random() < self.rate * pull:
                    flip(bus, say, k)


class Weak(Fault):
    """Termination or pull-up too weak for the rate: a 1 behind zeros does not get up in time."""

    def __init__(
        self, rate: float, who: Callable[[Say], bool] = lambda s: True, zeros: int = 2
    ) -> None:
        self.rate, self.who, self.zeros = rate, who, zeros

    def line(self, bus: Bus, say: Say) -> None:
        if not self.who(say):
            return
        for k, byte in enumerate(say.wire):
            if byte < 0:
                continue
            run, value = 1, byte  # the start bit is a zero
            for n in range(8):
                if byte >> n & 1:
                    if run >= self.zeros and bus.rng.random() < self.rate:
                        value &= ~(1 << n)
                    run = 0
                else:
                    run += 1
            say.wire[k] = value


class LateDriver(Fault):
    """The controller's driver lets go late: what an answer says meanwhile is torn."""

    def __init__(self, held: float, share: float = 1.0) -> None:
        self.held, self.share, self.until = held, share, 0.0

    def line(self, bus: Bus, say: Say) -> None:
        if say.who is None:
            hold = self.held * bus.rng.uniform(0.5, 1.1) if bus.rng.random() < self.share else 0
            self.until = say.end + hold
        else:
            say.masked = self.until


class Cable(Fault):
    """A contact of some servos that comes and goes: `open(bus, t)` tells when it is open."""

    def __init__(
        self, places: tuple[int, ...], is_open: Callable[[Bus, float], bool], torn: float = 0.5
    ) -> None:
        self.places, self.is_open, self.torn = places, is_open, torn

    def deaf(self, bus: Bus, servo: int, say: Say) -> bool:
        return servo in self.places and (self.is_open(bus, say.t0) or self.is_open(bus, say.end))

    def line(self, bus: Bus, say: Say) -> None:
        if say.who in self.places:
            for k in range(len(say.wire)):
                if self.is_open(bus, say.t0 + (k + 1) * say.step):
                    if bus.rng.random() < self.torn:
                        say.wire[k:] = [-1] * (len(say.wire) - k)
                        return
                    flip(bus, say, k)


def elbow(place: int, beyond: float, share: float = 0.6) -> Callable[[Bus, float], bool]:
    """Open while the joint is bent, for moments of a few milliseconds."""
    state = {"until": 0.0, "open": False, "was": -1.0}

    def is_open(bus: Bus, t: float) -> bool:
        if t >= state["until"]:
            bent = next(s for s in bus.servos if s.place == place).pos > beyond
            state["open"] = bent and bus.rng.random() < share
            state["until"] = t + bus.rng.uniform(0.002, 0.02)
        return bool(state["open"])

    return is_open


def corroding(over: float, most: float = 0.7) -> Callable[[Bus, float], bool]:
    """Open more and more often, over so many seconds."""
    state = {"until": 0.0, "open": False}

    def is_open(bus: Bus, t: float) -> bool:
        if t >= state["until"]:
            state["open"] = bus.rng.random() < most * min(1.0, t / over) ** 2
            state["until"] = t + bus.rng.expovariate(1 / 0.008)
        return bool(state["open"])

    return is_open


def shaken(every: float, lasts: float) -> Callable[[Bus, float], bool]:
    """Open for moments, in bouts that come at random."""
    state = {"next": 2.0, "end": 0.0, "flick": 0.0, "open": False}

    def is_open(bus: Bus, t: float) -> bool:
        if t > state["next"]:
            state["end"] = t + bus.rng.uniform(0.5, 1.5) * lasts
            state["next"] = t + bus.rng.uniform(0.5, 1.6) * every
        if t >= state["end"]:
            return False
        if t >= state["flick"]:
            state["open"] = bus.rng.random() < 0.6
            state["flick"] = t + bus.rng.uniform(0.001, 0.01)
        return bool(state["open"])

    return is_open


class HeldLow(Fault):
    def __init__(self, spans: list[tuple[float, float]]) -> None:
        self.spans = spans

    def deaf(self, bus: Bus, servo: int, say: Say) -> bool:
        return any(a <= say.end and say.t0 < b for a, b in self.spans)

    def tap(self, bus: Bus, heard: list[tuple[float, int]]) -> list[tuple[float, int]]:
        out = [(t, b) for t, b in heard if not any(a <= t < b2 for a, b2 in self.spans)]
        for a, b2 in self.spans:
            t = a
            while t < b2:
                t += 10 / bus.baud
                out.append((t, 0))
        return sorted(out)


class Twin(Fault):
    """A second servo of one id, with another shaft, that answers nearly at the same time."""

    def __init__(self, ident: int, later: float, offset: float = 0.2, since: float = 0.0) -> None:
        self.ident, self.later, self.offset, self.since = ident, later, offset, since

    def start(self, bus: Bus) -> None:
        kind = type(bus.servos[0])

        def join() -> None:
            if any(s.place == 900 for s in bus.servos):
                return
            twin = kind(self.ident, bus.servos[0].supply, 77)
            twin.place = 900
            twin.delay += self.later
            twin.pos = twin.goal = 0.5 + self.offset
            bus.servos.append(twin)

        if self.since:
            bus.at(self.since, join)
        else:
            join()
