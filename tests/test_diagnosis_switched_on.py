"""A robot that is switched off and on: its supply makes pulses on a line on which nobody speaks."""

from __future__ import annotations

from tests.conversations import Conversation, swinging
from tests.diagnosed import alarms, codes


def test_a_pulse_or_two_while_the_controller_is_off_are_no_stuck_line_and_no_noise() -> None:
    talk = Conversation("mightyzap")
    for turn in range(3):
        for _ in range(150):
            for servo in (1, 2, 3):
                talk.read(servo, swinging(servo, talk.now_s))
            talk.rest(10)
        talk.rest(4000)
        for pulse in (b"\x00", b"\xff") if turn < 2 else ():
            talk.say(pulse)
            talk.rest(400)
    told = talk.diagnosed()
    assert "noise" in codes(told)
    assert not alarms(told)


def test_a_line_that_falls_while_the_loop_runs_and_stays_low_is_stuck() -> None:
    talk = Conversation("mightyzap")
    for _ in range(3):
        for _ in range(150):
            for servo in (1, 2, 3):
                talk.read(servo, swinging(servo, talk.now_s))
            talk.rest(10)
        talk.say(b"\x00")
        talk.rest(400)
    assert alarms(talk.diagnosed()) == ["line-stuck"]
