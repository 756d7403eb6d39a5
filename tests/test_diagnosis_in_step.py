"""Joints and goals that are looked at, or stated, at times of their own."""

from __future__ import annotations

import math
import random

import pytest

from tests.conversations import Conversation
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


@pytest.mark.parametrize("jumps", [False, True])
def test_a_path_that_goes_on_while_its_controller_waits_for_another_servo_does_not_jump(
    jumps: bool,
) -> None:
    """Four goals close to each other, then servo 6 is asked in vain for a third of a second."""

    def path(t: float) -> float:
        return 60 * math.sin(math.tau * 0.6 * t)

    stated = [0.04 * k for k in range(460)]
    stated += [18.4 + 0.34 * cycle + 0.0125 * k for cycle in range(80) for k in range(4)]
    told = [
        (t, f"#5D{round(10 * path(t)) + 400 * (jumps and k == 200)}") for k, t in enumerate(stated)
    ]
    for k in range(115):
        told += [(0.16 * k + 0.01, "#6QD"), (0.16 * k + 0.014, "*6QD0")]
    told += [(18.455 + 0.34 * k + 0.1 * again, "#6QD") for k in range(80) for again in range(3)]
    assert ("goal-jump" in codes(lss(*sorted(told)))) == jumps


@pytest.mark.parametrize("back", [0.1, 12.0])
def test_a_joint_that_is_seen_elsewhere_once_and_back_much_later_was_moved(back: float) -> None:
    """Taught by hand, switched on, looked at once; then played back, and looked at behind that."""
    told = [(0.05 * k, f"#5D{100 + 2 * k}") for k in range(60)]
    looks = [(0.05 * k + 0.01, 100 + 2 * k) for k in range(60)]
    looks += [(4.2, 900), *((4.2 + back + 0.05 * k, 220) for k in range(60))]
    for t, place in looks:
        told += [(t, "#5QD"), (t + 0.002, f"*5QD{place}")]
    assert ("doubtful-value" in codes(lss(*sorted(told)))) == (back < 1)


def test_rests_of_a_hand_between_goals_that_it_sends_are_no_stalls() -> None:
    """A dial sends a goal when it is turned, of whichever joint: all rests are the hand's."""
    rng = random.Random(8)
    talk, place = Conversation("lss"), dict.fromkeys((1, 2, 3), 0.5)
    while talk.now_s < 90:
        servo, way = rng.choice((1, 2, 3)), rng.choice((-1, 1)) * rng.uniform(0.001, 0.008)
        for _ in range(rng.randint(5, 60)):
            place[servo] = min(max(place[servo] + way, 0.2), 0.8)
            talk.send(servo, place[servo])
            talk.rest(rng.expovariate(1 / 30))
        talk.rest(rng.expovariate(1 / 2000))
    assert "loop-stalls" not in codes(talk.diagnosed())
