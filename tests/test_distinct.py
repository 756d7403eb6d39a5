"""Distinct numbers are found alike, however they are found."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sniffer.ground.distinct import among, distinct, within

NUMBERS = st.lists(st.integers(-3, 40)) | st.lists(st.integers(-(2**62), 2**62))


@given(NUMBERS)
def test_distinct_numbers_are_those_that_sorting_finds(numbers: list[int]) -> None:
    column = np.array(numbers, np.int64)
    found, which, times = distinct(column)
    assert found.tolist() == sorted(set(numbers))
    assert found[which].tolist() == numbers
    assert times.tolist() == [numbers.count(n) for n in sorted(set(numbers))]


@given(NUMBERS, NUMBERS)
def test_who_is_among_a_few_is_told_as_numpy_tells_it(numbers: list[int], few: list[int]) -> None:
    column = np.array(numbers, np.int64)
    assert among(column, few).tolist() == np.isin(column, few).tolist()


def test_within_tells_what_numpy_tells_and_loads_less() -> None:
    draw = np.random.default_rng(5)
    for n, m in ((0, 0), (0, 3), (5, 0), (300, 40), (40, 300)):
        column, others = draw.integers(-50, 50, n), draw.integers(-50, 50, m)
        assert within(column, others).tolist() == np.isin(column, others).tolist()
    assert within(np.array([3, 7]), (7,)).tolist() == [False, True]
