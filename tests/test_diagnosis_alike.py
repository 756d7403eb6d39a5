"""Answers that all servos miss alike, one by one: nobody's supply, clock or cable is to blame."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest

from tests.conversations import Conversation, swinging, through_usb
from tests.diagnosed import codes, verdicts
from tests.lists import each_in_turn, in_turn

if TYPE_CHECKING:
    from collections.abc import Mapping


def missing(protocol: str, shares: Mapping[int, float], seed: int = 5) -> Conversation:
    """Poll servos that leave a share of their requests unanswered, each by chance."""
    talk, rng = Conversation(protocol), random.Random(seed)
    for _ in range(500):
        for servo, share in shares.items():
            if rng.random() < share:
                talk.ask_in_vain(servo)
            else:
                talk.read(servo, swinging(servo, talk.now_s))
    return talk


@in_turn(4)
@pytest.mark.parametrize("protocol", ["mightyzap", "rs30x", "lss", "wck"])
@pytest.mark.parametrize("is_late", [False, True])
def test_what_all_servos_miss_is_no_fault_of_each_of_them(protocol: str, *, is_late: bool) -> None:
    talk = missing(protocol, {1: 0.03, 2: 0.03, 3: 0.03})
    told = talk.diagnosed(through_usb(talk.chunks) if is_late else None).incidents()
    assert verdicts(told) == [("signal-integrity", ())]
    assert "the controller's baud rate" in told[0].next


@each_in_turn(4, "seed", range(4))
def test_one_that_misses_more_is_told_of_itself(seed: int) -> None:
    told = missing("mightyzap", {1: 0.01, 2: 0.08, 3: 0.01}, seed).diagnosed()
    assert "all-miss-alike" not in codes(told)


def test_servos_that_go_away_for_a_while_each_are_not_missing_by_chance() -> None:
    talk = Conversation("mightyzap")
    for k in range(600):
        for servo in (1, 2, 3):
            if (k + 30 * servo) % 150 < 5:
                talk.ask_in_vain(servo)
            else:
                talk.read(servo, swinging(servo, talk.now_s))
    assert "all-miss-alike" not in codes(talk.diagnosed())
