"""Servos that fall silent at one moment: what they share went away, whatever is asked meanwhile."""

from __future__ import annotations

import pytest

from tests.conversations import Conversation, swinging
from tests.diagnosed import codes, found, verdicts
from tests.lists import each_in_turn

SERVOS = tuple(range(1, 9))


def looped(talk: Conversation, seconds: float, gone: tuple[int, ...] = ()) -> None:
    until = talk.now_s + seconds
    while talk.now_s < until:
        for servo in SERVOS:
            if servo in gone:
                talk.ask_in_vain(servo)
            else:
                talk.read(servo, swinging(servo, talk.now_s))
        talk.rest(20)


@each_in_turn(4, "protocol", ["mightyzap", "lss", "rs30x", "wck"])
def test_a_power_switch_is_no_storm_of_the_one_that_is_asked_whether_they_are_back(
    protocol: str,
) -> None:
    talk = Conversation(protocol)
    looped(talk, 8)
    for _ in range(3):
        for servo in SERVOS:
            talk.ask_in_vain(servo)
    for _ in range(9):
        talk.ask_in_vain(1, 1000)
    looped(talk, 8)
    told = talk.diagnosed()
    assert verdicts(told.incidents()) == [("brownout", SERVOS)]
    assert "retry-storm" not in codes(told)


@pytest.mark.parametrize("protocol", ["mightyzap", "lss"])
def test_some_servos_that_go_at_one_moment_share_a_supply_and_one_of_them_restarts_no_more(
    protocol: str,
) -> None:
    talk = Conversation(protocol)
    looped(talk, 6)
    looped(talk, 0.4, SERVOS[3:])
    looped(talk, 6)
    told = talk.diagnosed()
    gone = [f for f in found(told) if f.code == "several-away-at-once"]
    assert [f.servo_id for f in gone] == list(SERVOS[3:])
    assert "5 of 8 servos fall silent at one moment" in gone[0].what
    assert "servo-reset-loop" not in {cause for cause, _ in verdicts(told.incidents())}


def test_two_that_go_at_one_moment_may_do_so_by_chance() -> None:
    talk = Conversation("mightyzap")
    looped(talk, 6)
    looped(talk, 0.4, SERVOS[:2])
    looped(talk, 6)
    assert "several-away-at-once" not in codes(talk.diagnosed())
