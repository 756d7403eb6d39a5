"""Joints that are homed one after the other: who sends one far away waits until it is there."""

from __future__ import annotations

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
