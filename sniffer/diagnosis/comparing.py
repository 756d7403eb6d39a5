"""How far two rows of bytes are the same."""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Sequence

ALTERED: Final = 0.5
"""Share of bytes that are still as they were in a request that noise has altered."""

SEQUENCE: Final = 6
"""Bytes of which a sequence is that comes again in a conversation, and not in noise."""

VALUES: Final = 256
"""Those of a byte."""

EVEN: Final = 5.0
"""Standard deviations that random bytes are beyond a few times in a million."""

REPEATS: Final = 0.15
"""Part of such sequences that come again in a conversation; in noise there is none."""


def alike(a: bytes, b: bytes) -> int:
    """Return how many first bytes are the same."""
    n = min(len(a), len(b))
    return next((k for k in range(n) if a[k] != b[k]), n)


def bits_wrong(got: bytes, meant: bytes) -> int:
    """Return how many bits differ, of the bytes that both have."""
    return sum((a ^ b).bit_count() for a, b in zip(got, meant, strict=False))


def is_altered(got: bytes, whole: bytes, still: float = ALTERED) -> bool:
    """Tell whether bytes are those of a request, some altered; ``still``: which part is not."""
    same = sum(a == b for a, b in zip(got, whole, strict=False))
    return got != whole and len(got) == len(whole) and same >= still * len(whole)


def is_even(data: bytes) -> bool:
    """Tell whether all values come as often as among random bytes: packed or encrypted ones.

    By Pearson's test: the squares have 255 degrees of freedom, so their mean is that and their
    variance twice that. What is said on a bus is far from it, at whatever rate it is read.
    """
    expected = len(data) / VALUES
    squares = sum((data.count(k) - expected) ** 2 for k in range(VALUES)) / max(expected, 1e-9)
    return squares < VALUES - 1 + EVEN * math.sqrt(2 * (VALUES - 1))


def header_of(known: Sequence[bytes]) -> int:
    """Return how many first bytes several requests share: a header tells nothing."""
    return min((alike(known[0], other) for other in known[1:]), default=0)


def repeated(data: bytes) -> float:
    """Return which part of short sequences is met more than once; runs of one value are none."""
    seen = Counter(data[k : k + SEQUENCE] for k in range(len(data) - SEQUENCE + 1))
    telling = {s: n for s, n in seen.items() if len(set(s)) > 2}
    total = sum(telling.values())
    return sum(n for n in telling.values() if n > 1) / total if total else 0.0
