"""What goes wrong on a line, by its physics: noise, slow edges, contacts, clocks, drivers.

Windows are stretches of time in seconds: outside of them all is well.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

from bench.diagnosis.dialect import US
from bench.diagnosis.line import Trouble
from bench.diagnosis.uart import HIGH, LOW, Burst, Pulse, Receiver, line
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from bench.diagnosis.line import Bench, Said

Windows = Sequence[tuple[float, float]]

_DRAWN: Final = random.Random("edges")
_JITTER: Final = tuple(_DRAWN.gauss(0, 1) for _ in range(4099))
"""By how much edges vary, in parts of their spread."""


def _inside(windows: Windows, t_ns: float) -> bool:
    return any(a * NS <= t_ns < b * NS for a, b in windows)


def _poisson(
    rng: random.Random, rate_hz: float, since_ns: float, until_ns: float
) -> Iterator[float]:
    t = since_ns
    while rate_hz > 0:
        t += rng.expovariate(rate_hz) * NS
        if t >= until_ns:
            return
        yield t


@dataclass(slots=True)
class Noise(Trouble):
    """Pulses from anywhere, whoever speaks: so many a second, so many bits long at the median."""

    windows: Windows
    rate_hz: float
    bits: float = 0.8
    low_share: float = 0.5

    def pulses(self, bench: Bench, since_ns: float, until_ns: float) -> Iterator[Pulse]:
        """Draw them."""
        rng = bench.rng
        for a, b in self.windows:
            begin, end = max(a * NS, since_ns), min(b * NS, until_ns)
            for t in _poisson(rng, self.rate_hz, begin, end):
                width = bench.bit_ns * self.bits * rng.lognormvariate(0, 0.6)
                yield Pulse(t, t + width, LOW if rng.random() < self.low_share else HIGH)


@dataclass(slots=True)
class MotorNoise(Trouble):
    """Pulses of the motors' own: the harder they pull, the more of them.

    ``rate_hz`` at a current of one ampere beyond what the servos draw at rest.
    """

    windows: Windows
    rate_hz: float
    bits: float = 0.7

    def pulses(self, bench: Bench, since_ns: float, until_ns: float) -> Iterator[Pulse]:
        """Draw them, by the currents of this moment."""
        rng = bench.rng
        bodies = bench.bodies.values()
        amperes = sum(body.current_a for body in bodies) - 0.08 * len(bodies)
        if amperes <= 0:
            return
        for a, b in self.windows:
            begin, end = max(a * NS, since_ns), min(b * NS, until_ns)
            for t in _poisson(rng, self.rate_hz * amperes, begin, end):
                # a commutation spark comes with its likes
                for _ in range(rng.randint(1, 3)):
                    width = bench.bit_ns * self.bits * rng.lognormvariate(0, 0.5)
                    yield Pulse(t, t + width, rng.randint(LOW, HIGH))
                    t += width + bench.bit_ns * rng.uniform(0.5, 4)


@dataclass(slots=True)
class SlowEdges(Trouble):
    """Rising edges come late, by parts of a bit: a long cable, a weak pull-up, no termination.

    ``first``: by how much at the least, ``more``: beyond that behind a row of six low bits,
    ``spread``: by how much it varies. ``senders``: whose edges; None: everybody's.
    """

    windows: Windows
    first: float
    more: float = 0.0
    spread: float = 0.04
    senders: frozenset[int] | None = None

    def on(self, bench: Bench, said: Said) -> Said:
        """Delay the edges of what is said."""
        concerned = self.senders is None or said.sender in self.senders
        if not concerned or not _inside(self.windows, said.t_ns):
            return said
        bit, offset = said.bit_ns, bench.rng.randrange(len(_JITTER))

        def rise(number: int, low_bits: int) -> float:
            late = self.first + self.more * min(low_bits, 6) / 6
            # every receiver sees the same edges
            swing = _JITTER[(offset + 10 * number + low_bits) % len(_JITTER)]
            return bit * max(late + self.spread * swing, 0.0)

        return replace(said, rise_ns=rise, plain=False)


@dataclass(slots=True)
class EarlyRelease(Trouble):
    """A driver lets the line go before its last byte is over, and the line floats high.

    ``bits``: how many of the last ones are lost; ``share``: of how many frames.
    """

    windows: Windows
    bits: tuple[float, float]
    senders: frozenset[int] | None = None
    share: float = 1.0

    def on(self, bench: Bench, said: Said) -> Said:
        """Cut the end of what is said."""
        rng = bench.rng
        concerned = self.senders is None or said.sender in self.senders
        if not concerned or not _inside(self.windows, said.t_ns) or rng.random() > self.share:
            return said
        cut = said.end_ns - rng.uniform(*self.bits) * said.bit_ns
        return replace(said, muted=(*said.muted, (cut, said.end_ns + 1)), plain=False)


@dataclass(slots=True)
class LateDriver(EarlyRelease):
    """A driver is on too late, and the line is high meanwhile.

    ``bits``: how many of the first ones are lost; ``share``: of how many frames.
    """

    def on(self, bench: Bench, said: Said) -> Said:
        """Cut the beginning of what is said."""
        rng = bench.rng
        concerned = self.senders is None or said.sender in self.senders
        if not concerned or not _inside(self.windows, said.t_ns) or rng.random() > self.share:
            return said
        until = said.t_ns + rng.uniform(*self.bits) * said.bit_ns
        return replace(said, muted=(*said.muted, (said.t_ns, until)), plain=False)


@dataclass(slots=True)
class _Planned(Trouble):
    """Pulses that follow from what is said."""

    windows: Windows
    _due: list[Pulse] = field(init=False, default_factory=list)

    def pulses(self, bench: Bench, since_ns: float, until_ns: float) -> Iterator[Pulse]:
        """Give those that are due."""
        del bench, since_ns
        due, self._due = self._due, []
        for pulse in due:
            if pulse.t_ns < until_ns:
                yield pulse
            else:
                self._due.append(pulse)


@dataclass(slots=True)
class HeldLine(_Planned):
    """The controller's driver holds the line behind its requests and speaks into the answers."""

    hold_ns: tuple[int, int] = (0, 0)
    share: float = 1.0

    def on(self, bench: Bench, said: Said) -> Said:
        """Hold the line high behind a request, until its driver speaks again."""
        if said.sender < 0:
            self._due = [p._replace(end_ns=min(p.end_ns, said.t_ns)) for p in self._due]
        concerned = said.sender < 0 and _inside(self.windows, said.t_ns)
        if concerned and bench.rng.random() < self.share:
            hold = bench.rng.randint(*self.hold_ns)
            self._due.append(Pulse(said.end_ns, said.end_ns + hold, HIGH))
        return said


