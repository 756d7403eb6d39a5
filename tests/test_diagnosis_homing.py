"""Joints that are homed one after the other: who sends one far away waits until it is there."""

from __future__ import annotations

import random

from tests.conversations import Conversation, swinging
from tests.diagnosed import alarms

SERVOS = range(1, 7)


def test_a_program_that_waits_behind_a_goal_that_is_far_away_waits_for_its_joint() -> None:
    """Each joint goes to its stop in small steps, then far away and back, with a look behind."""
    talk = Conversation("lss")
    for servo in SERVOS:
        for k in range(45):
            place = 0.5 - k / 100
            talk.send(servo, place)
            talk.rest(30)
            talk.read(servo, max(place, 0.2))
            talk.rest(10)
        for place, wait_ms in ((0.25, 500), (0.5, 600)):
            talk.send(servo, place)
            talk.rest(wait_ms)
            talk.read(servo, place)
    until = talk.now_s + 10
    while talk.now_s < until:
        for servo in SERVOS:
            talk.send(servo, swinging(servo, talk.now_s))
        for servo in SERVOS:
            talk.read(servo, swinging(servo, talk.now_s - 0.03))
        talk.rest(10)
    assert not alarms(talk.diagnosed())


def test_a_program_that_rests_between_what_it_does_does_not_stop() -> None:
    """A fast loop, a rest, and a sketch: a goal far away, looks until it is there, a delay."""
    talk = Conversation("wck")
    rng = random.Random(3)
    places = dict.fromkeys(SERVOS, 0.5)
    for _ in range(4):
        until = talk.now_s + 3
        while talk.now_s < until:
            for servo in SERVOS:
                places[servo] = swinging(servo, talk.now_s)
                talk.send(servo, places[servo])
                talk.read(servo, places[servo])
            talk.rest(6)
        talk.rest(500)
        for _ in range(6):
            servo = rng.choice(SERVOS)
            goal, place = rng.uniform(0.2, 0.8), places[servo]
            talk.send(servo, goal)
            while abs(place - goal) > 0.01:
                place += max(min(goal - place, 0.02), -0.02)
                talk.read(servo, place)
                talk.rest(6)
            places[servo] = place
            talk.rest(rng.uniform(20, 200))
    assert not alarms(talk.diagnosed())
