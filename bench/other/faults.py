"""Faults of joints, controllers and taps: each is a thing of the world, no symptom is drawn."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.other.wire import Ask, Bus, Fault, Say, uart

if TYPE_CHECKING:
    from collections.abc import Callable

    from bench.other.joints import Joint


class World(Fault):
    """Something of the world changes at each tick or at the start."""

    def __init__(
        self,
        tick: Callable[[Bus, float], None] | None = None,
        start: Callable[[Bus], None] | None = None,
    ) -> None:
        self._tick, self._start = tick, start

    def tick(self, bus: Bus, t: float) -> None:
        if self._tick:
            self._tick(bus, t)

    def start(self, bus: Bus) -> None:
        if self._start:
            self._start(bus)


def at_place(bus: Bus, place: int) -> Joint:
    return next(s for s in bus.servos if s.place == place)


def stalls(place: int, spans: list[tuple[float, float]]) -> World:
    """Something is in the way in these spans of time: the joint is held where it is."""
    held: dict[str, float] = {}

    def stop(t: float, p: float) -> float | None:
        if any(a <= t < b for a, b in spans):
            return held.setdefault(str([a for a, b in spans if a <= t < b]), p)
        return None

    return World(start=lambda bus: setattr(at_place(bus, place), "stop", stop))


def wall(place: int, beyond: float) -> World:
    """A stop that is closer than the controller thinks."""
    return World(
        start=lambda bus: setattr(
            at_place(bus, place), "stop", lambda t, p: beyond if p > beyond else None
        )
    )


def sagging(
    place: int, dies: dict[int, float], spans: list[tuple[float, float]], ohms: float
) -> tuple[Fault, ...]:
    """One joint stalls, the thin supply sags, and others restart of it."""

    def start(bus: Bus) -> None:
        bus.servos[0].supply.ohms = ohms
        at_place(bus, place).amps = 2.5
        for who, volts in dies.items():
            at_place(bus, who).dies_below = volts

    def alarm(bus: Bus, t: float) -> None:
        for s in bus.servos:
            low = s.volts < s.limit_volts
            s.error = (s.error & ~1) | int(low)

    return World(alarm, start), stalls(place, spans)


class Slow(Fault):
    def __init__(self, place: int, more: Callable[[Bus], float]) -> None:
        self.place, self.more = place, more

    def extra(self, bus: Bus, servo: int) -> float:
        return self.more(bus) if servo == self.place else 0.0


class Dead(Fault):
    def __init__(self, places: tuple[int, ...], since: float, until: float = 1e9) -> None:
        self.places, self.since, self.until = places, since, until

    def deaf(self, bus: Bus, servo: int, say: Say) -> bool:
        return servo in self.places and self.since <= bus.now < self.until


class Pauses(Fault):
    """The controller stands still each so often, for its garbage; or each cycle is uneven."""

    def __init__(self, every: float = 0.0, lasts: float = 0.0, jitter: float = 0.0) -> None:
        self.every, self.lasts, self.jitter, self.due = every, lasts, jitter, every

    def pause(self, bus: Bus) -> float:
        more = bus.rng.expovariate(1 / self.jitter) if self.jitter else 0.0
        if self.every and bus.now > self.due:
            self.due = bus.now + self.every * bus.rng.uniform(0.9, 1.1)
            more += self.lasts * bus.rng.uniform(0.8, 1.3)
        return more


class Loops(Fault):
    """A firmware that sends one more frame with every `each`-th of its own."""

    def __init__(
        self,
        make: Callable[[Bus], bytes],
        every: float,
        count: int = 1,
        start: float = 0.0,
        wait: float = 0.02,
    ) -> None:
        self.make, self.every, self.count, self.due, self.wait = (
            make,
            every,
            count,
            start or every,
            wait,
        )

    def beside(self, bus: Bus) -> list[Ask]:
        if bus.now < self.due:
            return []
        self.due = max(bus.now, self.due + self.every)
        return [Ask(self.make(bus), self.wait) for _ in range(self.count)]


class Replace(Fault):
    """Frames of the controller are altered before they are sent: wrong ones, not damaged ones."""

    def __init__(self, change: Callable[[Bus, bytes], bytes]) -> None:
        self.change = change

    def frame(self, bus: Bus, frame: bytes) -> bytes:
        return self.change(bus, frame)


class Drift(Fault):
    """A resonator that is off: `more(t)` is the share by which its rate is wrong."""

    def __init__(self, place: int, more: Callable[[float], float]) -> None:
        self.place, self.more = place, more

    def tick(self, bus: Bus, t: float) -> None:
        at_place(bus, self.place).clock = 1 + self.more(t)


class Unasked(Fault):
    def __init__(self, place: int, every: float, jitter: float = 0.2) -> None:
        self.place, self.every, self.jitter = place, every, jitter

    def start(self, bus: Bus) -> None:
        servo = at_place(bus, self.place)
        ask = self.ask

        def speak() -> None:
            if bus.says and bus.says[-1].end > bus.now:
                bus.at(bus.says[-1].end + 0.0009, speak)
                return
            reply = servo.hear(ask, bus.now)
            if reply:
                bus.say(bus.now, reply, self.place)
            bus.at(bus.now + self.every * bus.rng.uniform(1 - self.jitter, 1 + self.jitter), speak)

        bus.at(1.0, speak)

    ask: bytes = b""

    def of(self, ask: bytes) -> Unasked:
        self.ask = ask
        return self


class Lost(Fault):
    """The tap's host loses bytes: `spans` of bytes at random moments."""

    def __init__(self, every: float, most: int) -> None:
        self.every, self.most = every, most

    def tap(self, bus: Bus, heard: list[tuple[float, int]]) -> list[tuple[float, int]]:
        out, due, skip = [], self.every * bus.rng.random(), 0
        for t, b in heard:
            if t > due and not skip:
                skip = bus.rng.randint(1, self.most)
                due = t + bus.rng.expovariate(1 / self.every)
            if skip:
                skip -= 1
            else:
                out.append((t, b))
        return out


class OneWay(Fault):
    def __init__(self, servos: bool) -> None:
        self.servos = servos

    def line(self, bus: Bus, say: Say) -> None:
        pass

    def tap(self, bus: Bus, heard: list[tuple[float, int]]) -> list[tuple[float, int]]:

        return uart([s for s in bus.says if (s.who is not None) == self.servos], bus.baud, bus.rng)


class Echo(Fault):
    def __init__(self, lag: float = 0.0) -> None:
        self.lag = lag

    def tap(self, bus: Bus, heard: list[tuple[float, int]]) -> list[tuple[float, int]]:

        more = []
        for s in bus.says:
            if s.who is None:
                more += [
                    (s.t0 + k * 1e-7, b) for k, b in enumerate(s.data)
                ]  # what is written is logged at once
        return sorted(uart(bus.says, bus.baud, bus.rng) + more)


def hot(place: int, heat: float, tau: float, limit: float, back: float, error: int) -> World:
    """A gripper that holds too hard: it gets hot, throttles at its limit, and comes back cooler."""

    def start(bus: Bus) -> None:
        s = at_place(bus, place)
        s.heat, s.tau, s.limit_temp = heat, tau, limit

    def tick(bus: Bus, t: float) -> None:
        s = at_place(bus, place)
        if s.temp > limit and not s.error & error:
            s.error |= error
            s.torque = False
        elif s.temp < back and s.error & error:
            s.error &= ~error
            s.torque = True

    return World(tick, start)
