"""Two answers at once on one line: what a tap hears where a servo and its twin speak together.

What answers of one servo begin with (header, id, length) is the same each time, so what two of them
give that begin some bits apart is known: one look-up tells whether a torn answer begins like that.
"""

from __future__ import annotations

import functools
import itertools
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.diagnosis.physics.comparing import bits_wrong
from sniffer.diagnosis.physics.uart import BITS, both, received, sent

if TYPE_CHECKING:
    from collections.abc import Sequence

AND, OR = "AND", "OR"
"""Who pulls low wins (open collector); or who pulls high."""

FINE: Final = 16
"""Steps of a bit by which the second one may come later, up to a byte; beyond that a quarter.

All edges are that far apart: wherever near the middle of a bit the tap samples, it sees the same.
"""

LEAST: Final = 3
"""Bytes that must agree: three by chance are one in ten thousand, with all that is tried."""

MOST: Final = 6
"""Bytes that are compared."""


WRONG: Final = 3
"""Bits that two answers must make wrong: fewer are a flipped bit or two."""


class Mix(NamedTuple):
    """How two answers give what was heard: by how many bits the second one is later, and how."""

    shift: float
    how: str


@functools.lru_cache(maxsize=256)
def _mixes(begin: bytes, other: bytes) -> dict[bytes, Mix]:
    """Return what is heard of two answers that begin so, by the bytes that are sure."""
    out: dict[bytes, Mix] = {}
    first = sent(begin)
    sure = BITS * min(len(begin), len(other))
    steps = [k / FINE for k in range(1, FINE * BITS)]
    steps += [BITS + k / 4 for k in range(4 * (sure - 2 * BITS))]
    for shift in steps:
        second = sent(other, begin=shift)
        for how, of in ((AND, min), (OR, max)):
            edges = both(first, second, of)
            got = bytes(b.value for b in received(edges) if b.t + BITS <= sure)[:MOST]
            # what only lacks its first bytes is not two
            lost = range(1, min(4, len(begin)))
            lacks = any(begin[k:].startswith(got[: len(begin) - k]) for k in lost)
            if len(got) >= LEAST and bits_wrong(got, begin) >= WRONG and not lacks:
                out.setdefault(got, Mix(shift, how))
    return out


def mix_of(got: bytes, begin: bytes, other: bytes) -> Mix | None:
    """Return how two answers that begin so, the other later, give what was heard, if they do."""
    known = _mixes(begin, other)
    for size in range(min(MOST, len(got)), LEAST - 1, -1):
        if (found := known.get(got[:size])) is not None:
            return found
    return None


def beginning(alike: Sequence[bytes]) -> bytes:
    """Return what answers have in common at their beginning, at most some bytes."""
    if not alike:
        return b""
    columns = itertools.takewhile(lambda column: len(set(column)) == 1, zip(*alike, strict=False))
    return bytes(column[0] for column in itertools.islice(columns, MOST + 2))
