"""Two requests at once on one line: whether torn bytes are, bit by bit, what a tap hears of them.

The second one begins somewhere within the first, and who pulls low wins; of drivers that are as
strong as each other nobody knows what they give. The line is looked at in quarters of a bit: it is
a number of which each binary digit is one.
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.physics.comparing import alike, header_of
from sniffer.diagnosis.physics.uart import BITS

if TYPE_CHECKING:
    from collections.abc import Sequence

FINE: Final = 4
"""Parts of a bit in which the line is looked at, and by which the second one may come later."""

MIDDLE: Final = FINE // 2

BYTE: Final = FINE * BITS

_SAMPLED: Final = tuple(
    sum((byte >> n & 1) << FINE * n for n in range(BITS - 2)) for byte in range(256)
)
"""The bits of each byte where a receiver looks at them."""


def of_two(got: bytes, requests: Sequence[bytes]) -> bool:
    """Tell whether two of some requests, one begun within the other, make exactly these bytes.

    The first byte that tells requests apart must be there as it was sent, and something must be
    neither the one's beginning nor the other's end: a tap that lost bytes leaves nothing else.
    """
    shared = header_of(requests) if requests else 0
    return any(
        _makes(got, first, second, head)
        for first in requests
        if (head := alike(got, first)) > shared
        for second in requests
        if len(got) < len(first) + len(second)
        if head + alike(got[::-1], second[::-1]) < len(got)
    )


@functools.lru_cache(maxsize=1 << 12)
def _makes(got: bytes, first: bytes, second: bytes, head: int) -> bool:
    """Tell whether the second, begun somewhere within the first, gives these bytes.

    It begins in the first byte that is not as it was sent, or little before: of two bytes that it
    leaves as they are all bits would have to be low where its own are.
    """
    longest = BYTE * len(first)
    since, until = max(BYTE, BYTE * (head - 2)), min(longest, BYTE * (head + 1))
    if len(got) > len(first):  # the second ends last; a byte may be lost in between, or won
        ends = BYTE * (len(got) - len(second))
        since, until = max(since, ends - BYTE), min(until, ends + 2 * BYTE)
    idle = (1 << 2 * longest + BYTE * len(second)) - 1
    one, other = _levels(first, idle), _levels(second, idle)
    return any(
        _is_heard(one & (other << shift | (1 << shift) - 1) & idle, idle, got)
        for shift in range(since, until)
    )


def _levels(data: bytes, idle: int) -> int:
    """Return the levels of bytes in a row, the first ones in the lowest digits, on an idle line."""
    level = idle
    for k, byte in enumerate(data):
        for n, bit in enumerate((0, *(byte >> b & 1 for b in range(BITS - 2)))):
            if not bit:
                level &= ~(((1 << FINE) - 1) << BYTE * k + FINE * n)
    return level


def _is_heard(line: int, idle: int, got: bytes) -> bool:
    """Tell whether a receiver makes just these bytes of a line."""
    falls = ~line & (line << 1 | 1) & idle
    at = 0
    for byte in got:
        at = _start(line, falls, at)
        if at < 0:
            return False
        if (line >> at + MIDDLE + FINE) & _SAMPLED[0xFF] != _SAMPLED[byte]:
            return False
        at += MIDDLE + FINE * (BITS - 1)
    return _start(line, falls, at) < 0


def _start(line: int, falls: int, at: int) -> int:
    """Return where the first start bit at a place or behind it begins; -1: nowhere."""
    while rest := falls >> at:
        at += (rest & -rest).bit_length() - 1
        if not line >> at + MIDDLE & 1:
            return at
        at += 1  # too short for one
    return -1
