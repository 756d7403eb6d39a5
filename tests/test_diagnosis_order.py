"""Requests that are missing from a controller's order, and those that come in another one."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest

from tests.conversations import Conversation, swinging
from tests.diagnosed import codes

if TYPE_CHECKING:
    from sniffer.diagnosis import Diagnosis


def rounds(protocol: str, seldom: tuple[int, ...], unheard: float = 0.0) -> Diagnosis:
    """Return the diagnosis of a loop that sends a goal, rests, and asks three servos.

    One round in seventy asks them in the order ``seldom``; the tap hears some exchanges not at all.
    """
    rng = random.Random(3)
    talk = Conversation(protocol)
    for cycle in range(600):
        talk.write(talk.tongue.goal(9, swinging(9, talk.now_s)))
        for servo in seldom if cycle % 70 == 7 else (1, 2, 3):
            before = len(talk.chunks)
            talk.read(servo, swinging(servo, talk.now_s))
            if rng.random() < unheard:
                del talk.chunks[before:]
        talk.until(cycle * 0.02 + 0.02)
    return talk.diagnosed()


@pytest.mark.parametrize("protocol", ["rs30x", "mightyzap", "lss"])
@pytest.mark.parametrize("seldom", [(2, 3, 1), (3, 1, 2)])
def test_a_round_in_another_order_lacks_no_requests(protocol: str, seldom: tuple[int, ...]) -> None:
    assert "requests-missing" not in codes(rounds(protocol, seldom))


@pytest.mark.parametrize("protocol", ["rs30x", "mightyzap", "lss"])
def test_exchanges_that_the_tap_did_not_hear_are_missing_from_the_order(protocol: str) -> None:
    assert "requests-missing" in codes(rounds(protocol, (1, 2, 3), unheard=0.02))
