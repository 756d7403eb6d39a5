"""A few answers that several servos lose in the same moments, while another one is sound."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest

from tests.conversations import Conversation, robot
from tests.diagnosed import codes, verdicts

if TYPE_CHECKING:
    from collections.abc import Callable

    from sniffer.diagnosis import Diagnosis

MOMENTS = (100, 130, 220)


def losing(protocol: str, is_lost: Callable[[int, int], bool], rate_hz: float = 25) -> Diagnosis:
    """Return the diagnosis of five servos in a loop; by cycle and servo, some answers are lost."""

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if not is_lost(cycle, servo):
            return False
        talk.ask_in_vain(servo, 8)
        return True

    talk = robot(
        protocol,
        300 / rate_hz,
        servos=(1, 2, 3, 4, 5),
        rate_hz=rate_hz,
        goals=False,
        instead=instead,
    )
    return talk.diagnosed()


@pytest.mark.parametrize("protocol", ["mightyzap", "lss", "rs30x", "wck"])
@pytest.mark.parametrize("behind", [3, 4])
def test_servos_that_lose_a_few_answers_in_the_same_moments_are_behind_one_cable(
    protocol: str, behind: int
) -> None:
    gone = tuple(range(6 - behind, 6))
    told = losing(protocol, lambda cycle, servo: servo in gone and cycle in MOMENTS)
    assert verdicts(told.incidents()) == [("bad-cable", gone)]


@pytest.mark.parametrize("rate_hz", [10, 30])
def test_it_is_told_of_slow_loops_and_fast_ones(rate_hz: float) -> None:
    told = losing("rs30x", lambda cycle, servo: servo > 2 and cycle in MOMENTS, rate_hz)
    assert "lost-together" in codes(told)


def test_where_all_servos_lose_answers_nobody_is_behind_a_cable() -> None:
    told = losing("rs30x", lambda cycle, servo: servo > 0 and cycle in MOMENTS)
    assert "lost-together" not in codes(told)


def test_answers_that_several_servos_lose_each_by_itself_are_not_lost_together() -> None:
    rng = random.Random(1)
    lost = {(cycle, servo) for servo in (2, 3, 4, 5) for cycle in rng.sample(range(300), 4)}
    told = losing("mightyzap", lambda cycle, servo: (cycle, servo) in lost)
    assert "lost-together" not in codes(told)
    assert not told.incidents()
