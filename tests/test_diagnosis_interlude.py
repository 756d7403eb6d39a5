"""A stretch in which something else is spoken, on a line that is sound before and behind."""

from __future__ import annotations

from tests.conversations import Conversation
from tests.diagnosed import codes, verdicts
from tests.interludes import loaded, polled, torn_on_one_side, updated
from tests.lists import each_in_turn

PROTOCOLS = ["mightyzap", "lss", "rs30x", "wck"]

DAMAGE = {"damage-everywhere", "damage-undecided", "damage-in-requests", "damage-in-answers"}


@each_in_turn(4, "protocol", PROTOCOLS)
def test_blocks_of_a_loader_between_sound_talk_are_another_protocol_and_no_noise(
    protocol: str,
) -> None:
    diagnosis = updated(protocol).diagnosed()
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
    assert "damage-everywhere" not in codes(torn_on_one_side().diagnosed())
