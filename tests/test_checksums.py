"""A checksum over columns is what it is over the bytes of one packet."""

from __future__ import annotations

import itertools
from typing import Final

import numpy as np
import pytest

from sniffer.ground.checksums import COMPLEMENT_SUM, MANY, SUM16, XOR7, XOR8, Checksum

NOT_SUM16: Final = Checksum(
    "~(sum of the bytes) & 0xFFFF", sum, np.add, np.subtract, lambda s: ~s & 0xFFFF, width=2
)


@pytest.mark.parametrize("most", [2, 4, 9, 40])
@pytest.mark.parametrize("checksum", [COMPLEMENT_SUM, XOR7, XOR8, NOT_SUM16, SUM16])
def test_the_sums_of_many_stretches_are_those_of_each_by_itself(
    checksum: Checksum, most: int
) -> None:
    rng = np.random.default_rng(most)
    sizes = rng.integers(0, most + 1, 2 * MANY)
    edges = np.cumsum(np.append(0, sizes))
    block = rng.integers(0, 256, int(edges[-1]), np.uint8)
    found = checksum.over(block, [(edges[:-1], edges[1:])])
    data = block.tobytes()
    assert found.tolist() == [checksum(data[a:b]) for a, b in itertools.pairwise(edges)]


@pytest.mark.parametrize("checksum", [COMPLEMENT_SUM, NOT_SUM16])
@pytest.mark.parametrize("step", [1, 60])
def test_a_sum_is_found_where_it_stands_also_where_candidates_lie_over_each_other(
    checksum: Checksum, step: int
) -> None:
    rng = np.random.default_rng(step)
    data = rng.integers(0, 256, 6000, np.uint8)
    first = np.arange(0, len(data) - 100, step)
    for at in first[::7]:  # so some hold
        value = checksum(data[at : at + 50].tobytes())
        data[at + 50 : at + 50 + checksum.width] = np.frombuffer(
            value.to_bytes(checksum.width, "little"), np.uint8
        )
    good = checksum.good(data, first, first + 50)
    for at, holds in zip(first.tolist(), good.tolist(), strict=True):
        sent = int.from_bytes(data[at + 50 : at + 50 + checksum.width].tobytes(), "little")
        assert holds == (sent == checksum(data[at : at + 50].tobytes()))
    assert 0 < good.sum() < len(good)
