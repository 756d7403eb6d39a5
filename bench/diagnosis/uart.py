"""A UART by its bits: senders put levels on one line, a receiver samples them and makes bytes.

A line is high when idle. Several may drive it at once, each by its own clock; what is on the line
then depends on the drivers. A receiver finds the falling edge of a start bit and samples the middle
of each bit behind it, as UARTs with 16 samples a bit do. Times are in ns, as floats: bits of fast
lines are no whole numbers.
"""

from __future__ import annotations

import enum
import heapq
import math
from bisect import bisect_right
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.ground.model import NS

if TYPE_CHECKING:
    import random
    from collections.abc import Callable, Iterable, Iterator, Sequence

BITS: Final = 10
"""Bits of a byte on the line, 8N1: start, eight of data with the least first, stop."""

OVERSAMPLING: Final = 16
"""Samples a bit of a usual UART: it sees an edge late by up to one of them."""

LOW, HIGH, IDLE = 0, 1, 2

Edge = tuple[float, int]
"""From a time on the line has a level."""


class Clash(enum.Enum):
    """What is on the line where two drive it differently."""

    AND = "and"  # open collector: who pulls low wins
    OR = "or"  # push-pull with stronger high sides
    MIX = "mix"  # push-pull alike: each time one of them, or something between, that any may be


class Burst(NamedTuple):
    """Bytes in a row of one sender: when the first begins, and how long its bits are.

    ``rise_ns`` tells how late a rising edge is, by its byte and how many bits were low before it (a
    weak pull-up, a long cable); ``muted`` are stretches in which nothing of it reaches the line.
    """

    t_ns: float
    data: bytes
    bit_ns: float
    rise_ns: Callable[[int, int], float] | None = None
    muted: Sequence[tuple[float, float]] = ()

    @property
    def end_ns(self) -> float:
        """When the last stop bit is over."""
        return self.t_ns + len(self.data) * BITS * self.bit_ns


class Pulse(NamedTuple):
    """Something from outside holds the line at a level, whoever drives it."""

    t_ns: float
    end_ns: float
    level: int


class SampledByte(NamedTuple):
    """A byte as it was received; ``stop`` tells whether its stop bit was there."""

    t_ns: float
    value: int
    stop: bool


def _changes(value: int) -> tuple[tuple[int, int, int], ...]:
    """Return where a byte's level changes, from an idle line on: bit, level, bits since then."""
    levels = [LOW, *(value >> k & 1 for k in range(8)), HIGH]
    out, before, since = [], HIGH, 0
    for k, level in enumerate(levels):
        if level != before:
            out.append((k, level, k - since))
            before, since = level, k
    return tuple(out)


_CHANGES: Final = tuple(_changes(value) for value in range(256))


def driven(burst: Burst) -> list[Edge]:
    """Return the edges of one sender, IDLE where it drives nothing."""
    edges: list[Edge] = []
    begin, bit, rise = burst.t_ns, burst.bit_ns, burst.rise_ns
    for number, byte in enumerate(burst.data):
        for k, level, low_bits in _CHANGES[byte]:
            late = rise(number, low_bits) if rise is not None and level == HIGH else 0.0
            t = begin + k * bit + late
            if edges and edges[-1][0] >= t:  # it has not risen when it is to fall again
                edges.pop()
                continue
            edges.append((t, level))
        begin += BITS * bit
    edges.append((max(burst.end_ns, edges[-1][0] if edges else burst.t_ns), IDLE))
    return _without(edges, burst.muted) if burst.muted else edges


def _without(edges: Sequence[Edge], muted: Sequence[tuple[float, float]]) -> list[Edge]:
    """Return edges of a sender that is cut off from the line now and then."""
    out: list[Edge] = []
    starts = [t for t, _ in edges]
    level = IDLE
    marks = sorted({*starts, *(t for pair in muted for t in pair)})
    for t in marks:
        at = bisect_right(starts, t) - 1
        own = edges[at][1] if at >= 0 else IDLE
        now = IDLE if any(a <= t < b for a, b in muted) else own
        if now != level:
            out.append((t, now))
            level = now
    return out


def line(
    bursts: Sequence[Burst],
    pulses: Sequence[Pulse] = (),
    *,
    clash: Clash = Clash.AND,
    rng: random.Random | None = None,
) -> list[Edge]:
    """Return the levels of a line that all of these drive; ``rng`` is asked where they MIX."""
    if len(bursts) == 1 and not pulses:
        return [(t, HIGH if level == IDLE else level) for t, level in driven(bursts[0])]
    tracks: list[Iterable[tuple[float, int, int]]] = []
    for who, burst in enumerate(bursts):
        tracks.append([(t, who, level) for t, level in driven(burst)])
    for n, pulse in enumerate(pulses, len(bursts)):
        tracks.append([(pulse.t_ns, n, pulse.level), (pulse.end_ns, n, IDLE)])
    held = [IDLE] * len(tracks)
    out: list[Edge] = []
    before = HIGH
    for t, who, level in heapq.merge(*tracks):
        held[who] = level
        now = _level(held[: len(bursts)], held[len(bursts) :], clash, rng)
        if out and out[-1][0] == t:
            out.pop()
            before = out[-1][1] if out else HIGH
        if now != before:
            out.append((t, now))
            before = now
    return out


def _level(
    senders: Sequence[int], forced: Sequence[int], clash: Clash, rng: random.Random | None
) -> int:
    for level in forced:
        if level != IDLE:
            return level
    drive = {level for level in senders if level != IDLE}
    if len(drive) == 1:
        return drive.pop()
    if not drive:
        return HIGH
    if clash is Clash.MIX and rng is not None:
        return rng.randint(LOW, HIGH)
    return LOW if clash is Clash.AND else HIGH


def receive(
    edges: Sequence[Edge],
    bit_ns: float,
    *,
    point: float = 0.5,
    rng: random.Random | None = None,
) -> Iterator[SampledByte]:
    """Yield the bytes that a receiver makes of a line.

    Args:
        edges: levels, in order of time; the line is high before and stays as it is behind.
        bit_ns: how long a bit is by the receiver's clock.
        point: where in a bit it samples.
        rng: draws how late it sees each falling edge; None: at once.
    """
    edges = [*edges, (math.inf, HIGH)]
    spread = bit_ns / OVERSAMPLING if rng is not None else 0.0
    k, n = 0, len(edges) - 1
    while k < n:
        begin, level = edges[k]
        k += 1
        if level != LOW:
            continue
        sample = begin + point * bit_ns
        if rng is not None:
            sample += spread * rng.random()
        while edges[k][0] <= sample:
            k += 1
        if edges[k - 1][1] == HIGH:  # too short for a start bit
            continue
        value = 0
        for bit in range(8):
            sample += bit_ns
            while edges[k][0] <= sample:
                k += 1
            value |= edges[k - 1][1] << bit
        sample += bit_ns
        while edges[k][0] <= sample:
            k += 1
        # without a stop bit it waits until the line is high again
        yield SampledByte(begin, value, edges[k - 1][1] == HIGH)


@dataclass(frozen=True, slots=True)
class Receiver:
    """A UART that listens: its rate, by how much its clock is off, where in a bit it samples."""

    baud: int
    error: float = 0.0
    point: float = 0.5

    @property
    def bit_ns(self) -> float:
        """How long a bit is by its clock."""
        return NS / self.baud * (1 + self.error)

    def hear(self, edges: Sequence[Edge], rng: random.Random | None = None) -> list[SampledByte]:
        """Return the bytes it makes of a line."""
        return list(receive(edges, self.bit_ns, point=self.point, rng=rng))
