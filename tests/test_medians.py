"""Medians and quantiles without masked arrays are those of numpy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sniffer.ground.medians import median, quantile

DIAGNOSIS = Path(__file__).parents[1] / "sniffer" / "diagnosis"


@pytest.mark.parametrize("n", [1, 2, 3, 4, 9, 100, 101])
@pytest.mark.parametrize("kind", [np.int64, np.float64, np.uint8])
def test_the_median_of_some_numbers_is_that_of_numpy(n: int, kind: Any) -> None:
    numbers = np.random.default_rng(n).integers(0, 200, n).astype(kind)
    assert median(numbers) == np.median(numbers)
    assert median(numbers.tolist()) == np.median(numbers)
    for share in (0.0, 0.05, 0.1, 0.25, 0.75, 0.9, 0.999, 1.0):
        assert quantile(numbers, share) == np.quantile(numbers, share)


@pytest.mark.parametrize("axis", [None, 0, 1])
def test_the_median_along_an_axis_is_that_of_numpy(axis: int | None) -> None:
    table = np.random.default_rng(3).normal(size=(6, 7))
    assert np.array_equal(median(table, axis=axis), np.median(table, axis=axis))
    assert np.array_equal(quantile(table, 0.3, axis=axis), np.quantile(table, 0.3, axis=axis))
    shares = [0.0, 0.1, 0.5, 0.9, 1.0]
    assert np.array_equal(quantile(table, shares, axis=axis), np.quantile(table, shares, axis=axis))


def test_the_median_keeps_the_axis_that_it_is_taken_along_if_told_so() -> None:
    table = np.random.default_rng(3).normal(size=(6, 7))
    kept = median(table, axis=1, keepdims=True)
    assert np.array_equal(kept, np.median(table, axis=1, keepdims=True))


def test_a_number_that_is_none_makes_the_median_none() -> None:
    assert np.isnan(median([1.0, float("nan"), 2.0]))
    assert np.isnan(quantile([1.0, float("nan"), 2.0], 0.9))


def test_no_rule_of_the_diagnosis_loads_masked_arrays() -> None:
    """``numpy.ma`` comes with these, and with a plain ``np.unique``."""
    loading = ("np.median(", "np.quantile(", "np.isin(")
    for file in DIAGNOSIS.rglob("*.py"):
        text = file.read_text(encoding="utf-8")
        assert not [word for word in loading if word in text], file
        assert all("return_" in call[:120] for call in text.split("np.unique(")[1:]), file
