"""Answers behind their window: of a slow servo, or of whichever one a busy host was late with."""

from __future__ import annotations

import pytest

from tests.conversations import Conversation, robot, swinging
from tests.diagnosed import alarms, codes
from tests.streams import mightyzap


@pytest.mark.parametrize("of_one", [False, True])
def test_a_servo_whose_answers_are_late_a_few_times_as_others_are_is_not_slow(
    of_one: bool,
) -> None:
    """A host that is busy now and then is late with any servo's answer: five times, and four."""
    late = {(40 * k, 2) for k in range(5 if not of_one else 9)}
    late |= {(40 * k + 20, 1 + k % 2 * 2) for k in range(4 if not of_one else 0)}

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if (cycle, servo) not in late:
            return False
        talk.say(talk.tongue.ask(servo))
        talk.rest(150)
        talk.say(talk.tongue.answer(servo, swinging(servo, talk.now_s)))
        return True

    told = robot("lss", 20, servos=(1, 2, 3), instead=instead).diagnosed()
    assert "late-response" in codes(told)
    assert ("late-replies" in codes(told)) == of_one


@pytest.mark.parametrize(("every", "is_told"), [(100, False), (5, True)])
def test_of_a_servo_that_is_alone_it_must_be_a_habit(every: int, is_told: bool) -> None:
    """A bridge holds bytes back now and then, and no other servo shows that it does."""
    talk = Conversation("mightyzap")
    for k in range(500):
        talk.say(talk.tongue.ask(1))
        talk.rest(60 if k % every == every - 1 else 0.4)
        talk.say(talk.tongue.answer(1, 0.5))
        talk.rest(5)
    told = talk.diagnosed()
    assert "late-response" in codes(told)
    assert ("late-replies" in codes(told)) == is_told


def test_what_goes_to_a_servos_memory_is_acknowledged_later_and_the_servo_is_not_slow() -> None:
    """Fourteen settings at the start, each of which takes the memory 60 ms; then a sound loop."""
    talk = Conversation("mightyzap")
    for address, value in ((0x05, 10), (0x0B, 80), (0x0C, 60), (0x0D, 130), (0x10, 2)) * 3:
        talk.say(mightyzap.packet(1, 0xF3, bytes([address, value])))
        talk.rest(60)
        talk.say(mightyzap.packet(1, 0, b""))
        talk.rest(2)
    for _ in range(100):
        talk.read(1, 0.5)
        talk.rest(8)
    told = talk.diagnosed()
    assert "late-response" in codes(told)
    assert "slow-servo" not in alarms(told)
