"""A controller's mistake with one servo, and the fault of another."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest

from tests.conversations import robot
from tests.diagnosed import verdicts
from tests.lists import in_turn

if TYPE_CHECKING:
    from tests.conversations import Conversation


@in_turn(2)
@pytest.mark.parametrize("opens", [0.0, 0.04])
@pytest.mark.parametrize("protocol", ["wck", "rs30x"])
def test_a_command_of_the_wrong_form_to_one_servo_does_not_open_the_cable_of_another(
    protocol: str, opens: float
) -> None:
    rng = random.Random(4)
    open_until = [0.0]

    def behind(talk: Conversation, cycle: int) -> None:
        if cycle % 8 == 7:
            asked = talk.tongue.ask(1)
            talk.say(asked[:-1] + bytes((asked[-1] ^ 0x15,)))
            talk.rest(5)

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo == 3 and rng.random() < opens:
            open_until[0] = talk.now_s + rng.uniform(0.02, 0.2)
        if servo != 3 or talk.now_s > open_until[0]:
            return False
        talk.say(talk.tongue.ask(3))
        talk.rest(20)
        return True

    told = verdicts(robot(protocol, 40, instead=instead, behind=behind).diagnosed().incidents())
    assert ("malformed-command", (1,)) in told
    assert {servos for _, servos in told} == ({(1,), (3,)} if opens else {(1,)})
