"""What else is known of missing or torn answers: the supply, and which bytes are wrong."""

from __future__ import annotations

import random

from tests.conversations import Conversation, swinging
from tests.diagnosed import codes, verdicts
from tests.test_diagnosis_faults_apart import weighed
from tests.test_diagnosis_weighing import told


def test_requests_that_are_missed_while_the_supply_is_low_are_no_matter_of_a_clock() -> None:
    """As of a servo that keeps its torque: it is there, and hears nothing."""
    seen = ("away-without-a-tear", "misses-now-and-then", "comes-and-goes", "no-response")
    found = [told(code, servo_id=2) for code in (*seen, "away-unevenly", "torque-survives")]
    assert weighed(found)[0] != ("brownout", (2,))
    assert weighed([*found, told("voltage-sag", servo_id=2)])[0] == ("brownout", (2,))


def altered_answers() -> Conversation:
    """Return a loop over four servos of whose answers one in 25 has a bit altered, anywhere."""
    rng = random.Random(7)
    talk = Conversation("rs30x")
    for _ in range(700):
        for servo in (1, 2, 3, 4):
            answer = bytearray(talk.tongue.answer(servo, swinging(servo, talk.now_s)))
            if rng.random() < 0.04:
                answer[rng.randrange(2, len(answer) - 1)] ^= 1 << rng.randrange(8)
            talk.say(talk.tongue.ask(servo))
            talk.rest(0.3)
            talk.say(bytes(answer))
            talk.rest(2)
        talk.rest(5)
    return talk


def test_answers_that_are_wrong_anywhere_are_no_matter_of_the_turn() -> None:
    told_of = altered_answers().diagnosed()
    assert {"damage-in-answers", "answers-torn-anywhere"} <= codes(told_of)
    assert verdicts(told_of.incidents()) == [("signal-integrity", ())]
