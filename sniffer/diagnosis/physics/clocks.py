"""A servo whose clock is off: its answers as they would be heard, compared with what was heard."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.diagnosis.physics.comparing import alike, bits_wrong
from sniffer.diagnosis.physics.uart import MIDDLE, heard, sent

if TYPE_CHECKING:
    from collections.abc import Sequence

OFF: Final = tuple(k / 200 for k in (*range(-20, -4), *range(5, 21)))
"""By how much a clock may be off, 2.5 to 10 %: less is no trouble, more is another rate."""

RISES: Final = (0.0, 0.15, 0.25)
"""By how many bits rising edges may be late beside that: cables and pull-ups make a slow clock
worse."""

MIDDLES: Final = (0.5, MIDDLE, 0.56)
"""Where in a bit the tap may sample."""

BEGINNING: Final = 6
"""Bytes that are compared at most: header, id, length; what an answer measures is not known."""

WRONG: Final = 5
"""Bits that must be wrong by an exact clock: fewer may be a flipped bit or two."""

LEFT: Final = 0.3
"""Part of the wrong bits that the clock may leave unexplained."""

GAIN: Final = 2
"""Or: so many bytes from the first on that only the clock explains."""

MOST: Final = 0.6
"""Part of the torn answers that one clock must explain."""

LEAST: Final = 3
"""Bytes of an answer that never change, or there is nothing to compare."""

FEW: Final = 2
"""Wrong bits from which on an answer is worth a look."""

WANDERS: Final = 0.0101
"""By how much a clock may wander meanwhile: it warms up, and where a bit is sampled varies."""

LOOKED: Final = 16
"""Torn answers of a servo that are looked at."""


class ClockOff(NamedTuple):
    """How far a clock is off (bits longer: above 0), how many torn answers that explains."""

    off: float
    explained: int
    tried: int


@functools.lru_cache(maxsize=1 << 13)
def _as_heard(frame: bytes, off: float, rise: float, middle: float) -> bytes:
    return heard(sent(frame, 1.0 + off, rise=rise), middle)


@functools.lru_cache(maxsize=64)
def clock_of(torn: tuple[tuple[bytes, tuple[bytes, ...]], ...]) -> ClockOff | None:
    """Return the clock that explains torn answers, each with sound ones like it; None: none does.

    Where a clock explains more of them, or as many and is nearer to the exact one, it is taken.
    """
    tried = []
    for got, sound in torn:
        if not sound:
            continue
        size = min(max(alike(one, sound[0]) for one in sound[1:] or sound), BEGINNING)
        begun = {one[: BEGINNING + 2] for one in sound}
        exact = [_exact(got, one, size) for one in begun]
        if exact and size >= LEAST and min(one.wrong for one in exact) >= FEW:
            tried.append((got, exact))
    if not tried:
        return None
    by_each = [_offs(got, exact) for got, exact in tried]
    best = ClockOff(0.0, 0, len(tried))
    for off in sorted(OFF, key=abs):
        count = sum(any(abs(other - off) <= WANDERS for other in offs) for offs in by_each)
        if count > best.explained:
            best = ClockOff(off, count, len(tried))
    return best if best.explained >= MOST * len(tried) else None


def _offs(got: bytes, exact: Sequence[_Exact]) -> list[float]:
    """Return by how much a clock may be off that explains one torn answer."""
    return [
        off
        for off in OFF
        if any(
            _explains(got, one, off, rise)
            for rise in (RISES if off > 0 else RISES[:1])
            for one in exact
        )
    ]


class _Exact(NamedTuple):
    """A sound answer, how many bytes of it never change, and how a torn one differs from it."""

    data: bytes
    size: int
    wrong: int
    common: int


def _exact(got: bytes, one: bytes, size: int) -> _Exact:
    # one that only lacks its first byte is no clock's doing
    common = max(alike(got, one), alike(got, one[1:]))
    wrong = min(bits_wrong(got, one[:size]), bits_wrong(got, one[1:size]))
    return _Exact(one, size, wrong, common)


def _explains(got: bytes, one: _Exact, off: float, rise: float) -> bool:
    told = tuple(_as_heard(one.data, off, rise, middle) for middle in MIDDLES)
    if _agrees(got, told) >= one.common + GAIN:
        return True
    # a first byte that became a blank, or none, is nothing that a tear begins with
    behind = tuple(some[1:] for some in told if some[:1] != one.data[:1])
    if behind and _agrees(got, behind) >= one.common + GAIN:
        return True
    left = min(bits_wrong(got, some[: one.size]) for some in told)
    return one.wrong >= WRONG and left <= LEFT * one.wrong


def _agrees(got: bytes, told: Sequence[bytes]) -> int:
    """Return up to where each byte is as one of several would have it.

    A receiver finds each start bit anew, a sixteenth of a bit sooner or later.
    """
    n = min(len(got), min(map(len, told)))
    return next((k for k in range(n) if all(some[k] != got[k] for some in told)), n)
