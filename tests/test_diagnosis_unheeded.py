"""A controller that only writes, to servos that answer: answers lie over its next commands."""

from __future__ import annotations

import random

from sniffer.diagnosis.physics.uart import BITS, both, heard, sent
from tests.conversations import Conversation
from tests.diagnosed import codes, verdicts
from tests.streams import mightyzap, rs30x

SERVOS = (1, 2, 3, 4, 5)


def test_who_only_writes_to_servos_that_answer_does_not_wait() -> None:
    """Who gets a torn command does not answer, and the one behind it is whole again."""
    told = _spoken("mightyzap").diagnosed()
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


def test_a_few_bits_that_fall_in_answers_spoken_into_are_no_weak_signal() -> None:
    """An acknowledgement of one byte takes a bit or two of some commands, and tears the others."""
    told = _spoken("rs30x").diagnosed()
    assert verdicts(told.incidents()) == [("impatient-controller", ())]


def _spoken(protocol: str) -> Conversation:
    """Return goals in a row, 0.3 ms apart, to servos that take 0.4 ms to answer each.

    RS30x acknowledges with one byte, and the goals come 0.1 ms apart.
    """
    rng = random.Random(7)
    is_zap = protocol == "mightyzap"
    talk = Conversation(protocol, 57600 if is_zap else 115200)
    bit_ms = 1000 / talk.baud
    rest_ms = 0.3 if is_zap else 0.1

    def goal(servo: int) -> bytes:
        if is_zap:
            return talk.tongue.goal(servo, rng.random())
        place = round(rng.uniform(-900, 900)).to_bytes(2, "little", signed=True)
        return rs30x.packet(servo, 1, 0x1E, 2, 1, place)

    def answer(servo: int) -> bytes:
        return mightyzap.packet(servo, 0) if is_zap else b"\x07"

    for _ in range(300):
        owed = 0
        for servo in SERVOS if is_zap else (*SERVOS, 6):
            command = goal(servo)
            if not owed:
                talk.say(command)
                owed = servo
            else:
                later = (0.4 + abs(rng.gauss(0, 0.05)) - rest_ms) / bit_ms
                torn = heard(both(sent(command), sent(answer(owed), begin=later), min))
                talk.say(torn)
                talk.rest((len(command) - len(torn)) * BITS * bit_ms)
                owed = 0
            talk.rest(rest_ms)
        if owed and is_zap:
            talk.rest(0.1)
            talk.say(answer(owed))
        talk.rest(15)
    return talk
