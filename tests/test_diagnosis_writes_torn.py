"""Noise on a bus whose servos do not answer writes: what is torn behind one is no answer."""

from __future__ import annotations

import random

from tests.conversations import Conversation, swinging, without_clock
from tests.diagnosed import codes, verdicts
from tests.lists import each_in_turn


def pulses(seed: int) -> Conversation:
    """Return goals that nobody answers, and questions; pulses alter one frame in twelve."""
    rng, talk = random.Random(seed), Conversation("mightyzap")
    for cycle in range(400):
        servo = 1 + cycle % 3
        place = swinging(servo, talk.now_s)
        goal = talk.tongue.goal(servo, place)
        for said in (goal, talk.tongue.ask(servo), talk.tongue.answer(servo, place)):
            heard = bytearray(said)
            if rng.random() < 0.08:
                heard[rng.randrange(len(heard))] ^= 1 << rng.randrange(8)
            talk.say(bytes(heard))
            talk.rest(0.4)
    return talk


def test_a_length_that_a_pulse_made_longer_took_the_next_request_no_bytes() -> None:
    """Two more and two FF of the next header: the sum of a mightyZAP frame holds as before."""
    talk = Conversation("mightyzap")
    for cycle in range(200):
        for servo in (1, 2, 3):
            goal = bytearray(talk.tongue.goal(servo, swinging(servo, talk.now_s)))
            if servo == 3 and cycle % 60 == 30:
                goal[4] |= 2
            talk.write(bytes(goal))
        for servo in (1, 2, 3):
            talk.read(servo, swinging(servo, talk.now_s))
    assert "answered-though-torn" not in codes(talk.diagnosed(without_clock(talk.chunks)))


@each_in_turn(2, "seed", [2, 3])
def test_a_torn_request_behind_a_write_that_nobody_answers_is_no_answer_to_it(seed: int) -> None:
    """Its own answer follows, which is not that of the write: requests are torn as answers are."""
    talk = pulses(seed)
    for chunks in (talk.chunks, without_clock(talk.chunks)):
        assert verdicts(talk.diagnosed(chunks).incidents()) == [("bus-noise", ())]
