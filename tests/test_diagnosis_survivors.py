"""What is left whole where most is torn: it is a choice, and some of it holds by chance."""

from __future__ import annotations

import random

import pytest

from tests.conversations import Conversation, swinging
from tests.diagnosed import codes, found
from tests.streams import mightyzap

TORN_FROM_MS = 1.0
"""A controller that waits for no more than that tears what comes later."""


def hurried(share: float) -> Conversation:
    """Return a loop that tears a share of the late answers of all servos but the last one."""
    rng = random.Random(3)
    talk = Conversation("mightyzap")
    for cycle in range(400):
        talk.until(cycle / 20)
        for servo in (1, 2, 3):
            answer = talk.tongue.answer(servo, swinging(servo, talk.now_s))
            talk.say(talk.tongue.ask(servo))
            wait_ms = rng.uniform(0.3, 4.0)
            talk.rest(wait_ms)
            is_torn = servo != 3 and wait_ms > TORN_FROM_MS and rng.random() < share
            talk.say(answer[: rng.randint(3, 7)] if is_torn else answer)
            talk.rest(1)
    return talk


def test_who_alone_has_its_late_answers_whole_is_not_slower_than_the_others() -> None:
    (slow,) = (f for f in found(hurried(1.0).diagnosed()) if f.code == "slower-than-peers")
    assert slow.strength < 0.6
    assert "slower-than-peers" not in codes(hurried(0.0).diagnosed())


@pytest.mark.parametrize("torn", [60, 600])
def test_one_alarm_among_hundreds_of_torn_answers_may_hold_by_chance(torn: int) -> None:
    """A sum of eight bits lets one in 256 torn ones pass, and what it says is anything."""
    talk = Conversation("mightyzap")
    for cycle in range(720):
        talk.until(cycle / 40)
        talk.say(talk.tongue.ask(1))
        talk.rest(0.4)
        answer = bytearray(talk.tongue.answer(1, swinging(1, talk.now_s)))
        if cycle == 650:
            answer = bytearray(mightyzap.packet(1, 0x20, bytes(answer[6:8])))
        elif cycle < torn or 650 < cycle < 700:  # nothing takes it back for a second
            answer[6] ^= 0x55
        talk.say(bytes(answer))
    (alarm,) = (f for f in found(talk.diagnosed()) if f.code == "device-overload")
    assert (alarm.strength < 0.5) == (torn > 256)


def test_frames_that_nobody_recognises_are_no_line_that_falls_all_the_time() -> None:
    """Each request of a loop lacks its first byte from one moment on, and has zeros of its own."""
    talk = Conversation("rs30x")
    for cycle in range(400):
        talk.until(cycle / 25)
        for servo in range(1, 7):
            if cycle < 150:
                talk.send(servo, swinging(servo, talk.now_s))
                talk.read(servo, swinging(servo, talk.now_s))
            else:
                talk.write(talk.tongue.goal(servo, swinging(servo, talk.now_s))[1:])
                talk.write(talk.tongue.ask(servo)[1:])
    assert "line-babbles" not in codes(talk.diagnosed())
