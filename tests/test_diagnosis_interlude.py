"""A stretch in which something else is spoken, on a line that is sound before and behind."""

from __future__ import annotations

import random

import pytest

from tests.conversations import Conversation, swinging
from tests.diagnosed import codes, verdicts

PROTOCOLS = ["mightyzap", "lss", "rs30x", "wck"]

DAMAGE = {"damage-everywhere", "damage-undecided", "damage-in-requests", "damage-in-answers"}


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


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_blocks_of_a_loader_between_sound_talk_are_another_protocol_and_no_noise(
    protocol: str,
) -> None:
    talk = Conversation(protocol)
    polled(talk, 4)
    talk.rest(100)
    loaded(talk, 3)
    talk.rest(300)
    polled(talk, 4)
    diagnosis = talk.diagnosed()
    (incident,) = diagnosis.incidents()
    assert incident.cause == "mixed-protocols"
    assert "something else is spoken from 4." in incident.story
    assert not DAMAGE & codes(diagnosis)


def test_what_is_torn_before_as_well_is_no_stretch_of_its_own() -> None:
    talk = Conversation("mightyzap")
    polled(talk, 2)
    talk.say(bytes(range(40)))
    polled(talk, 2)
    loaded(talk, 3)
    talk.rest(300)
    polled(talk, 4)
    assert "spoken-between" not in codes(talk.diagnosed())


def test_pulses_while_nobody_speaks_are_no_talk() -> None:
    talk = Conversation("mightyzap")
    polled(talk, 2)
    for _ in range(1200):
        talk.say(b"\xf8")
        talk.rest(2)
    polled(talk, 2)
    diagnosis = talk.diagnosed()
    assert "spoken-between" not in codes(diagnosis)
    assert ("mixed-protocols", ()) not in verdicts(diagnosis.incidents())


def test_torn_frames_of_one_side_alone_are_not_told_as_of_all_senders() -> None:
    talk = Conversation("wck")
    for cycle in range(600):
        for servo in (1, 2, 3, 4):
            talk.read(servo, swinging(servo, talk.now_s))
        if cycle % 100 == 50:
            talk.say(bytes([0xFF, 0xA1, 0x00]))  # a request whose sum is not right
        talk.rest(20)
    assert "damage-everywhere" not in codes(talk.diagnosed())
