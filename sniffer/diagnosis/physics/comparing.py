"""How far two rows of bytes are the same."""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

ALTERED: Final = 0.5
"""Share of bytes that are still as they were in a request that noise has altered."""

SEQUENCE: Final = 6
"""Bytes of which a sequence is that comes again in a conversation, and not in noise."""

EVEN: Final = 5.0
"""Standard deviations that random bytes are beyond a few times in a million."""

REPEATS: Final = 0.15
"""Part of such sequences that come again in a conversation; in noise there is none."""

VALUES: Final = 5
"""Bytes of the head that tell which request it is; behind it may stand other values."""


def alike(a: bytes, b: bytes) -> int:
    """Return how many first bytes are the same."""
    n = min(len(a), len(b))
    return next((k for k in range(n) if a[k] != b[k]), n)


def bits_wrong(got: bytes, meant: bytes) -> int:
    """Return how many bits differ, of the bytes that both have."""
    n = min(len(got), len(meant))
    return (int.from_bytes(got[:n], "big") ^ int.from_bytes(meant[:n], "big")).bit_count()


def is_altered(got: bytes, whole: bytes, still: float = ALTERED) -> bool:
    """Tell whether bytes are those of a request, some altered; ``still``: which part is not."""
    same = sum(a == b for a, b in zip(got, whole, strict=False))
    return got != whole and len(got) == len(whole) and same >= still * len(whole)


def is_even(data: bytes) -> bool:
    """Tell whether all values come as often as among random bytes: packed or encrypted ones.

    By Pearson's test: the squares have 255 degrees of freedom, so their mean is that and their
    variance twice that. The most even talk of the benchmark that is read at another rate is 1700
    deviations from it.
    """
    counts = np.bincount(np.frombuffer(data, np.uint8), minlength=256)
    freedom = len(counts) - 1
    squares = counts.var() * len(counts) / counts.mean()
    return bool(squares < freedom + EVEN * math.sqrt(2 * freedom))


def header_of(known: Sequence[bytes]) -> int:
    """Return how many first bytes several requests share: a header tells nothing."""
    return min((alike(known[0], other) for other in known[1:]), default=0)


def repeated(data: bytes) -> float:
    """Return which part of short sequences is met more than once; runs of one value are none."""
    seen = Counter(data[k : k + SEQUENCE] for k in range(len(data) - SEQUENCE + 1))
    telling = {s: n for s, n in seen.items() if len(set(s)) > 2}
    total = sum(telling.values())
    return sum(n for n in telling.values() if n > 1) / total if total else 0.0


def _begun(got: bytes, whole: bytes) -> int:
    """Return how many bytes are the beginning of a request like a known one.

    Behind its head stand values, which are any; what ends as the request does lacks its middle.
    """
    same = alike(got, whole)
    most = min(len(got), len(whole) - 1)
    if same < VALUES or (same < most and got[most - 1] == whole[-1]):
        return same
    return max(same, most)


def are_beginnings(got: bytes, known: Sequence[bytes]) -> bool:
    """Tell whether bytes are the beginnings of one or more requests, one behind the other."""
    reached = {0}
    for at in range(len(got)):
        if at in reached:
            size = max((_begun(got[at:], whole) for whole in known), default=0)
            reached.update(range(at + 1, at + size + 1))
    return len(got) in reached
