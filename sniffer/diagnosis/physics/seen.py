"""Which misread bits of a line of text are seen at all: a digit that became another digit is not.

Frames without a checksum hold with another number in them. Of what is seen of their misread bits
the upper ones, which make a sign that stands in no line, are more than their share.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

BITS: Final = 8

Shares = tuple[tuple[float, ...], ...]
"""For each way in which bytes may be altered: which part of what is seen each bit is, 0 to 7."""

ALIKE: Final[Shares] = ((1 / BITS,) * BITS,)
"""A checksum shows each bit as well as another."""


def shares_of(frames: Iterable[bytes], signs: frozenset[int]) -> Shares:
    """Return what each bit is of those that are seen in lines of text, of frames and their signs.

    One bit of a byte is altered, or a byte becomes any other, which is one bit from a sign.
    """
    if not signs:
        return ALIKE
    said = Counter(b"".join(frames))
    one = [0] * BITS
    any_other = [0] * BITS
    for bit in range(BITS):
        one[bit] = sum(n for byte, n in said.items() if byte ^ 1 << bit not in signs)
    for byte in set(range(256)) - signs:
        near = [bit for bit in range(BITS) if byte ^ 1 << bit in signs]
        if len(near) == 1:
            any_other[near[0]] += 1
    ways = [counts for counts in (one, any_other) if any(counts)]
    return tuple(tuple(n / sum(counts) for n in counts) for counts in ways) or ALIKE


def chance_of(seen: Sequence[Shares], bits: Iterable[int]) -> float:
    """Return how likely what is seen is one of some bits, were all of them altered alike."""
    some = tuple(bits)
    return max(
        (
            sum(sum(shares[k][bit] for bit in some) for shares in seen) / len(seen)
            for k in range(min(map(len, seen), default=0))
        ),
        default=len(some) / BITS,
    )
