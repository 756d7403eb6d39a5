"""Joints that stand since a limit of force or speed was set to 0: their torque is on."""

from __future__ import annotations

import pytest

from tests.conversations import Conversation, swinging
from tests.diagnosed import codes, found, verdicts
from tests.lists import each_in_turn
from tests.streams import mightyzap, rs30x

WRITES = [
    ("rs30x", rs30x.write(1, 0x23, b"\0"), "max_torque 0"),
    ("mightyzap", mightyzap.packet(1, 0xF3, b"\x8a\0\0"), "force_limit 0"),
    ("mightyzap", mightyzap.packet(1, 0xF3, b"\x0e\0\0"), "max_force 0"),
    ("mightyzap", mightyzap.packet(0xFE, 0xF3, b"\x8a\0\0"), "force_limit 0"),
    ("lss", b"#1SD0\r", "max_speed 0"),
]


def stands(protocol: str, request: bytes, *, since: int = 300, undone: bytes = b"") -> Conversation:
    """Two joints follow their goals, until one is told something and stands."""
    talk = Conversation(protocol)
    still = 0.0
    for k in range(800):
        talk.until(k / 40)
        if k == 300:
            talk.write(request)
            if undone:
                talk.write(undone)
        for servo in (1, 2):
            goal = swinging(servo, talk.now_s)
            if k < since or servo == 2:
                still = goal if servo == 1 else still
                talk.send(servo, goal)
                talk.read(servo, swinging(servo, talk.now_s - 0.1))
            else:
                talk.send(servo, goal)
                talk.read(servo, still)
    return talk


@each_in_turn(2, ("protocol", "request_", "told"), WRITES)
def test_a_joint_whose_limit_is_set_to_nothing_is_told_so(
    protocol: str, request_: bytes, told: str
) -> None:
    diagnosis = stands(protocol, request_).diagnosed()
    (incident,) = diagnosis.incidents()
    assert verdicts([incident]) == [("torque-off", (1,))]
    assert incident.next.startswith("Its motor is on and may do nothing")
    assert "Register" not in incident.next
    (finding,) = (f for f in found(diagnosis) if f.code == "motor-limited-to-nothing")
    assert told in finding.what


def test_a_limit_that_is_written_back_at_once_is_none() -> None:
    undone = rs30x.write(1, 0x23, b"\x64")
    told = stands("rs30x", rs30x.write(1, 0x23, b"\0"), undone=undone).diagnosed()
    assert "motor-limited-to-nothing" not in codes(told)


def test_a_joint_that_goes_on_was_not_held_back() -> None:
    told = stands("rs30x", rs30x.write(1, 0x23, b"\0"), since=10_000).diagnosed()
    assert "motor-limited-to-nothing" not in codes(told)


@pytest.mark.parametrize("who", [1, 0xFE])
def test_torque_that_is_switched_off_is_told_so_whoever_of_it_is_told(who: int) -> None:
    """Nothing was known of the torque before: the recorder came later than its first order."""
    told = stands("mightyzap", mightyzap.packet(who, 0xF3, b"\x80\0")).diagnosed()
    (off,) = (f for f in found(told) if f.code == "goals-without-torque" and f.servo_id == 1)
    assert "is switched off" in off.what
    assert verdicts(told.incidents())[0] == ("torque-off", (1,))
