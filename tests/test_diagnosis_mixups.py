"""Joints that do what another one is told, or the opposite of what they are told."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tests.conversations import Conversation, swinging
from tests.diagnosed import codes, verdicts
from tests.lists import each_in_turn

if TYPE_CHECKING:
    from collections.abc import Callable


def robot(protocol: str, place: Callable[[int, float], float]) -> Conversation:
    """Return four joints that swing, each in its own time; ``place`` is where one is at a time."""
    talk = Conversation(protocol)
    while talk.now_s < 25:
        for servo in (1, 2, 3, 4):
            talk.say(talk.tongue.goal(servo, swinging(servo, talk.now_s)))
            talk.rest(0.3)
            there = place(servo, talk.now_s - 0.03)
            if talk.tongue.tells is not None:
                talk.say(talk.tongue.tells(servo, there))
                talk.rest(0.3)
            talk.read(servo, there)
        talk.rest(15)
    return talk


def exchanged(servo: int, s: float) -> float:
    return swinging({2: 3, 3: 2}.get(servo, servo), s)


@each_in_turn(4, "protocol", ["mightyzap", "lss", "rs30x", "wck"])
def test_two_joints_that_do_what_the_other_one_is_told_are_exchanged(protocol: str) -> None:
    told = robot(protocol, exchanged).diagnosed().incidents()
    assert verdicts(told) == [("joints-mixed-up", (2, 3))]
    assert told[0].next.startswith("Exchange their ids")


@each_in_turn(4, "protocol", ["mightyzap", "lss", "rs30x", "wck"])
def test_a_joint_that_goes_against_its_goals_is_turned_around(protocol: str) -> None:
    def turned(servo: int, s: float) -> float:
        return 1 - swinging(servo, s) if servo == 3 else swinging(servo, s)

    told = robot(protocol, turned).diagnosed().incidents()
    assert verdicts(told) == [("joints-mixed-up", (3,))]
    assert told[0].next.startswith("Turn its direction around")


def test_a_pair_of_joints_that_is_told_to_go_against_each_other_does_as_told() -> None:
    def path(servo: int, s: float) -> float:
        return swinging(1, s) if servo == 1 else 1 - swinging(1, s)

    talk = Conversation("mightyzap")
    while talk.now_s < 25:
        for servo in (1, 2):
            talk.send(servo, path(servo, talk.now_s))
            talk.read(servo, path(servo, talk.now_s - 0.1))
        talk.rest(15)
    assert not {"joint-mirrored", "joints-exchanged"} & codes(talk.diagnosed())
