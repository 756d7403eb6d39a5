"""Joints that seem to stand by their positions, and what their speed says of that."""

from __future__ import annotations

import math

import pytest

from tests.diagnosed import codes
from tests.servos import lss, polled


@pytest.mark.parametrize(("speed", "hangs"), [(150, False), (2, True), (0, True)])
def test_a_joint_too_slow_for_its_goals_does_not_hang_while_its_speed_says_that_it_runs(
    speed: int, *, hangs: bool
) -> None:
    """It was ``torque-off`` at 86 %: three looks a second met it near the middle of its way."""
    said = polled(
        lambda t: 2 * math.sin(math.pi * t),
        lambda t: 30 * math.sin(math.pi * t),
        milliampere=lambda t: 40,
    )
    asked = [
        (second + 0.5 + after, words)
        for second in range(int(said[-1][0]))
        for after, words in ((0.0, "#5QS"), (0.001, f"*5QS{speed * (-1) ** second}"))
    ]
    assert ("joint-limp" in codes(lss(*sorted([*said, *asked])))) == hangs