@dataclass(slots=True)
class StrayTurn(_Planned):
    """The line is nobody's for a moment when the direction changes, and falls low.

    ``bits``: for how many bits; less than half a one is no start bit. ``behind``: whom it follows.
    """

    bits: tuple[float, float] = (0.6, 9.0)
    share: float = 0.5
    behind_requests: bool = True

    def on(self, bench: Bench, said: Said) -> Said:
        """Let it fall behind a frame."""
        if (said.sender < 0) == self.behind_requests and _inside(self.windows, said.t_ns):
            rng = bench.rng
            if rng.random() < self.share:
                begin = said.end_ns + rng.uniform(2, 20) * US
                width = rng.uniform(*self.bits) * bench.bit_ns
                self._due.append(Pulse(begin, begin + width, LOW))
        return said


@dataclass(slots=True)
class StuckLine(Trouble):
    """Something holds the line low for the windows, or lets it chatter in them.

    ``chatter_hz``: how often it falls, for ``bits`` at the median; 0: it stays low.
    """

    windows: Windows
    chatter_hz: float = 0.0
    bits: float = 0.8

    def pulses(self, bench: Bench, since_ns: float, until_ns: float) -> Iterator[Pulse]:
        """Hold it low, or let it fall again and again."""
        rng = bench.rng
        for a, b in self.windows:
            if self.chatter_hz:
                begin, end = max(a * NS, since_ns), min(b * NS, until_ns)
                for t in _poisson(rng, self.chatter_hz, begin, end):
                    width = bench.bit_ns * self.bits * rng.lognormvariate(0, 0.7)
                    yield Pulse(t, t + width, LOW)
            elif since_ns <= a * NS < until_ns:
                yield Pulse(a * NS, b * NS, LOW)


