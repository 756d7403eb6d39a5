"""Joints that follow less and less: something binds, while their goals go on as they did."""

from __future__ import annotations

from sniffer.ground.model import NS
from tests.conversations import T0, Conversation, swinging
from tests.diagnosed import codes, found, verdicts
from tests.lists import each_in_turn


def swung(behind_s: dict[int, tuple[float, float]], protocol: str = "mightyzap") -> Conversation:
    """Return a minute of three joints that swing, some so late behind their goals, then so late."""
    talk = Conversation(protocol)
    while talk.now_s < 60:
        for servo in (1, 2, 3):
            first, last = behind_s.get(servo, (0.05, 0.05))
            late_s = first + (last - first) * talk.now_s / 60
            talk.send(servo, swinging(servo, talk.now_s))
            talk.read(servo, swinging(servo, talk.now_s - late_s))
        talk.rest(20)
    return talk


@each_in_turn(4, "protocol", ["mightyzap", "lss", "rs30x", "wck"])
def test_a_joint_that_lags_behind_its_goals_more_and_more_is_told(protocol: str) -> None:
    told = swung({2: (0.05, 0.6)}, protocol).diagnosed()
    assert verdicts(told.incidents()) == [("overload", (2,))]
    (lag,) = (f for f in found(told) if f.code == "lags-more")
    assert lag.servo_id == 2
    assert "while these move as much" in lag.what


def test_all_joints_that_lag_more_share_a_loop_that_grew_slower() -> None:
    late = dict.fromkeys((1, 2, 3), (0.05, 0.6))
    assert "lags-more" not in codes(swung(late).diagnosed())


def test_a_joint_that_lags_as_it_always_did_is_as_it_is() -> None:
    assert "lags-more" not in codes(swung({2: (0.4, 0.4)}).diagnosed())


def test_a_joint_that_lags_more_and_more_does_so_since_it_is_far_behind() -> None:
    told = swung({2: (0.005, 0.2)}).diagnosed()
    (lag,) = (f for f in found(told) if f.code == "lags-more")
    assert lag.first_ns > T0 + 20 * NS


def test_a_joint_that_follows_no_more_does_not_lag_more_and_more() -> None:
    """It stands from the middle on, and one step is two where it comes within a part."""
    talk = Conversation("mightyzap")
    while talk.now_s < 60:
        for servo in (1, 2, 3):
            late_s = 0.004 * talk.now_s if servo == 2 else 0.05
            heard_s = min(talk.now_s - late_s, 34 if servo == 2 else 60)
            talk.send(servo, swinging(servo, talk.now_s))
            talk.read(servo, swinging(servo, heard_s))
        talk.rest(20)
    assert "joint-not-following" in codes(talk.diagnosed())
    assert "lags-more" not in codes(talk.diagnosed())
