"""Requests that the tap reads wrong and the servos right: they are answered all the same."""

from __future__ import annotations

import random
from dataclasses import replace

import numpy as np
import pytest

from tests.conversations import Conversation, one_wire, robot, swinging
from tests.diagnosed import codes, verdicts
from tests.lists import in_turn


def misread(protocol: str, every: int, *, answered: bool = True) -> Conversation:
    """Return a loop of three joints in which each so many-th request has a bit wrong in its sum."""
    talk, rng = Conversation(protocol), random.Random(3)
    for k in range(900):
        servo = 1 + k % 3
        request = talk.tongue.ask(servo)
        if k % every:
            talk.read(servo, swinging(servo, talk.now_s))
            continue
        talk.say(request[:-1] + bytes([request[-1] ^ 1 << rng.randrange(8)]))
        talk.rest(0.3 if answered else 25)
        if answered:
            talk.say(talk.tongue.answer(servo, swinging(servo, talk.now_s)))
            talk.rest(1)
    return talk


@in_turn(4)
@pytest.mark.parametrize("protocol", ["mightyzap", "rs30x"])
@pytest.mark.parametrize("every", [1, 3])
def test_servos_that_answer_what_is_torn_here_tell_that_the_tap_misreads(
    protocol: str, every: int
) -> None:
    told = misread(protocol, every).diagnosed().incidents()
    assert verdicts(told) == [("signal-integrity", ())]
    assert "look at the tap" in told[0].next


def test_where_not_one_request_holds_both_sides_are_heard() -> None:
    assert "nobody-asks" not in codes(misread("mightyzap", 1).diagnosed())


def test_who_is_not_answered_was_misread_by_the_servos_too() -> None:
    assert "answered-though-altered" not in codes(misread("rs30x", 3, answered=False).diagnosed())


@pytest.mark.parametrize("seed", [6, 7, 9])
def test_lines_that_lack_a_sign_are_let_go_by_no_driver_and_have_no_bit_that_falls(
    seed: int,
) -> None:
    """A line holds without most of its signs: what is torn lacks an end, now this, now that."""
    talk = robot("lss", 40, servos=(1, 2, 3, 4, 5))
    rng = np.random.default_rng(seed)
    lossy = []
    for chunk in one_wire(talk):
        kept = rng.random(len(chunk.data)) > 0.002
        lossy.append(replace(chunk, data=bytes(np.frombuffer(chunk.data, np.uint8)[kept])))
    first = talk.diagnosed(lossy).incidents()[0].causes[0].cause
    assert first in {"tap-loss", "bus-noise"}
