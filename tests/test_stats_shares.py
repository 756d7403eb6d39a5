"""A share of few has an interval."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer.statistics.commands import wilson


@pytest.mark.parametrize(
    ("k", "n", "low", "high"),
    # R: binom::binom.wilson(k, n), rounded to six places
    [(0, 10, 0.0, 0.277533), (1, 10, 0.017876, 0.404150), (10, 10, 0.722467, 1.0)],
)
def test_a_share_has_the_interval_of_wilson(k: int, n: int, low: float, high: float) -> None:
    assert wilson(k, n) == pytest.approx((low, high), abs=1e-6)


@given(n=st.integers(0, 10**6), data=st.data())
def test_the_share_itself_lies_in_its_interval(n: int, data: st.DataObject) -> None:
    k = data.draw(st.integers(0, n))
    low, high = wilson(k, n)
    assert 0 <= low <= (k / n if n else 0) <= high <= 1 or not n
