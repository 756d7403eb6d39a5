"""Of whom a finding speaks: who is meant is named, and the bytes shown are his."""

from __future__ import annotations

import random

import pytest

from tests.conversations import Conversation, swinging
from tests.diagnosed import found, verdicts
from tests.streams import mightyzap, wck


def test_answers_behind_the_next_request_are_told_with_whose_they_are() -> None:
    """A loop that asks on after 10 ms; of three servos one answers after 13."""
    talk = Conversation("mightyzap")
    for _ in range(300):
        talk.read(1, 0.5)
        talk.say(talk.tongue.ask(3))
        talk.rest(10)
        talk.say(talk.tongue.ask(2))
        talk.rest(3)
        talk.say(talk.tongue.answer(3, 0.4))
        talk.rest(0.3)
        talk.say(talk.tongue.answer(2, 0.6))
        talk.rest(5)
    (told,) = (f for f in found(talk.diagnosed()) if f.code == "answers-after-next")
    assert "(all of servo 3)" in told.what
    data = b"".join(chunk.data for chunk in talk.chunks)
    (place,) = told.places
    assert data[place.offset :].startswith(talk.tongue.ask(3))


def test_servos_whose_answers_are_all_mismatched_are_counted_among_those_that_complain() -> None:
    """One byte more than was asked for, and the bit of the input voltage in each answer."""
    talk = Conversation("mightyzap")
    for _ in range(100):
        for servo in (1, 2):
            talk.say(talk.tongue.ask(servo))
            talk.rest(0.3)
            talk.say(mightyzap.packet(servo, 0x01, b"\x00\x08" + b"\x07" * (servo == 2)))
            talk.rest(2)
    told = [f.what for f in found(talk.diagnosed()) if f.code == "complaints-together"]
    assert len(told) == 2
    assert all("2 of 2 servos do" in what for what in told)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_joint_that_is_only_read_from_has_no_goal_by_a_torn_request(seed: int) -> None:
    """WCK's sums have seven bits: a read that loses its eighth bit is a move, once in a while."""
    talk, rng = Conversation("wck"), random.Random(seed)
    for k in range(500):
        for servo in (1, 2, 3):
            request = talk.tongue.ask(servo)
            if k == 100 and servo == 2:
                talk.say(wck.command(1 << 5 | servo, 0))
                talk.rest(8)
            elif rng.random() < 0.05:
                at, bit = rng.randrange(len(request)), 1 << rng.randrange(8)
                talk.say(request[:at] + bytes([request[at] ^ bit]) + request[at + 1 :])
                talk.rest(8)
            else:
                talk.read(servo, swinging(servo, talk.now_s))
            talk.rest(5)
    assert {cause for cause, _ in verdicts(talk.diagnosed().incidents())} == {"bus-noise"}
