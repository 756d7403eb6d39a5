"""Requests said into a slow servo's answers: they are missing, and nobody answers twice."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.physics.uart import both, received, sent
from tests.conversations import Conversation
from tests.diagnosed import codes, verdicts

if TYPE_CHECKING:
    from sniffer.diagnosis import Diagnosis

SLOW: Final = 3


def at_once(first: bytes, second: bytes, bits: float) -> bytes:
    """Return what a UART hears where the second begins so many bits behind the first, low wins."""
    levels = both(sent(first), sent(second, begin=bits), min)
    return bytes(byte.value for byte in received(levels))


def hasty(*, is_missing: bool) -> Diagnosis:
    """Return a loop that asks four servos for position and current; answers of one are late.

    The second request lies over the first answer; ``is_missing``: none is said there, and another
    answer lies over it instead.
    """
    rng = random.Random(4)
    talk = Conversation("lss")
    for k in range(150):
        for servo in (1, 2, SLOW, 4):
            position = b"*%dQD%d\r" % (servo, 10 * servo + k % 90)
            talk.say(b"#%dQD\r" % servo)
            talk.rest(0.3)
            if servo == SLOW:
                over = b"#%dQC\r" % servo if is_missing else position
                talk.say(at_once(position, over, rng.uniform(12.8, 17.8)))
                talk.rest(0.4)
            else:
                talk.say(position)
                talk.rest(0.3)
            if servo != SLOW or not is_missing:
                talk.say(b"#%dQC\r" % servo)
                talk.rest(0.3)
                talk.say(b"*%dQC%d\r" % (servo, 40 + k % 5))
                talk.rest(0.3)
        talk.rest(10)
    return talk.diagnosed()


def test_what_is_missing_behind_torn_answers_as_it_never_is_behind_others_was_said_into_them() -> (
    None
):
    told = hasty(is_missing=True)
    assert "request-swallowed" in codes(told)
    assert verdicts(told.incidents()) == [("impatient-controller", ())]


def test_a_second_servo_of_one_id_takes_no_request_away() -> None:
    assert verdicts(hasty(is_missing=False).incidents()) == [("duplicate-id", (SLOW,))]
