"""Joints that hang though their torque was switched on: a motor that is off is not proven then."""

from __future__ import annotations

import pytest

from tests.conversations import Conversation, swinging
from tests.diagnosed import found
from tests.streams import mightyzap

STATE = 0x8C
TORQUE = 0x80


def frozen(*, switched_on: bool) -> Conversation:
    """Return two joints that swing; one states a single place from the middle on, with no load."""
    talk = Conversation("mightyzap")
    for servo in (1, 2):
        if switched_on:
            talk.say(mightyzap.packet(servo, 0xF3, bytes([TORQUE, 1])))
            talk.rest(0.3)
            talk.say(mightyzap.packet(servo, 0, b""))
            talk.rest(2)
    while talk.now_s < 20:
        for servo in (1, 2):
            place = 0.4 if servo == 2 and talk.now_s > 10 else swinging(servo, talk.now_s)
            talk.say(talk.tongue.goal(servo, swinging(servo, talk.now_s)))
            talk.rest(0.3)
            talk.say(mightyzap.packet(servo, 0, b""))
            talk.rest(0.4)
            talk.say(mightyzap.packet(servo, 0xF2, bytes([STATE, 6])))
            talk.rest(0.3)
            words = (round(place * 4095), 0, 60)
            data = b"".join(word.to_bytes(2, "little") for word in words)
            talk.say(mightyzap.packet(servo, 0, data))
            talk.rest(2)
        talk.rest(15)
    return talk


@pytest.mark.parametrize("switched_on", [False, True])
def test_a_joint_that_hangs_though_its_torque_was_switched_on_is_told_so(
    *, switched_on: bool
) -> None:
    told = frozen(switched_on=switched_on).diagnosed()
    (limp,) = (f for f in found(told) if f.code == "joint-limp")
    assert ("its torque was switched on before, and not off since" in limp.what) == switched_on
    (incident,) = told.incidents()
    assert (incident.cause, incident.servo_ids) == ("torque-off", (2,))
    assert incident.next.startswith("Switch torque on") != switched_on
    assert ("its position sensor stands still" in incident.next) == switched_on
