"""Goals that two programs state to one servo, and what looks like it."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest

from tests.conversations import Conversation, swinging
from tests.diagnosed import codes, found, verdicts
from tests.lists import in_turn

if TYPE_CHECKING:
    from collections.abc import Callable

PROTOCOLS = ("mightyzap", "lss", "rs30x", "wck")


def led(
    protocol: str, goal: Callable[[int], float], seconds: float = 8.0, every_ms: float = 15
) -> Conversation:
    """Send servo 1 somewhere at an even pace, and look where it is each time."""
    talk = Conversation(protocol)
    for k in range(int(1000 * seconds / every_ms)):
        talk.until(k * every_ms / 1000)
        talk.send(1, goal(k))
        talk.read(1, 0.5)
    return talk


@in_turn(4)
@pytest.mark.parametrize("of", [2, 3])
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_goals_of_two_programs_in_turns_are_told(protocol: str, of: int) -> None:
    """One holds the servo where it is, the other leads it along a path, as often or oftener."""

    def goal(k: int) -> float:
        return 0.9 if k % of == 0 else swinging(1, k * 0.015) / 2

    told = led(protocol, goal).diagnosed()
    assert ("position-jump", (1,)) in verdicts(told.incidents())
    (finding,) = (f for f in found(told) if f.code == "goals-in-turns")
    assert finding.servo_id == 1


@pytest.mark.parametrize(
    ("goal", "every_ms"),
    [
        pytest.param(lambda k: 0.2 + 0.6 * (k % 2), 250, id="to and fro, as soon as it can"),
        pytest.param(lambda k: 0.5 + 0.004 * (k % 2), 15, id="a tremor against friction"),
        pytest.param(
            lambda k: 0.5 + random.Random(k).gauss(0, 0.05), 15, id="goals that tremble by chance"
        ),
        pytest.param(lambda k: 0.2 + 0.6 * (k // 20 % 2), 15, id="each goal said twenty times"),
        pytest.param(lambda k: 0.9 if k % 20 == 0 else 0.2, 15, id="now and then, for a while"),
    ],
)
@pytest.mark.parametrize("protocol", ["mightyzap", "rs30x"])
def test_what_one_program_states_is_not_told_as_two(
    protocol: str, goal: Callable[[int], float], every_ms: float
) -> None:
    assert "goals-in-turns" not in codes(led(protocol, goal, every_ms=every_ms).diagnosed())
