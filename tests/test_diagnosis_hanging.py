"""Joints that hang from a moment on that is hardly one: what happened in it."""

from __future__ import annotations

from tests.diagnosed import codes
from tests.servos import lss
from tests.test_diagnosis_joints import hangs_from_second_6


def test_a_joint_that_hangs_since_one_request_got_no_answer_is_limp_after_a_restart() -> None:
    said = hangs_from_second_6()
    kept = [(t, line) for t, line in said if not (6 < t < 6.12 and "Q" in line)]
    assert "joint-limp-after-restart" in codes(lss(*kept, (6.02, "#5QD")))
    # one that goes on moving behind it was let go of later, and by something else
    early = [(t, line) for t, line in said if not (2 < t < 2.12 and "Q" in line)]
    assert "joint-limp" in codes(lss(*early, (2.02, "#5QD")))
