"""One controller whose requests are moved by what it waits for: no second rhythm."""

from __future__ import annotations

import math
import random

from tests.conversations import Conversation, swinging
from tests.diagnosed import codes, verdicts

SERVOS = range(5)
TIMEOUT_MS = 20


def test_a_loop_that_waits_for_torn_answers_and_reads_one_more_each_time_is_one() -> None:
    """Requests come sooner than their period: behind a wait, beside another read, not elsewhere."""
    rng = random.Random(2)
    talk = Conversation("wck")
    for cycle in range(600):
        talk.until(cycle / 25 + rng.uniform(0, 0.004))
        for servo in SERVOS:
            talk.send(servo, swinging(servo, talk.now_s))
            read(talk, rng, servo)
        read(talk, rng, cycle % len(SERVOS))
    found = codes(talk.diagnosed())
    assert "truncated-frame" in found
    assert "interleaved-requests" not in found


def read(talk: Conversation, rng: random.Random, servo: int) -> None:
    """Ask a servo; of one answer in ten a byte is lost, and the time-out is waited for."""
    place = swinging(servo, talk.now_s)
    if rng.random() > 0.1:
        talk.read(servo, place)
        return
    talk.say(talk.tongue.ask(servo))
    talk.rest(0.3)
    talk.say(talk.tongue.answer(servo, place)[:1])
    talk.rest(TIMEOUT_MS + rng.uniform(0, 3))


def test_requests_behind_answers_that_are_text_come_as_they_are_long_and_are_no_second_rhythm() -> (
    None
):
    """What a turn tears stands behind the last request, which now comes a byte time later."""
    rng = random.Random(5)
    talk = Conversation("lss")

    def place(servo: int) -> float:
        return 0.5 + 0.1 * math.sin((0.4 + 0.1 * servo) * talk.now_s)

    for cycle in range(440):
        talk.until(cycle * 0.0212)
        for servo in (1, 2):
            talk.write(talk.tongue.goal(servo, place(servo)))
        for servo in (1, 2):
            talk.say(talk.tongue.ask(servo))
            if cycle > 140 and rng.random() < 0.3 * servo:
                talk.rest(0.1)
                talk.say(b"\x80")
            talk.rest(0.5)
            talk.say(talk.tongue.answer(servo, place(servo)))
            talk.rest(0.4)
    d = talk.diagnosed()
    assert "rhythms-meet" not in codes(d)
    assert verdicts(d.incidents()) == [("turnaround", ())]
