"""Two LSS servos of one id that answer at once: now and then two lines of digits make a third."""

from __future__ import annotations

import random

from tests.conversations import Conversation, robot
from tests.diagnosed import verdicts

TWIN = 2


def test_answers_of_which_most_are_torn_and_none_is_missing_are_those_of_two_servos() -> None:
    """What another pulls low at any bit is no line in seven of ten cases; there is no checksum."""
    rng = random.Random(7)

    def both(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != TWIN:
            return False
        answer = talk.tongue.answer(TWIN, rng.random())
        torn = bytes(byte & rng.getrandbits(8) for byte in answer)
        talk.say(talk.tongue.ask(TWIN))
        talk.rest(0.3)
        talk.say(answer if rng.random() < 0.2 else torn)
        talk.rest(0.4)
        return True

    told = robot("lss", 10, instead=both).diagnosed()
    assert verdicts(told.incidents())[0] == ("duplicate-id", (TWIN,))