@dataclass(slots=True)
class LooseContact(Trouble):
    """Servos lose the line for moments, in the middle of a byte as well as for many frames.

    ``closed_s`` and ``open_s`` are means, within the windows.
    """

    windows: Windows
    servos: frozenset[int]
    closed_s: float
    open_s: float
    seed: int = 0
    _open: list[tuple[float, float]] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        rng = random.Random(f"contact {self.seed}")
        for a, b in self.windows:
            t = a
            while (t := t + rng.expovariate(1 / self.closed_s)) < b:
                end = min(t + rng.expovariate(1 / self.open_s), b)
                # it bounces when it opens and when it closes
                for _ in range(rng.randint(0, 3)):
                    bounce = t + rng.uniform(0.0001, 0.002)
                    self._open.append((t * NS, bounce * NS))
                    t = bounce + rng.uniform(0.0001, 0.002)
                self._open.append((t * NS, max(end, t + 0.0005) * NS))
                t = max(end, t)

    def _during(self, said: Said) -> tuple[tuple[float, float], ...]:
        return tuple(x for x in self._open if x[0] < said.end_ns and x[1] > said.t_ns)

    def reaches(self, bench: Bench, servo_id: int, said: Said) -> bool:
        """Tell whether the contact holds for the whole of it."""
        del bench
        return servo_id not in self.servos or not self._during(said)

    def on(self, bench: Bench, said: Said) -> Said:
        """Cut what these servos say."""
        del bench
        if said.sender not in self.servos or not (during := self._during(said)):
            return said
        return replace(said, muted=(*said.muted, *during), plain=False)


@dataclass(slots=True)
class BrokenWire(Trouble):
    """Servos are off the line for the windows: nothing gets through, either way."""

    windows: Windows
    servos: frozenset[int]

    def reaches(self, bench: Bench, servo_id: int, said: Said) -> bool:
        """Tell whether they are on the line."""
        del bench
        return servo_id not in self.servos or not _inside(self.windows, said.t_ns)


@dataclass(slots=True)
class DriftingClock(Trouble):
    """One servo's bits are longer (error > 0) or shorter than they should be.

    ``error`` by time in seconds; ``point``: where in a bit its receiver samples; ``rise``: by how
    many bits its rising edges are late, which a slow clock makes worse.
    """

    servo_id: int
    error: Callable[[float], float]
    point: float = 0.5
    rise: float = 0.0
    _heard: dict[tuple[bytes, float], bool] = field(init=False, default_factory=dict)

    def on(self, bench: Bench, said: Said) -> Said:
        """Stretch what it says."""
        del bench
        error = self.error(said.t_ns / NS)
        if said.sender != self.servo_id or not error:
            return said
        bit, late = said.bit_ns * (1 + error), said.bit_ns * self.rise
        return replace(
            said, bit_ns=bit, rise_ns=(lambda number, low: late) if late else None, plain=False
        )

    def reaches(self, bench: Bench, servo_id: int, said: Said) -> bool:
        """Tell whether it understands a request by its own clock."""
        error = round(self.error(said.t_ns / NS), 4)
        if servo_id != self.servo_id or not error:
            return True
        key = said.data, error
        if key not in self._heard:
            edges = line([Burst(0.0, said.data, said.bit_ns)])
            ear = Receiver(bench.baud, error, self.point)
            self._heard[key] = bytes(b.value for b in ear.hear(edges)) == said.data
        return self._heard[key]
