"""Joints and goals that are looked at, or stated, at times of their own."""

from __future__ import annotations

import math

import pytest

from tests.diagnosed import codes
from tests.servos import lss

HANGS = {"joint-limp", "joint-stalled", "joint-not-following"}


@pytest.mark.parametrize("stands", [False, True])
def test_a_joint_that_is_looked_at_in_step_with_its_goals_is_not_told_to_stand(
    stands: bool,
) -> None:
    """Twelve joints are asked in turn, and step nearly as often as the turn of one comes."""

    def goal(t: float) -> float:
        return 35 * math.sin(math.tau * 0.8 * t)

    told = [(0.1 * k, f"#5D{round(10 * goal(0.1 * k))}") for k in range(600)]
    for k in range(48):
        t = 1.24 * k + 0.03
        told += [(t, "#5QD"), (t + 0.002, f"*5QD{0 if stands else round(10 * goal(t - 0.15))}")]
    assert bool(codes(lss(*sorted(told))) & HANGS) == stands
