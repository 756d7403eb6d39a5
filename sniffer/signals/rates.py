"""Length of a bit, polarity and parity, found from the edges alone.

Every common pulse is a candidate for the bit, and so are its parts down to a fifth. Each is fitted
to all pulses by least squares, decoded both ways up, and the one with the best frames wins; of
equal ones a rate that servos have, then the slowest: a faster one explains the same edges as
multiples.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.ground.limits import BAUDS
from sniffer.signals.glitches import SHORTEST, GlitchFilter
from sniffer.signals.uart import BREAK, NO_PARITY, Receiver

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator

    from sniffer.ground.model import F64, I64
    from sniffer.signals.uart import UartBytes

STANDARD: Final = (
    *(300, 600, 1200, 2400, 4800, 9600, 14400, 19200, 28800, 31250, 38400, 57600, 62500, 76800),
    *(100000, 115200, 125000, 153600, 200000, 230400, 250000, 400000, 460800, 500000, 576000),
    *(625000, 750000, 921600, 1000000, 1250000, 1500000, 2000000, 2500000, 3000000, 4000000),
    *(4500000, 6000000, 8000000, 10000000),
)
"""Rates that UARTs are set to, in baud: those of PCs, and divisors of usual crystals."""

NEAR: Final = 0.035
"""A measured rate is taken for a usual one this near: two senders, each 2 % off, are averaged, and
usual rates lie further apart."""

EDGES: Final = 4000
"""Edges that are looked at: some thousand bytes."""

EDGES_LEAST: Final = 8
"""Edges that tell a rate: two or three bytes."""

SPREAD_NONE: Final = 0.29
"""Spread of edges that lie anywhere within a bit: 1/sqrt(12)."""

ROUNDED: Final = 0.41
"""Spread that samples alone give a pulse, in samples: both ends are rounded, sqrt(2/12)."""

SPREAD_FAR: Final = 0.2
"""Spread from which on a length is not tried: such edges lie nearly anywhere."""

COMMON: Final = 0.01
"""Share of the pulses from which on a length is common."""

KINDS_MOST: Final = 8
"""Lengths of pulses, the most common first, that are tried: bytes have nine."""

PARTS: Final = (1, 2, 3, 4, 5)
"""Parts of a pulse that may be one bit: F0 alone has only pulses of five."""

SAMPLES_LEAST: Final = 3
"""Samples of a bit below which edges say too little: one of them is a third of it."""

GOOD_ENOUGH: Final = 0.9
"""Share of good frames below which a parity bit is looked for."""


class BitTime(NamedTuple):
    """How a wire is to be read, and how well that fits.

    ``bit`` is its length in ticks; ``baud`` the usual rate that is meant, ``measured`` what was
    measured; ``good`` the share of bytes without an error; ``spread`` that of the edges about the
    borders of bits, in bits.
    """

    bit: float
    baud: int
    measured: float
    good: float
    spread: float
    size: int
    invert: bool
    parity: str = NO_PARITY


class WireEdges(NamedTuple):
    """Edges of one channel: the level before them, and up to when they are known, in ticks."""

    level: int
    edges: I64
    until: int


def snapped(measured: float, preferred: Collection[int]) -> int:
    """Return the rate that is meant by a measured one: preferred, usual, or just that."""
    for known in (preferred, STANDARD):
        near = min(known, key=lambda rate: abs(rate / measured - 1), default=0)
        if near and abs(near / measured - 1) < NEAR:
            return near
    return round(measured)


def received(found: WireEdges, told: BitTime, glitch: float | None = None) -> UartBytes:
    """Return the bytes in some edges; ``glitch`` is the shortest pulse that counts, in ticks."""
    glitches = GlitchFilter(SHORTEST * told.bit if glitch is None else glitch)
    receiver = Receiver(told.bit, found.level, invert=told.invert, parity=told.parity)
    return receiver.take(*glitches.take(found.edges, found.until, last=True))


def bit_time(
    found: WireEdges,
    tick_ns: float,
    *,
    sample: float = 0,
    preferred: Collection[int] = (),
    baud: int | None = None,
    invert: bool = False,
    glitch: float | None = None,
) -> BitTime | None:
    """Return how to read a wire; None where too little is said on it.

    Args:
        found: its edges; the first ``EDGES`` are looked at.
        tick_ns: length of a tick.
        sample: ticks a sample, 0 if that is not known.
        preferred: rates that are likelier than others.
        baud: the rate, where it is known.
        invert: the line idles low; else that is found.
        glitch: the shortest pulse that counts, in ticks.
    """
    if len(found.edges) > EDGES:
        found = WireEdges(found.level, found.edges[:EDGES], int(found.edges[EDGES - 1]))
    second = 1e9 / tick_ns
    if baud is not None:
        bit, spread = _fitted(found, second / baud, glitch)
        if abs(bit / (second / baud) - 1) > NEAR:
            bit = second / baud
        bits = [(bit, spread)]
    elif len(found.edges) < EDGES_LEAST:
        return None
    else:
        bits = list(_candidates(found, SAMPLES_LEAST * 0.8 * sample, glitch))
    near = [(b, spread) for b, spread in bits if spread - ROUNDED * sample / b < SPREAD_FAR]
    bits = near or bits
    ways = (True,) if invert else (False, True)

    def best(parities: Iterable[str]) -> BitTime | None:
        tried = [
            told
            for bit, spread in bits
            for way in ways
            for parity in parities
            if (told := _tried(found, bit, spread, way, parity, second, preferred, baud, glitch))
        ]
        return max(tried, key=lambda told: _score(told, sample, preferred), default=None)

    told = best((NO_PARITY,))
    # a byte with parity passes for one without of a rate a tenth slower, which nobody uses
    if told is None or (told.good >= GOOD_ENOUGH and _is_usual(told.baud, preferred)):
        return told
    other = best(("E", "O"))
    if other is None or other.good < GOOD_ENOUGH or not _is_usual(other.baud, preferred):
        return told
    return max((told, other), key=lambda told: _score(told, sample, preferred))


def shortest_pulse(found: WireEdges) -> float:
    """Return about how long the shortest common pulses are, in ticks; 0 where there are none."""
    gaps = np.sort(np.diff(found.edges[:EDGES]))
    return float(gaps[len(gaps) // 20]) if len(gaps) else 0.0


def _tried(
    found: WireEdges,
    bit: float,
    spread: float,
    invert: bool,
    parity: str,
    second: float,
    preferred: Collection[int],
    baud: int | None,
    glitch: float | None,
) -> BitTime | None:
    measured = second / bit
    if baud is None and measured < BAUDS[0] * (1 - NEAR):
        return None  # a table that names a wrong unit of time has bits of seconds
    told = BitTime(
        bit, baud or snapped(measured, preferred), measured, 0, spread, 0, invert, parity
    )
    got = received(found, told, glitch)
    if not len(got.value):
        return None
    good = 1 - np.count_nonzero(got.is_bad) / len(got.value)
    # a line that is low for long is no byte, and no proof against a rate when it happens once
    if np.count_nonzero(got.flags == BREAK) == 1 and len(got.value) > EDGES_LEAST:
        good += 1 / len(got.value)
    return told._replace(good=good, size=len(got.value))


def _is_usual(baud: int, preferred: Collection[int]) -> bool:
    return baud in STANDARD or baud in preferred


def _score(told: BitTime, sample: float, preferred: Collection[int]) -> float:
    usual = 0.05 * (told.baud in STANDARD) + 0.03 * (told.baud in preferred)
    spread = max(told.spread - ROUNDED * sample / told.bit, 0)
    return told.good - 2 * spread + 0.005 * float(np.log2(told.bit)) + usual


def _candidates(
    found: WireEdges, least: float, glitch: float | None
) -> Iterator[tuple[float, float]]:
    """Yield lengths of a bit that would explain the pulses, in ticks, and the spread of each."""
    gaps = np.diff(found.edges).astype(np.float64)
    gaps = gaps[gaps > (glitch or 0)]
    kinds = np.round(np.log2(gaps) * 12).astype(np.int64)  # 6 % wide
    known, count = np.unique(kinds, return_counts=True)
    tried: list[float] = []
    common = count >= max(2, COMMON * len(gaps))
    for kind in known[common][np.argsort(-count[common], kind="stable")][:KINDS_MOST]:
        pulse = float(np.median(gaps[np.abs(kinds - kind) <= 1]))
        for part in PARTS:
            if pulse / part < least:
                continue
            bit, spread = _fitted(found, pulse / part, glitch)
            if not any(abs(bit / other - 1) < 0.01 for other in tried):
                tried.append(bit)
                yield bit, spread


def _fitted(found: WireEdges, bit: float, glitch: float | None) -> tuple[float, float]:
    """Fit the length of a bit to pulses of one to nine bits, the short ones first."""
    glitches = GlitchFilter(SHORTEST * bit if glitch is None else glitch)
    gaps: F64 = np.diff(glitches.take(found.edges, found.until, last=True)[0]).astype(np.float64)
    spread = SPREAD_NONE
    for reach in (3.5, 6.5, 9.5, 9.5):
        pulses = gaps[gaps < reach * bit]
        bits = np.maximum(1, np.rint(pulses / bit))
        near = np.abs(pulses / bit - bits) < 0.35
        if np.count_nonzero(near) < 4:
            continue  # F0 has no pulse of a single bit
        bit = float((pulses[near] * bits[near]).sum() / (bits[near] ** 2).sum())
        spread = float(np.sqrt(np.mean((pulses / bit - bits) ** 2)))
    return bit, spread
