"""Bare answers of a servo whose clock is slow: its places lack their highest bit."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from tests.conversations import Conversation, one_wire, robot
from tests.diagnosed import codes, verdicts
from tests.lists import each_in_turn

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.ground.model import Chunk

BIT = 128


def slowly(servo: int, s: float) -> float:
    """Return where a servo is to be: below and above the middle of its range, seconds for each."""
    return 0.55 + 0.13 * math.sin(2 * math.pi * (0.05 + 0.01 * servo) * s)


def of_a_slow_clock(talk: Conversation) -> Iterator[Chunk]:
    """Yield what is heard where the last bit of servo 2's bytes is read as the one before it: 0."""
    asked = b""
    for chunk in one_wire(talk):
        answers = not chunk.data.startswith(b"\xff") and asked[1] & 0x1F == 2
        yield replace(chunk, data=bytes(b % BIT for b in chunk.data)) if answers else chunk
        asked = chunk.data


def test_places_without_their_highest_bit_are_of_a_clock_that_is_off_and_of_no_limp_joint() -> None:
    talk = robot("wck", 20, path=slowly)
    d = talk.diagnosed(of_a_slow_clock(talk))
    assert "last-bits" in codes(d)
    assert verdicts(d.incidents()) == [("clock-drift", (2,))]


@each_in_turn(2, "place", [3 / 253, 40 / 253])
def test_a_joint_that_hangs_below_half_of_its_range_lacks_no_bit(place: float) -> None:
    def hangs(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo == 2:
            talk.read(servo, place)
        return servo == 2

    d = robot("wck", 20, path=slowly, instead=hangs).diagnosed()
    assert "last-bits" not in codes(d)
    assert [i.servo_ids for i in d.incidents()] == [(2,)]
