"""Requests that go unanswered because somebody sleeps when the line rests."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest

from tests.conversations import Conversation, swinging
from tests.diagnosed import codes, verdicts
from tests.lists import in_turn

if TYPE_CHECKING:
    from collections.abc import Callable


def resting(
    protocol: str, is_lost: Callable[[int, int, int], bool], rest_s: float = 3.0
) -> Conversation:
    """Return ten stretches of a loop over three servos with rests between; some answers are lost.

    Args:
        protocol: what is spoken.
        is_lost: takes the number of the stretch, of the round in it, and the servo.
        rest_s: how long the line rests.
    """
    talk = Conversation(protocol)
    for stretch in range(10):
        for cycle in range(40):
            for servo in (1, 2, 3):
                if is_lost(stretch, cycle, servo):
                    talk.ask_in_vain(servo)
                else:
                    talk.read(servo, swinging(servo, talk.now_s))
            talk.rest(15)
        talk.rest(1000 * rest_s)
    return talk


@in_turn(4)
@pytest.mark.parametrize("protocol", ["mightyzap", "lss", "rs30x", "wck"])
@pytest.mark.parametrize("sleepers", [(1,), (1, 2, 3)])
def test_who_is_asked_first_behind_each_rest_and_does_not_answer_was_asleep(
    protocol: str, sleepers: tuple[int, ...]
) -> None:
    talk = resting(protocol, lambda s, cycle, who: s > 0 == cycle and who in sleepers)
    assert verdicts(talk.diagnosed().incidents()) == [("asleep", ())]


def test_answers_that_are_lost_at_any_time_do_not_wait_for_rests() -> None:
    rng = random.Random(3)
    talk = resting("mightyzap", lambda *_: rng.random() < 0.03)
    assert "first-behind-rest" not in codes(talk.diagnosed())


def test_where_each_request_stands_behind_a_rest_it_means_nothing() -> None:
    talk = Conversation("mightyzap")
    for k in range(60):
        if k % 6 == 5:
            talk.ask_in_vain(1)
        else:
            talk.read(1, 0.5)
        talk.rest(1500)
    assert "first-behind-rest" not in codes(talk.diagnosed())
