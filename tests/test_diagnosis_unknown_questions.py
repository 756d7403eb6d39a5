"""Questions that nobody ever answers: who leaves them unanswered was not away."""

from __future__ import annotations

import pytest

from tests.conversations import Conversation, swinging
from tests.diagnosed import codes, verdicts
from tests.streams import mightyzap, rs30x

QUESTIONS = {
    "lss": lambda servo: b"#%dQA\r" % servo,
    "mightyzap": lambda servo: mightyzap.packet(servo, 0xF2, b"\xa0\x02"),
    "rs30x": lambda servo: rs30x.packet(servo, 0x0F, 0x72, 2, 0),
}


def started(protocol: str, *, again: bool = False) -> Conversation:
    """Ask each of three servos three times what none of them knows, then poll them."""
    talk = Conversation(protocol)
    for servo in (1, 2, 3):
        talk.read(servo, 0.5)
        for _ in range(3):
            talk.say(QUESTIONS[protocol](servo))
            talk.rest(100)
    for k in range(900):
        servo = 1 + k % 3
        talk.read(servo, swinging(servo, talk.now_s))
        if again and k % 300 == 150:
            talk.say(QUESTIONS[protocol](servo))
            talk.rest(0.3)
            talk.say(talk.tongue.answer(servo, 0.5).replace(b"QD", b"QA"))
            talk.rest(1)
    return talk


@pytest.mark.parametrize("protocol", list(QUESTIONS))
def test_what_an_old_firmware_does_not_know_is_no_silence(protocol: str) -> None:
    told = started(protocol).diagnosed()
    assert verdicts(told.incidents()) == [("servo-refuses", (1, 2, 3))]
    assert "all-away-at-once" not in codes(told)


def test_what_is_answered_later_was_missed() -> None:
    assert "all-away-at-once" in codes(started("lss", again=True).diagnosed())


def test_a_servo_that_is_asked_something_new_until_it_is_back_was_away() -> None:
    talk = Conversation("mightyzap")
    for k in range(400):
        for servo in (1, 2):
            if servo == 2 and k % 100 == 50:
                for _ in range(4):
                    talk.ask_in_vain(servo)
                    talk.say(QUESTIONS["mightyzap"](servo))
                    talk.rest(25)
            talk.read(servo, swinging(servo, talk.now_s))
    assert "away-for-a-while" in codes(talk.diagnosed())
