"""How far damage goes with motion: a number always, and less where both come in episodes."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sniffer.diagnosis.rules.line.motors import beyond_chance

LEVELS = st.floats(0, 1e3, allow_nan=False)


@given(st.lists(st.tuples(LEVELS, st.integers(0, 500), st.integers(0, 10**6)), min_size=12))
def test_whatever_moves_and_whatever_is_damaged_there_is_a_number(
    rows: list[tuple[float, int, int]],
) -> None:
    level, hits, said = np.array(rows, float).T
    assert all(math.isfinite(value) for value in beyond_chance(level, hits, said))


def test_of_buckets_that_are_like_the_ones_before_not_each_tells_anew() -> None:
    """Both rest for half of the time: in one go, or now and then."""
    said = np.full(40, 1000.0)
    in_one_go = np.repeat([0.0, 1.0], 20)
    now_and_then = np.random.default_rng(1).permutation(in_one_go)
    once, _, _ = beyond_chance(in_one_go, 3 * in_one_go, said)
    often, _, _ = beyond_chance(now_and_then, 3 * now_and_then, said)
    assert 0 < once < often
