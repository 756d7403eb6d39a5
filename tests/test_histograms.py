"""Durations by key: each is counted under its own, in whatever order and however many there are."""

from __future__ import annotations

import numpy as np
import pytest

from sniffer.diagnosis.ledger.histograms import KEYS, Histograms


@pytest.mark.parametrize("exact", [True, False])
def test_of_more_keys_than_are_told_apart_the_first_ones_met_are_counted(*, exact: bool) -> None:
    key = np.arange(2 * KEYS)[::-1].copy()
    low = np.where(key >= KEYS, 1000, 5)
    counted = Histograms()
    for _ in range(2):
        counted.add(key, low, low if exact else low + 24)
    counted.add(key[-3:], low[-3:], low[-3:])  # nobody's: these keys were met too late
    assert counted.keys == tuple(range(2 * KEYS - 1, KEYS - 1, -1))
    assert {counted.count(k) for k in counted.keys} == {2}
    assert counted.count(0) == 0
    bounds = counted.at(2 * KEYS - 1, 0.5)
    assert bounds is not None
    assert bounds[0] <= 1000 <= 1024 <= bounds[1] if not exact else bounds[0] <= 1000 <= bounds[1]
