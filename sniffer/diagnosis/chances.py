"""How likely something is by chance alone: what a rule asks before it calls a pattern one."""

from __future__ import annotations

import math


def at_least(k: int, n: int, p: float) -> float:
    """Return how likely k or more of n are, each having the chance p."""
    if k <= 0 or p >= 1.0:
        return 1.0
    if k > n or p <= 0.0:
        return 0.0
    logs = [
        math.lgamma(n + 1)
        - math.lgamma(i + 1)
        - math.lgamma(n - i + 1)
        + i * math.log(p)
        + (n - i) * math.log1p(-p)
        for i in range(k, n + 1)
    ]
    most = max(logs)
    return min(math.exp(most) * sum(math.exp(x - most) for x in logs), 1.0)


def sureness(chance: float, enough: float = 1e-6) -> float:
    """Return how much a pattern is to count, 0..1: all of it from a chance of ``enough`` on."""
    return min(max(math.log(max(chance, 1e-300)) / math.log(enough), 0.0), 1.0)
