"""Connections that get worse: how much is lost when is told."""

from __future__ import annotations

import random

import pytest

from tests.conversations import Conversation, swinging
from tests.diagnosed import found


@pytest.mark.parametrize("gets_worse", [False, True])
def test_a_servo_that_loses_more_and_more_answers_is_told_so_by_quarters(
    *, gets_worse: bool
) -> None:
    rng = random.Random(9)
    talk = Conversation("mightyzap")
    for k in range(1500):
        share = 0.2 * (k - 500) / 1000 if gets_worse else 0.07
        for servo in (1, 2, 3):
            if servo == 2 and rng.random() < share:
                talk.ask_in_vain(servo)
            else:
                talk.read(servo, swinging(servo, talk.now_s))
        talk.rest(15)
    (lost,) = (f for f in found(talk.diagnosed()) if f.code == "comes-and-goes")
    assert ("more and more: 0, " in lost.what) == gets_worse
    assert (lost.brief == "servo 2 loses more and more answers") == gets_worse
