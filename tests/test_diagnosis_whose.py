"""Of whom a finding speaks: who is meant is named, and the bytes shown are his."""

from __future__ import annotations

from tests.conversations import Conversation
from tests.diagnosed import found
from tests.streams import mightyzap


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
