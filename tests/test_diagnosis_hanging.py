"""Joints that hang from a moment on that is hardly one: what happened in it."""

from __future__ import annotations

from tests.diagnosed import codes
from tests.servos import lss, polled
from tests.test_diagnosis_joints import follows, swings, works


def test_a_joint_that_hangs_since_one_request_got_no_answer_is_limp_after_a_restart() -> None:
    said = polled(
        lambda t: follows(t) if t < 6 else -70.0,
        swings,
        seconds=14,
        milliampere=lambda t: works(t) if t < 6 else 40,
    )
    kept = [(t, line) for t, line in said if not (6 < t < 6.12 and "Q" in line)]
    assert "joint-limp-after-restart" in codes(lss(*kept, (6.02, "#5QD")))
    # one that goes on moving behind it was let go of later, and by something else
    early = [(t, line) for t, line in said if not (2 < t < 2.12 and "Q" in line)]
    assert "joint-limp" in codes(lss(*early, (2.02, "#5QD")))
