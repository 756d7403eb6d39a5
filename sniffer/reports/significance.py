"""Whether two runs differ by more than chance: tests with a name, an n and an effect.

With numpy alone. Numbers of neighbouring moments are not independent: what follows its neighbour
tells nothing new, so tests of ranks count fewer numbers than there are (``fewer``).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.model import F64

ALPHA: Final = 0.01
"""How likely it may be that runs of one kind are told to differ, by all comparisons together."""

NEGLIGIBLE: Final = 0.147
"""Cliff's delta below which a difference is negligible, however sure it is (Romano et al. 2006)."""

FEW: Final = 8
"""Numbers of each run at least: from here on the normal approximation of ranks is good."""

EXACT: Final = 20_000
"""Cases up to which shares and rates are tested exactly; beyond, by the normal approximation."""

LEAST_P: Final = 1e-300
"""Anything less likely is as unlikely as this."""


class TestVerdict(NamedTuple):
    """What a test says: its name, the numbers on each side, how likely it is by chance, how much.

    ``effect`` is Cliff's delta (how much likelier B is larger than smaller), the difference of two
    shares, or the logarithm to base 2 of how many times as often.
    """

    test: str
    n_a: int
    n_b: int
    p: float
    effect: float


def mann_whitney(a: F64, b: F64, *, lasts: bool = False) -> TestVerdict | None:
    """Test whether numbers of B tend to be larger or smaller; None where they are too few.

    ``lasts``: they are of a state that lasts, such as a temperature: one that never changes was
    seen once, however often it was read, and else no more often than it changed.
    """
    if len(a) < FEW or len(b) < FEW:
        return None
    both = np.concatenate([a, b])
    _, which, times = np.unique(both, return_inverse=True, return_counts=True)
    ends = np.cumsum(times)
    rank = (ends - (times - 1) / 2)[which]
    n_a, n_b = len(a), len(b)
    n = n_a + n_b
    u = float(rank[n_a:].sum()) - n_b * (n_b + 1) / 2
    delta = 2 * u / (n_a * n_b) - 1
    ties = float((times.astype(float) ** 3 - times).sum())
    variance = n_a * n_b / 12 * (n + 1 - ties / (n * (n - 1)))
    if variance <= 0:
        return TestVerdict("Mann-Whitney", n_a, n_b, 1.0, 0.0)
    share = min(fewer(rank[:n_a], lasts=lasts), fewer(rank[n_a:], lasts=lasts))
    z = max(abs(u - n_a * n_b / 2) - 0.5, 0.0) / math.sqrt(variance) * math.sqrt(share)
    return TestVerdict("Mann-Whitney", n_a, n_b, both_sides(z), delta)


def fewer(ranks: F64, *, lasts: bool) -> float:
    """Return for how many independent numbers each of a series counts, 0..1.

    ``(1 - r) / (1 + r)`` with the correlation r of neighbours (a series of first order; Bayley and
    Hammersley 1946); one that alternates counts in full.
    """
    d = ranks - ranks.mean()
    power = float((d * d).sum())
    if power <= 0:
        return 1 / len(ranks) if lasts else 1.0
    most = (1 + int((ranks[1:] != ranks[:-1]).sum())) / len(ranks) if lasts else 1.0
    r = min(max(float((d[1:] * d[:-1]).sum()) / power, 0.0), 1.0)
    return min(max((1 - r) / (1 + r), 1 / len(ranks)), most)


def both_sides(z: float) -> float:
    """Return how likely a normal number is as far from 0 as ``z``, on either side."""
    return max(math.erfc(z / math.sqrt(2)), LEAST_P)


def shares(hits_a: int, n_a: int, hits_b: int, n_b: int) -> TestVerdict | None:
    """Test whether two shares differ: Fisher's exact test, of very many two proportions."""
    if not n_a or not n_b:
        return None
    effect = hits_b / n_b - hits_a / n_a
    hits, n = hits_a + hits_b, n_a + n_b
    if min(hits, n - hits, n_a, n_b) > EXACT:
        share = hits / n
        z = abs(effect) / math.sqrt(share * (1 - share) * (1 / n_a + 1 / n_b))
        return TestVerdict("two proportions", n_a, n_b, both_sides(z), effect)
    low, high = max(0, hits - n_b), min(hits, n_a)
    logs = [_choose(n_a, k) + _choose(n_b, hits - k) for k in range(low, high + 1)]
    return TestVerdict("Fisher", n_a, n_b, _as_rare(logs, hits_a - low), effect)


def rates(count_a: int, time_a: float, count_b: int, time_b: float) -> TestVerdict | None:
    """Test whether something happens more often in one run, in proportion to ``time_a, time_b``.

    Given how often it happened in all, each time is A's with the chance of A's share of the time.
    """
    n = count_a + count_b
    if time_a <= 0 or time_b <= 0 or not n:
        return None
    p = time_a / (time_a + time_b)
    effect = math.log2(((count_b + 0.5) / time_b) / ((count_a + 0.5) / time_a))
    if n > EXACT:
        z = max(abs(count_a - n * p) - 0.5, 0.0) / math.sqrt(n * p * (1 - p))
        return TestVerdict("two rates", count_a, count_b, both_sides(z), effect)
    logs = [_choose(n, k) + k * math.log(p) + (n - k) * math.log1p(-p) for k in range(n + 1)]
    return TestVerdict("two rates, exact", count_a, count_b, _as_rare(logs, count_a), effect)


def _choose(n: int, k: int) -> float:
    return math.lgamma(n + 1) - math.lgamma(k + 1) - math.lgamma(n - k + 1)


def _as_rare(logs: Sequence[float], at: int) -> float:
    """Return the chance of all cases that are as unlikely as one, or more so."""
    chances = np.array(logs) - max(logs)
    weights = np.exp(chances)
    rare = weights[chances <= chances[at] + 1e-7]  # rounding makes no case likelier
    return min(max(float(rare.sum() / weights.sum()), LEAST_P), 1.0)


def holm(chances: Sequence[float]) -> list[float]:
    """Return chances corrected for how many there are (Holm 1979).

    Where those below ``ALPHA`` are believed, one of them is wrong in no more than ``ALPHA`` of all
    pairs of runs that do not differ.
    """
    n = len(chances)
    out = [1.0] * n
    worst = 0.0
    for place, k in enumerate(sorted(range(n), key=lambda k: chances[k])):
        worst = max(worst, min(chances[k] * (n - place), 1.0))
        out[k] = worst
    return out
