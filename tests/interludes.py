"""What is spoken between sound talk, and requests alone that are torn: lines for tests."""

from __future__ import annotations

import random

from tests.conversations import Conversation, swinging


def polled(talk: Conversation, seconds: float) -> None:
    """Ask four servos where they are, again and again."""
    until_s = talk.now_s + seconds
    while talk.now_s < until_s:
        for servo in (1, 2, 3, 4):
            talk.read(servo, swinging(servo, talk.now_s))
        talk.rest(20)


def loaded(talk: Conversation, seconds: float) -> None:
    """Say the blocks of a loader, each acknowledged with a byte."""
    rng, until_s, number = random.Random(1), talk.now_s + seconds, 0
    while talk.now_s < until_s:
        talk.say(bytes([1, number & 0xFF, ~number & 0xFF]) + rng.randbytes(128))
        talk.rest(4)
        talk.say(b"\x06")
        talk.rest(12)
        number += 1


def updated(protocol: str) -> Conversation:
    """Return a line on which a loader speaks for three seconds."""
    talk = Conversation(protocol)
    polled(talk, 4)
    talk.rest(100)
    loaded(talk, 3)
    talk.rest(300)
    polled(talk, 4)
    return talk


def torn_on_one_side() -> Conversation:
    """Return a line of wCK with six requests whose sum is not right among thousands."""
    talk = Conversation("wck")
    for cycle in range(600):
        for servo in (1, 2, 3, 4):
            talk.read(servo, swinging(servo, talk.now_s))
        if cycle % 100 == 50:
            talk.say(bytes([0xFF, 0xA1, 0x00]))
        talk.rest(20)
    return talk
