"""A checksum over columns is what it is over the bytes of one packet."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from sniffer.ground.checksums import COMPLEMENT_SUM, MANY, XOR7, XOR8, Checksum


@pytest.mark.parametrize("most", [2, 4, 9, 40])
@pytest.mark.parametrize("checksum", [COMPLEMENT_SUM, XOR7, XOR8])
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
