"""Requests that the tap reads wrong and the servos right: they are answered all the same."""

from __future__ import annotations

import random

import pytest

from tests.conversations import Conversation, swinging
from tests.diagnosed import codes, verdicts
from tests.lists import in_turn


def misread(protocol: str, every: int, *, answered: bool = True) -> Conversation:
    """Return a loop of three joints in which each so many-th request has a bit wrong in its sum."""
    talk, rng = Conversation(protocol), random.Random(3)
    for k in range(900):
        servo = 1 + k % 3
        request = talk.tongue.ask(servo)
        if k % every:
            talk.read(servo, swinging(servo, talk.now_s))
            continue
        talk.say(request[:-1] + bytes([request[-1] ^ 1 << rng.randrange(8)]))
        talk.rest(0.3 if answered else 25)
        if answered:
            talk.say(talk.tongue.answer(servo, swinging(servo, talk.now_s)))
            talk.rest(1)
    return talk


@in_turn(4)
@pytest.mark.parametrize("protocol", ["mightyzap", "rs30x"])
@pytest.mark.parametrize("every", [1, 3])
def test_servos_that_answer_what_is_torn_here_tell_that_the_tap_misreads(
    protocol: str, every: int
) -> None:
    told = misread(protocol, every).diagnosed().incidents()
    assert verdicts(told) == [("signal-integrity", ())]
    assert "look at the tap" in told[0].next


def test_where_not_one_request_holds_both_sides_are_heard() -> None:
    assert "nobody-asks" not in codes(misread("mightyzap", 1).diagnosed())


def test_who_is_not_answered_was_misread_by_the_servos_too() -> None:
    assert "answered-though-altered" not in codes(misread("rs30x", 3, answered=False).diagnosed())
