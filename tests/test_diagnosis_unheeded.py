"""A controller that only writes, to servos that answer: answers lie over its next commands."""

from __future__ import annotations

import random

from sniffer.diagnosis.physics.uart import BITS, both, heard, sent
from tests.conversations import Conversation
from tests.diagnosed import codes, verdicts
from tests.streams import mightyzap

SERVOS = (1, 2, 3, 4, 5)


def test_who_only_writes_to_servos_that_answer_does_not_wait() -> None:
    """Who gets a torn command does not answer, and the one behind it is whole again."""
    told = _spoken(answer_ms=0.4).diagnosed()
    assert "command-under-answer" in codes(told)
    assert verdicts(told.incidents()) == [("impatient-controller", ())]


def test_commands_torn_by_noise_are_under_no_answer() -> None:
    """Two torn ones stand in a row as often as chance has it, and none begins as two at once."""
    rng = random.Random(5)
    talk = Conversation("mightyzap", 57600)
    for _ in range(300):
        for servo in SERVOS:
            command = bytearray(talk.tongue.goal(servo, rng.random()))
            if rng.random() < 0.4:
                command[rng.randrange(len(command))] ^= 1 << rng.randrange(8)
            talk.write(bytes(command))
        talk.rest(15)
    assert "command-under-answer" not in codes(talk.diagnosed())


def _spoken(answer_ms: float) -> Conversation:
    """Return goals in a row, 0.3 ms apart, to servos that take some time to answer each."""
    rng = random.Random(7)
    talk = Conversation("mightyzap", 57600)
    for _ in range(200):
        owed = 0
        for servo in SERVOS:
            command = talk.tongue.goal(servo, rng.random())
            if not owed:
                talk.say(command)
                owed = servo
            else:
                bit_ms = 1000 / talk.baud
                later = (answer_ms + rng.uniform(0, 0.06) - 0.3) / bit_ms
                answer = sent(mightyzap.packet(owed, 0), begin=later)
                torn = heard(both(sent(command), answer, min))
                talk.say(torn)
                talk.rest((len(command) - len(torn)) * BITS * bit_ms)
                owed = 0
            talk.rest(0.3)
        if owed:
            talk.rest(0.1)
            talk.say(mightyzap.packet(owed, 0))
        talk.rest(15)
    return talk
