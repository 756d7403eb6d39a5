"""A servo that dies, and a controller that asks it again and again since: one fault."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.conversations import Conversation, robot
from tests.diagnosed import verdicts

if TYPE_CHECKING:
    from collections.abc import Callable


def asked_again(
    dies_at: int, storms_of: int, times: int = 8
) -> Callable[[Conversation, int, int], bool]:
    """Return what is done instead of a read: servo 2 is silent from a cycle on."""

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        is_gone = servo == 2 and cycle >= dies_at
        is_nagged = servo == storms_of and cycle >= dies_at and (is_gone or cycle % 10 == 0)
        for _ in range(times if is_nagged else int(is_gone)):
            talk.ask_in_vain(servo, 4)
        return is_gone

    return instead


@pytest.mark.parametrize("protocol", ["mightyzap", "lss", "rs30x", "wck"])
def test_a_servo_that_dies_and_is_asked_again_and_again_is_one_incident(protocol: str) -> None:
    talk = robot(protocol, 10, rate_hz=12, goals=False, instead=asked_again(40, 2))
    assert verdicts(talk.diagnosed().incidents()) == [("servo-dead", (2,))]


def test_a_storm_of_retries_to_another_servo_stays_its_own() -> None:
    talk = robot("rs30x", 10, rate_hz=12, goals=False, instead=asked_again(40, 3))
    assert set(verdicts(talk.diagnosed().incidents())) == {
        ("servo-dead", (2,)),
        ("retry-storm", (3,)),
    }
