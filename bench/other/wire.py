"""A line in time: who says what when, whom it reaches, and what a tap makes of it."""

from __future__ import annotations

import heapq
import random
from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bench.other.joints import Joint


@dataclass
class Say:
    """What one sender puts on the line, and what the line makes of it."""

    t0: float
    data: bytes
    who: int | None
    baud: float
    wire: list[int] = field(default_factory=list)
    gap: float = 0.0  # between bytes, as some clients have it
    masked: float = -1.0  # until then another driver holds the line high

    @property
    def step(self) -> float:
        return 10 / self.baud + self.gap

    @property
    def end(self) -> float:
        return self.t0 + len(self.data) * self.step


@dataclass(frozen=True)
class Ask:
    frame: bytes
    wait: float = 0.02
    gap: float = 0.0


@dataclass(frozen=True)
class Sleep:
    seconds: float


Script = Generator[Ask | Sleep, bytes | None, None]


class Fault:
    """What may go wrong; each fault overrides what it touches."""

    def start(self, bus: Bus) -> None: ...
    def line(self, bus: Bus, say: Say) -> None: ...
    def deaf(self, bus: Bus, servo: int, say: Say) -> bool:
        return False

    def extra(self, bus: Bus, servo: int) -> float:
        return 0.0

    def tick(self, bus: Bus, t: float) -> None: ...
    def frame(self, bus: Bus, frame: bytes) -> bytes:
        return frame

    def beside(self, bus: Bus) -> list[Ask]:
        """What the program says beside what its script has."""
        return []

    def pause(self, bus: Bus) -> float:
        return 0.0

    def tap(self, bus: Bus, heard: list[tuple[float, int]]) -> list[tuple[float, int]]:
        return heard


class Bus:
    def __init__(
        self,
        baud: float,
        servos: list[Joint],
        seed: int,
        lag: float = 0.0004,
        faults: tuple[Fault, ...] = (),
    ) -> None:
        self.baud, self.rng, self.lag, self.faults = baud, random.Random(seed), lag, faults
        self.servos = servos
        self.says: list[Say] = []
        self.events: list[tuple[float, int, Callable[[], None]]] = []
        self.count = 0
        self.now = 0.0
        self.patience, self.retries = 9.0, 0

    def servo(self, ident: int) -> Joint:
        return next(s for s in self.servos if s.ident == ident)

    def at(self, t: float, what: Callable[[], None]) -> None:
        self.count += 1
        heapq.heappush(self.events, (t, self.count, what))

    def say(
        self, t: float, data: bytes, who: int | None, baud: float | None = None, gap: float = 0.0
    ) -> Say:
        say = Say(t, data, who, baud or self.baud, list(data), gap)
        for fault in self.faults:
            fault.line(self, say)
        self.says.append(say)
        return say

    def clear(self, say: Say) -> bool:
        others = self.says[-12:]
        return (
            say.wire == list(say.data)
            and say.masked < say.t0
            and not any(
                o is not say and o.t0 < say.end - 1e-9 and o.end > say.t0 + 1e-9 for o in others
            )
        )

    def with_more(self, script: Script) -> Script:
        step = next(script)
        while True:
            if self.now > 0.5:
                for fault in self.faults:
                    for ask in fault.beside(self):
                        yield ask
                        yield Sleep(0.0005)
            try:
                step = script.send((yield step))
            except StopIteration:
                return

    def controller(self, script: Script, t: float = 0.0) -> None:
        state = {"token": 0}
        script = self.with_more(script)

        def go(value: bytes | None) -> None:
            try:
                step = script.send(value)
            except StopIteration:
                return
            state["token"] += 1
            token = state["token"]
            late = sum(f.pause(self) for f in self.faults)
            if isinstance(step, Sleep):
                self.at(self.now + step.seconds + late, lambda: go(None))
            else:
                self.at(
                    self.now + late + self.rng.uniform(0.2, 1.6) * self.lag,
                    lambda: ask(step, token),
                )

        def ask(step: Ask, token: int, again: int = 0) -> None:
            frame = step.frame
            for fault in self.faults:
                frame = fault.frame(self, frame)
            say = self.say(self.now, frame, None, gap=step.gap)

            def answered(reply: Say) -> None:
                if state["token"] == token and step.wait:
                    state["token"] += 1
                    go(reply.data if self.clear(reply) else None)

            def given_up() -> None:
                if state["token"] != token:
                    return
                if step.wait and again < self.retries:
                    state["token"] += 1
                    self.at(self.now + 0.0002, lambda: ask(step, state["token"], again + 1))
                else:
                    go(None)

            self.at(say.end, lambda: self.heard(say, answered))
            self.at(say.end + min(step.wait, self.patience) + 1e-7, given_up)

        self.at(t, lambda: go(None))

    def heard(self, say: Say, answered: Callable[[Say], None]) -> None:
        if not self.clear(say):
            return
        for servo in self.servos:
            if servo.off(self.now) or any(f.deaf(self, servo.place, say) for f in self.faults):
                continue
            reply = servo.hear(say.data, self.now)
            if reply is None:
                continue
            delay = servo.delay * self.rng.uniform(0.95, 1.08) + sum(
                f.extra(self, servo.place) for f in self.faults
            )

            def speak(servo: Joint = servo, reply: bytes = reply) -> None:
                said = self.say(self.now, reply, servo.place, self.baud * servo.clock)
                self.at(said.end, lambda: answered(said))

            self.at(self.now + delay, speak)

    def run(self, until: float) -> list[Say]:
        for fault in self.faults:
            fault.start(self)
        tick = 0.0
        while self.events and self.events[0][0] < until:
            t = self.events[0][0]
            while tick < t:
                tick += 0.002
                for fault in self.faults:
                    fault.tick(self, tick)
                total = sum(s.current for s in self.servos)
                for servo in self.servos:
                    servo.advance(tick, total)
            self.now, _, what = heapq.heappop(self.events)
            what()
        return self.says


