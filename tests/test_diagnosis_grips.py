"""Joints that are told to stop at a current: a gripper that holds is not blocked."""

from __future__ import annotations

import pytest

from tests.diagnosed import codes
from tests.servos import lss


@pytest.mark.parametrize(
    ("goal", "stands"),
    [
        pytest.param("#5D800CH600", False, id="told to halt at 600 mA"),
        pytest.param("#5D800CL600", False, id="told to go limp at 600 mA"),
        pytest.param("#5D800CH900", True, id="told to halt at more"),
        pytest.param("#5D800", True, id="told to go there"),
    ],
)
def test_a_joint_that_stops_at_the_current_it_is_told_to_stop_at_is_not_blocked(
    goal: str, *, stands: bool
) -> None:
    """A gripper closes until it holds; it stands short of its goal for as long as it is let."""
    told: list[tuple[float, str]] = []
    place, t = 0, 0.0
    for there, says in ((True, goal), (False, "#5D0")):
        told.append((t, says))
        for _ in range(80):
            t += 0.03
            place = min(place + 30, 430) if there else max(place - 30, 0)
            mA = 620 if place == 430 else 120
            told += [(t, "#5QD"), (t + 0.002, f"*5QD{place}")]
            told += [(t + 0.01, "#5QC"), (t + 0.012, f"*5QC{mA}")]
        t += 0.03
    assert ("joint-stalled" in codes(lss(*told))) == stands
