"""A line by its bits, and what a UART hears of it: the physics behind torn frames.

Times are in bits of the receiver. A line is high when idle; a byte is a start bit (low), eight bits
with the least first, and a stop bit (high). A receiver finds the falling edge of a start bit and
samples each bit in its middle; when it has sampled the stop bit it waits for the next falling edge,
where the stop bit was missing for the line to be high first.
"""

from __future__ import annotations

from bisect import bisect_right
from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

BITS: Final = 10
"""Bits of a byte on the line, 8N1."""

MIDDLE: Final = 0.53
"""Where in a bit it is sampled: a UART of 16 samples a bit sees an edge up to one sample late."""

HIGH, LOW = 1, 0

FALLS: Final = frozenset(0xFF << k & 0xFF for k in range(9))
"""Bytes of one rising edge: what a UART makes of a line that falls low for a moment."""

Edge = tuple[float, int]
"""From a time on the line has a level."""


class Sampled(NamedTuple):
    """A byte as it was received, when its start bit began, and whether it had a stop bit."""

    t: float
    value: int
    stop: bool


def _changes(value: int) -> tuple[tuple[int, int], ...]:
    """Return where a byte's level changes: number of the bit, and the level from there on."""
    levels = [HIGH, LOW, *(value >> k & 1 for k in range(8)), HIGH]
    return tuple((k - 1, levels[k]) for k in range(1, 11) if levels[k] != levels[k - 1])


_CHANGES: Final = tuple(_changes(value) for value in range(256))


def sent(data: bytes, bit: float = 1.0, begin: float = 0.0, rise: float = 0.0) -> list[Edge]:
    """Return the edges of bytes in a row.

    Args:
        data: the bytes.
        bit: how long a bit of the sender is.
        begin: when the first start bit begins.
        rise: by how much rising edges are late.
    """
    edges: list[Edge] = []
    for byte in data:
        for k, level in _CHANGES[byte]:
            t = begin + k * bit + (rise if level == HIGH else 0.0)
            if edges and edges[-1][0] >= t:  # it has not risen when it is to fall again
                edges.pop()
            else:
                edges.append((t, level))
        begin += BITS * bit
    return edges


def both(
    first: Sequence[Edge], second: Sequence[Edge], of: Callable[[int, int], int]
) -> list[Edge]:
    """Return the edges of a line that two drive; ``of`` is what is there where they do."""
    levels = [HIGH, HIGH]
    out: list[Edge] = []
    before = HIGH
    # two rows in order are sorted at once in half the time that heapq.merge takes
    changes = [(t, 0, level) for t, level in first] + [(t, 1, level) for t, level in second]
    for t, who, level in sorted(changes):
        levels[who] = level
        now = of(*levels)
        if now == before:
            continue
        if out and out[-1][0] == t:
            out.pop()
        else:
            out.append((t, now))
        before = now
    return out


def received(edges: Sequence[Edge], middle: float = MIDDLE, until: float = 1e18) -> list[Sampled]:
    """Return the bytes that a receiver makes of a line, as long as they begin before ``until``."""
    times = [t for t, _ in edges]
    out: list[Sampled] = []
    k, n = 0, len(edges)
    while k < n:
        begin, level = edges[k]
        if begin >= until:
            break
        if level == HIGH:
            k += 1
            continue
        at = bisect_right(times, begin + middle) - 1
        if edges[at][1] == HIGH:  # too short for a start bit
            k = at + 1
            continue
        value = 0
        for bit in range(8):
            at = bisect_right(times, begin + middle + bit + 1, at) - 1
            value |= edges[at][1] << bit
        at = bisect_right(times, begin + middle + BITS - 1, at) - 1
        out.append(Sampled(begin, value, stop=edges[at][1] == HIGH))
        k = at + 1
    return out


def heard(edges: Sequence[Edge], middle: float = MIDDLE) -> bytes:
    """Return the bytes alone."""
    return bytes(byte.value for byte in received(edges, middle))