def uart(says: list[Say], baud: float, rng: random.Random) -> list[tuple[float, int]]:
    """Return the bytes that a UART of such a rate hears, each with the time of its end."""
    heard: list[tuple[float, int]] = []
    says = sorted((s for s in says if s.wire), key=lambda s: s.t0)
    i = 0
    while i < len(says):
        j, end = i + 1, says[i].end
        while j < len(says) and says[j].t0 < end + 0.5 / baud:
            end = max(end, says[j].end)
            j += 1
        group = says[i:j]
        if (
            len(group) == 1
            and abs(group[0].baud / baud - 1) < 0.005
            and group[0].masked < group[0].t0
        ):
            s = group[0]
            heard += [(s.t0 + (k + 1) * s.step, b) for k, b in enumerate(s.wire) if b >= 0]
        else:
            heard += _sampled(group, baud)
        i = j
    heard.sort()
    return heard


def _sampled(group: list[Say], baud: float) -> list[tuple[float, int]]:
    bits = []
    for s in group:
        for k, b in enumerate(s.wire):
            if b < 0:
                continue
            row = [0, *[(b >> n) & 1 for n in range(8)], 1]
            for n, v in enumerate(row):
                a, z = s.t0 + k * s.step + n / s.baud, s.t0 + k * s.step + (n + 1) / s.baud
                if not v and z > s.masked:
                    bits.append((max(a, s.masked), z))
    bits.sort()
    low: list[list[float]] = []
    for since, until in bits:
        if low and since <= low[-1][1] + 1e-9:
            low[-1][1] = max(low[-1][1], until)
        else:
            low.append([since, until])

    def level(t: float) -> int:
        return 0 if any(a <= t < b for a, b in window) else 1

    out: list[tuple[float, int]] = []
    after, row_of = -1.0, 0
    while True:
        while row_of < len(low) and low[row_of][0] < after:
            row_of += 1
        if row_of == len(low):
            return out
        start = low[row_of][0]
        window = low[max(0, row_of - 1) : row_of + 8]
        if level(start + 0.5 / baud):
            after = start + 0.6 / baud
            continue
        value = sum(level(start + (1.5 + k) / baud) << k for k in range(8))
        out.append((start + 10 / baud, value))
        after = start + 9.5 / baud
