"""Lists that are walked whole, or thinned: by ``make test-thorough`` and in everyday runs.

The reference decoder reads one frame at a time; walked whole, these lists take a third of the
suite's time. Thinned they keep both ends, where limits are, and every so many in between. Likewise
cases of one test that differ little from each other, as by protocol and by how late a host is: of
these everyday runs take one in so many, other ones for each test. ``make fuzz`` takes all of both,
too, with far more examples of the laws.
"""

from __future__ import annotations

import os
import zlib
from collections import defaultdict
from typing import TYPE_CHECKING, Any, Final, TypeVar

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

T = TypeVar("T")
F = TypeVar("F", bound="Callable[..., object]")

WHOLE: Final = os.environ.get("HYPOTHESIS_PROFILE") in ("thorough", "long")

walks_a_list = pytest.mark.walks_a_list
"""Marks a test that does: ``make test-thorough`` runs it over the whole list."""


def thinned(values: Sequence[T], step: int, ends: int = 10) -> list[T]:
    """Return all values, or the first and last few and every ``step``-th of the others.

    ``step`` should share no factor with what the list repeats after: then every residue is met.
    """
    last = len(values) - ends
    return [v for i, v in enumerate(values) if WHOLE or i < ends or i >= last or i % step == 0]


def in_turn(of: int) -> pytest.MarkDecorator:
    """Mark a test of which everyday runs take one case in ``of``."""
    return pytest.mark.in_turn(of)


def each_in_turn(
    of: int, names: str | Sequence[str], values: Iterable[object], *, ids: Any = None
) -> Callable[[F], F]:
    """Give a test cases, as ``pytest.mark.parametrize``, of which one in ``of`` is taken."""
    cases = pytest.mark.parametrize(names, values, ids=ids)
    return lambda test: in_turn(of)(cases(test))


def passed_over(items: Sequence[pytest.Item]) -> list[pytest.Item]:
    """Return the cases that are not in turn, by where they stand among those of their test.

    With which one a test begins follows from its name: then each protocol has its turn somewhere.
    """
    cases = defaultdict[str, list[pytest.Item]](list)
    for item in items:
        if item.get_closest_marker("in_turn") is not None:
            cases[item.nodeid.partition("[")[0]].append(item)
    out = list[pytest.Item]()
    for name, mine in cases.items():
        widest = max(mark.args[0] for mark in mine[0].iter_markers("in_turn"))
        of = widest if not WHOLE and len(mine) > 1 else 1
        first = zlib.crc32(name.rpartition("/")[2].encode()) % min(of, len(mine))
        # with a step aside after each round: two lists that are crossed meet on both diagonals
        out += [item for i, item in enumerate(mine) if (i + i // of) % of != first]
    return out
