"""Torn requests that are answered: only the tap heard them torn, so nobody spoke into them."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest

from sniffer.diagnosis.evidence.heard import heard
from tests.conversations import Conversation, robot, swinging, through_usb, without_clock
from tests.diagnosed import diagnosed, verdicts
from tests.lists import in_turn

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sniffer.ground.model import Chunk


def heard_torn(first: int, last: int, part: float) -> Conversation:
    """Requests to servo 2 of which the tap gets one byte wrong; the servo answers each."""
    rng = random.Random(3)

    def torn(talk: Conversation, cycle: int, servo: int) -> bool:
        del cycle
        if servo != 2 or rng.random() > part:
            return False
        request = bytearray(talk.tongue.ask(servo))
        request[rng.randrange(first, last)] ^= rng.randrange(1, 256)
        talk.say(bytes(request))
        talk.rest(0.5)
        talk.say(talk.tongue.answer(servo, swinging(servo, talk.now_s)))
        talk.rest(rng.uniform(0.3, 0.6))
        return True

    return robot("wck", 8, servos=(1, 2, 3), instead=torn)


def as_heard(chunks: Sequence[Chunk]) -> Sequence[Chunk]:
    return chunks


@in_turn(3)
@pytest.mark.parametrize(("first", "last", "part"), [(0, 1, 0.2), (0, 4, 0.5)], ids=str)
@pytest.mark.parametrize("tap", [as_heard, through_usb, without_clock])
def test_bare_answers_to_requests_that_the_tap_hears_torn_are_no_second_answers(
    first: int, last: int, part: float, tap: Callable[[Sequence[Chunk]], Sequence[Chunk]]
) -> None:
    told = diagnosed(tap(heard_torn(first, last, part).chunks), "wck").incidents()
    assert {cause for cause, _ in verdicts(told)} <= {"bus-noise"}


def test_a_torn_request_and_the_bare_answer_to_it_are_told_apart_however_they_are_cut() -> None:
    chunks = heard_torn(0, 4, 0.3).chunks
    told = [heard(*diagnosed(chunks, "wck", group).cases()) for group in (3, 7, 10_000)]
    assert told[0] == told[1] == told[2]
    assert len(told[0].requests) > 70  # of some 96
    assert told[0].answers
