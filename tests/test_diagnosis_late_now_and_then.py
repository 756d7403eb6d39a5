"""Answers behind their window: of a slow servo, or of whichever one a busy host was late with."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.conversations import robot, swinging
from tests.diagnosed import codes

if TYPE_CHECKING:
    from tests.conversations import Conversation


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
