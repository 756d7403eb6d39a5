"""The tests that ``sniffer diff`` makes hold what they promise."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sniffer.reports.runs import KEPT
from sniffer.reports.significance import ALPHA, holm, mann_whitney, rates, shares
from sniffer.statistics.thinned import Thinned

# --- the tests themselves, against what is counted one by one -----------------------------------

SMALL = st.lists(st.integers(0, 6), min_size=8, max_size=12)


@given(a=SMALL, b=SMALL)
def test_the_effect_of_ranks_is_how_much_likelier_one_is_larger(a: list[int], b: list[int]) -> None:
    told = mann_whitney(np.array(a, float), np.array(b, float))
    assert told is not None
    pairs = [(y > x) - (y < x) for x, y in itertools.product(a, b)]
    assert told.effect == pytest.approx(sum(pairs) / len(pairs))
    assert 0 <= told.p <= 1


def test_ranks_are_as_likely_as_shuffling_says() -> None:
    rng = np.random.default_rng(5)
    a, b = rng.normal(0, 1, 30), rng.normal(0.6, 1, 24)
    # neighbours unlike each other: all of them count
    a, b = (np.sort(x).reshape(2, -1).T.ravel() for x in (a, b))
    told = mann_whitney(a, b)
    assert told is not None
    both = np.concatenate([a, b])
    extreme, n = 0, 4000
    for _ in range(n):
        rng.shuffle(both)
        delta = 2 * float((both[30:, None] > both[None, :30]).mean()) - 1
        extreme += abs(delta) >= abs(told.effect)
    assert told.p == pytest.approx(extreme / n, rel=0.4)


def test_numbers_that_follow_their_neighbours_count_for_fewer() -> None:
    """Two walks of one kind: taken for independent, nearly every pair would differ."""
    rng = np.random.default_rng(1)
    wrong = alone = 0
    for _ in range(60):
        walks = []
        for _ in range(2):
            walk = np.zeros(400)
            for k, step in enumerate(rng.normal(0, 1, 399)):
                walk[k + 1] = 0.95 * walk[k] + step
            walks.append(walk)
        told = mann_whitney(*walks)
        assert told is not None
        wrong += told.p < 0.05
        shuffled = [rng.permutation(walk) for walk in walks]
        naive = mann_whitney(*shuffled)
        assert naive is not None
        alone += naive.p < 0.05
    assert alone > 30
    assert wrong < 12


def test_a_state_that_never_changed_was_seen_once() -> None:
    a, b = np.full(500, 30.0), np.full(500, 31.0)
    lasting, single = mann_whitney(a, b, lasts=True), mann_whitney(a, b)
    assert lasting is not None
    assert single is not None
    assert lasting.p > 0.05
    assert single.p < 1e-12
    a[100] = 35
    glitch = mann_whitney(a, b, lasts=True)
    assert glitch is not None
    assert glitch.p > 0.05


@given(st.integers(0, 9), st.integers(1, 9), st.integers(0, 9), st.integers(1, 9))
def test_shares_are_as_likely_as_counting_says(k: int, n: int, j: int, m: int) -> None:
    k, j = min(k, n), min(j, m)
    told = shares(k, n, j, m)
    assert told is not None
    hits = k + j
    chance = {
        i: Fraction(math.comb(n, i) * math.comb(m, hits - i), math.comb(n + m, hits))
        for i in range(max(0, hits - m), min(hits, n) + 1)
    }
    want = sum(p for p in chance.values() if p <= chance[k])
    assert told.p == pytest.approx(float(want), rel=1e-6)


@given(st.integers(0, 9), st.integers(1, 5), st.integers(0, 9), st.integers(1, 5))
def test_rates_are_as_likely_as_counting_says(k: int, s: int, j: int, t: int) -> None:
    told = rates(k, s, j, t)
    n, p = k + j, Fraction(s, s + t)
    if not n:
        assert told is None
        return
    assert told is not None
    chance = [math.comb(n, i) * p**i * (1 - p) ** (n - i) for i in range(n + 1)]
    assert told.p == pytest.approx(float(sum(c for c in chance if c <= chance[k])), rel=1e-6)


def test_very_many_cases_are_as_likely_as_few_ones_say() -> None:
    exact = shares(9_900, 19_900, 10_200, 19_900)
    about = shares(19_800 * 2, 39_800 * 2, 20_100 * 2, 39_800 * 2)
    assert exact is not None
    assert about is not None
    assert (exact.test, about.test) == ("Fisher", "two proportions")
    assert exact.p == pytest.approx(0.0026, rel=0.2)
    told = rates(30_000, 1.0, 30_600, 1.0)
    assert told is not None
    assert told.p == pytest.approx(0.0149, rel=0.05)


@given(st.lists(st.floats(1e-9, 1), max_size=12))
def test_a_corrected_chance_is_never_smaller_and_keeps_the_order(chances: list[float]) -> None:
    out = holm(chances)
    assert all(q >= p for p, q in zip(chances, out, strict=True))
    assert sorted(range(len(out)), key=lambda k: (chances[k], k)) == sorted(
        range(len(out)), key=lambda k: (out[k], chances[k], k)
    )
    if chances:
        assert min(out) == pytest.approx(min(min(chances) * len(chances), 1.0))
    assert 0 < ALPHA < 0.05


@settings(max_examples=20)
@given(st.lists(st.integers(0, 9000), min_size=1, max_size=12))
def test_a_long_series_is_thinned_evenly_however_it_comes(sizes: list[int]) -> None:
    series, at = Thinned(KEPT), 0
    for size in sizes:
        series.add(np.arange(at, at + size, dtype=float))
        at += size
    kept = series.values()
    assert series.count == at
    assert len(kept) <= KEPT
    if len(kept) > 1:
        step = int(kept[1] - kept[0])
        assert kept.tolist() == list(range(0, at, step))
