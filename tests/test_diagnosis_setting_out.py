"""A supply that does not bear motors that set out, beside servos that go away by themselves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.conversations import Conversation
from tests.diagnosed import codes, verdicts

if TYPE_CHECKING:
    from collections.abc import Callable

    from sniffer.diagnosis import Diagnosis

STEP_S = 2.1
SERVOS = (1, 2, 3)
PLACES = (0.2, 0.8, 0.45, 0.7, 0.25)


def stepping(
    protocol: str, is_away: Callable[[float], bool], seconds: float = 25.0, *, every: float = STEP_S
) -> Diagnosis:
    """Send all servos somewhere now and then, and look where they are; servo 2 is away at times."""
    talk, step = Conversation(protocol), -1
    for cycle in range(int(seconds * 25)):
        talk.until(cycle / 25)
        if int(talk.now_s / every) > step:
            step = int(talk.now_s / every)
            for servo in SERVOS:
                if servo == 2 and is_away(talk.now_s) and talk.tongue.tells is not None:
                    talk.say(talk.tongue.goal(servo, PLACES[(step + servo) % 5]))
                    talk.rest(2)
                else:
                    talk.send(servo, PLACES[(step + servo) % 5])
        for servo in SERVOS:
            if servo == 2 and is_away(talk.now_s):
                talk.ask_in_vain(servo, 4)
            else:
                talk.read(servo, PLACES[(step + servo) % 5])
    return talk.diagnosed()


def behind_steps(s: float) -> bool:
    return s > STEP_S and 0.1 < s % STEP_S < 0.55


@pytest.mark.parametrize("protocol", ["mightyzap", "lss", "rs30x"])
def test_who_goes_away_as_motors_set_out_lacks_its_supply(protocol: str) -> None:
    """At even times, and for as long each time, as one that restarts: but so come the goals."""
    d = stepping(protocol, behind_steps)
    assert "outages-behind-steps" in codes(d)
    assert "outages-evenly" not in codes(d)
    assert verdicts(d.incidents()) == [("brownout", (2,))]


@pytest.mark.parametrize("protocol", ["mightyzap", "lss"])
def test_who_goes_away_at_a_pace_of_its_own_starts_anew(protocol: str) -> None:
    d = stepping(protocol, lambda s: s > 3 and 0.2 < s % 1.63 < 0.6)
    assert "outages-behind-steps" not in codes(d)
    assert verdicts(d.incidents()) == [("servo-reset-loop", (2,))]


def test_where_goals_step_all_the_time_nothing_stands_behind_them_alone() -> None:
    d = stepping("mightyzap", lambda s: s > 2 and 0.1 < s % STEP_S < 0.55, every=0.7)
    assert "outages-behind-steps" not in codes(d)
