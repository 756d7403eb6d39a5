"""Lists that are walked whole, or thinned: by ``make fuzz`` and in everyday runs.

The reference decoder reads one frame at a time; walked whole, these lists take a third of the
suite's time. Thinned they keep both ends, where limits are, and every so many in between.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Final, TypeVar

import pytest

if TYPE_CHECKING:
    from collections.abc import Sequence

T = TypeVar("T")

WHOLE: Final = os.environ.get("HYPOTHESIS_PROFILE") == "long"

walks_a_list = pytest.mark.walks_a_list
"""Marks a test that does: ``make fuzz`` runs it over the whole list."""


def thinned(values: Sequence[T], step: int, ends: int = 10) -> list[T]:
    """Return all values, or the first and last few and every ``step``-th of the others.

    ``step`` should share no factor with what the list repeats after: then every residue is met.
    """
    last = len(values) - ends
    return [v for i, v in enumerate(values) if WHOLE or i < ends or i >= last or i % step == 0]
