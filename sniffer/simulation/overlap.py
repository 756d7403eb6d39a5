"""Two who speak at once on one line, and what a receiver makes of it, bit by bit.

Any sender can pull the line down, as with open collectors, and as two drivers on TTL fight it out:
it is high only while all of them let it be.
"""

from __future__ import annotations

import bisect
from typing import TYPE_CHECKING, NamedTuple

from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


class MixedByte(NamedTuple):
    """What a receiver reads; without its stop bit it is damaged for certain."""

    t_start_ns: int
    t_end_ns: int
    value: int
    has_stop: bool


def overheard(senders: Iterable[tuple[int, bytes]], baud: int) -> list[MixedByte]:
    """Return what an 8N1 receiver reads where senders speak, each from its own time in ns on.

    It waits for the line to fall, and takes each bit in its middle.
    """
    lows = _merged(low for t_ns, data in senders for low in _lows(t_ns, data, baud))
    starts = [start for start, _ in lows]
    out: list[MixedByte] = []
    free = None
    for start, _ in lows:
        if free is not None and start < free:
            continue
        bits = [_is_low(lows, starts, start + _half(2 * n + 1, baud)) for n in range(10)]
        if not bits[0]:
            continue  # too short for a start bit: two senders just missed each other
        value = sum(1 << n for n, low in enumerate(bits[1:9]) if not low)
        begins = max(start, out[-1].t_end_ns) if out else start
        out.append(MixedByte(begins, begins + _half(20, baud), value, not bits[9]))
        free = start + _half(19, baud)
    return out


def _half(halves: int, baud: int) -> int:
    """Return how long so many half bits take."""
    return -(-halves * NS // (2 * baud))


def _lows(t_ns: int, data: bytes, baud: int) -> Iterator[tuple[int, int]]:
    """Yield when a sender pulls the line down."""
    for at, byte in enumerate(data):
        for n in range(9):
            if n == 0 or not byte >> (n - 1) & 1:
                bit = 20 * at + 2 * n
                yield t_ns + _half(bit, baud), t_ns + _half(bit + 2, baud)


def _merged(lows: Iterable[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return stretches of time that do not touch."""
    out: list[tuple[int, int]] = []
    for start, end in sorted(lows):
        if out and start <= out[-1][1]:
            out[-1] = out[-1][0], max(end, out[-1][1])
        else:
            out.append((start, end))
    return out


def _is_low(lows: list[tuple[int, int]], starts: list[int], t_ns: int) -> bool:
    at = bisect.bisect_right(starts, t_ns) - 1
    return at >= 0 and t_ns < lows[at][1]
