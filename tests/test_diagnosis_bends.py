"""Outages that come where a joint stands: a cable that breaks as the arm bends."""

from __future__ import annotations

import random

import pytest

from tests.conversations import Conversation, robot, swinging
from tests.diagnosed import found, verdicts
from tests.lists import in_turn


@in_turn(2)
@pytest.mark.parametrize("whose", [1, 2])
@pytest.mark.parametrize("by_place", [True, False])
def test_outages_that_come_where_a_joint_stands_are_told_with_the_place(
    whose: int, *, by_place: bool
) -> None:
    """Half of the answers of servo 2 get lost where the joint of servo 1, or its own, is far up."""
    rng, chance = random.Random(2), random.Random(3)
    far = 0.75

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        del cycle
        is_bent = swinging(whose, talk.now_s) > far if by_place else chance.random() < 0.25
        if servo != 2 or not is_bent or rng.random() > 0.5:
            return False
        talk.ask_in_vain(servo, 5)
        return True

    told = robot("mightyzap", 30, rate_hz=30, instead=instead).diagnosed()
    assert ("bad-cable", (2,)) in verdicts(told.incidents()) or not by_place
    sentences = [f.what for f in found(told) if f.code == "outages-by-place"]
    assert bool(sentences) == by_place
    name = "it" if whose == 2 else "servo 1"
    assert all(f"come where {name} stands above" in what for what in sentences)
