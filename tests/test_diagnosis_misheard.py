"""What is misheard and holds: servos that nobody meant, and answers that nobody gave unasked."""

from __future__ import annotations

import pytest

from tests.conversations import Conversation, swinging
from tests.diagnosed import codes


def lines(asked_by_chance: int, torn: bool) -> Conversation:
    """Return a loop of servos 7 and 8 in which 8 is read as 0 now and then, and other bits, too."""
    talk = Conversation("lss")
    for k in range(480):
        servo = 7 + k % 2
        if k % 20 == 5 and torn:
            talk.say(talk.tongue.ask(servo).replace(b"Q", b"\x03"))
            talk.rest(25)
        if k % asked_by_chance == 0:
            talk.say(b"#0QD\r")
            talk.rest(25)
        talk.read(servo, swinging(servo, talk.now_s))
    return talk


@pytest.mark.parametrize(("every", "torn", "absent"), [(48, True, False), (4, True, True)])
def test_who_is_asked_by_a_misread_digit_is_no_servo_that_is_missing(
    every: int, torn: bool, absent: bool
) -> None:
    """Lines have no checksum; who is missing indeed is asked as often as others."""
    told = codes(lines(every, torn).diagnosed())
    assert ("never-answered" in told) == absent


def test_a_servo_that_is_asked_seldom_on_a_sound_line_is_missing() -> None:
    assert "never-answered" in codes(lines(48, torn=False).diagnosed())


def test_what_stands_in_the_place_of_an_answer_was_asked_for() -> None:
    """A bare answer that a fast clock spoils is two bytes of no frame, near where its joint is."""
    talk = Conversation("wck")
    for k in range(600):
        servo = 1 + k % 3
        place = swinging(servo, talk.now_s)
        if servo == 2 and k % 4 == 0:
            talk.say(talk.tongue.ask(servo))
            talk.rest(0.3)
            talk.say(bytes((1 + round(place * 253), 0xFF)))
            talk.rest(3)
            continue
        talk.read(servo, place)
    assert "speaks-unasked" not in codes(talk.diagnosed())
