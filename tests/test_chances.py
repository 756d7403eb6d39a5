"""How likely something is by chance: exact, and at once however much there was."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer.diagnosis.evidence import chances
from sniffer.diagnosis.evidence.chances import at_least


@given(st.integers(0, 60), st.integers(0, 60), st.floats(0.001, 0.999))
def test_it_is_the_sum_of_the_tail(k: int, n: int, p: float) -> None:
    tail = math.fsum(math.comb(n, i) * p**i * (1 - p) ** (n - i) for i in range(k, n + 1))
    assert at_least(k, n, p) == pytest.approx(tail, rel=1e-9, abs=1e-300)


def test_of_millions_only_those_are_looked_at_that_count(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = list[str]()

    class Counted:
        def __getattr__(self, name: str) -> Any:
            asked.append(name)
            return getattr(math, name)

    monkeypatch.setattr(chances, "math", Counted())
    assert at_least(40, 3_000_000, 1e-5) == pytest.approx(0.0462521969946, rel=1e-6)
    assert len(asked) < 10_000
