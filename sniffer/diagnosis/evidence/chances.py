"""How likely something is by chance alone: what a rule asks before it calls a pattern one."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.diagnosis.case import Case

NOTHING: Final = 40.0
"""Terms whose log is less by that change nothing in the digits of a sum, however many there are."""

TORN: Final = ("bad-checksum", "damaged-frame", "truncated-frame", "noise", "idle-tail")
"""Codes of bytes that are no frame."""

BY_CHANCE: Final = 64
"""Of so many torn frames one may hold: a checksum has seven or eight bits."""

UNCHECKED: Final = 8
"""The same of lines of text without one, and of one form: four in ten hold with a bit turned, most
of these as what they were, with another number."""

OFTEN: Final = 3
"""A frame that holds by chance does not come again; a mistake in a program does."""


def at_least(k: int, n: int, p: float) -> float:
    """Return how likely k or more of n are, each having the chance p."""
    if k <= 0 or p >= 1.0:
        return 1.0
    if k > n or p <= 0.0:
        return 0.0
    logs, most = list[float](), -math.inf
    for i in range(k, n + 1):
        logs.append(
            math.lgamma(n + 1)
            - math.lgamma(i + 1)
            - math.lgamma(n - i + 1)
            + i * math.log(p)
            + (n - i) * math.log1p(-p)
        )
        most = max(most, logs[-1])
        if logs[-1] < most - NOTHING:  # from the likeliest number on each is rarer than the last
            break
    return min(math.exp(most) * sum(math.exp(x - most) for x in logs), 1.0)


def so_alike(bounds: Sequence[tuple[float, float]]) -> float:
    """Return how likely stretches that end at any time are so even, or more so.

    Each is known to be between two bounds: who is asked seldom is away for one turn or two, however
    long that is, and that tells nothing. The short ones are taken for as short as they may be, and
    the long ones for as long. Moran's test: twice the log of what an even pace makes likelier has a
    chi-squared distribution with a degree of freedom less than there are stretches. Its lower tail
    is taken by the cube root of Wilson and Hilferty.
    """
    n, middle = len(bounds), len(bounds) // 2
    known = sorted(bounds, key=sum)
    spans = [low for low, _ in known[:middle]] + [high for _, high in known[middle:]]
    if n < 2 or min(spans) <= 0:
        return 1.0
    # all alike it is nothing, but for rounding
    uneven = max(math.log(sum(spans) / n) - sum(map(math.log, spans)) / n, 0.0)
    squares = 2 * n * uneven / (1 + (n + 1) / (6 * n)) / (n - 1)
    part = 2 / (9 * (n - 1))
    return 0.5 * math.erfc((1 - part - squares ** (1 / 3)) / math.sqrt(2 * part))


def sureness(chance: float, enough: float = 1e-6) -> float:
    """Return how much a pattern is to count, 0..1: all of it from a chance of ``enough`` on."""
    return min(max(math.log(max(chance, 1e-300)) / math.log(enough), 0.0), 1.0)


def may_be_torn(case: Case, count: int) -> bool:
    """Tell whether so many frames may be torn ones that hold by chance, as one in 256 does."""
    torn = case.count(*TORN)
    is_checked = case.has_checksum or case.has_bare_answers
    return torn >= OFTEN and count <= 1 + torn // (BY_CHANCE if is_checked else UNCHECKED)
