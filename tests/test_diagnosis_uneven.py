"""Loops that are uneven all the time: their longest cycles are no stops."""

from __future__ import annotations

import random

from tests.conversations import robot
from tests.diagnosed import verdicts
from tests.lists import each_in_turn


@each_in_turn(3, "protocol", ["mightyzap", "lss", "rs30x", "wck"])
def test_waits_that_end_at_any_time_are_one_uneven_loop(protocol: str) -> None:
    rng = random.Random(protocol)
    talk = robot(protocol, 60, rate_hz=400, before=lambda it, _: it.rest(rng.expovariate(1 / 30)))
    assert verdicts(talk.diagnosed().incidents()) == [("controller-jitter", ())]


def test_a_loop_that_is_uneven_and_stops_as_well_does_both() -> None:
    rng = random.Random(2)

    def pauses(n: int) -> float:
        return 900 if n % 200 == 199 else rng.expovariate(1 / 30)

    talk = robot("mightyzap", 60, rate_hz=400, before=lambda it, n: it.rest(pauses(n)))
    told = {cause for cause, _ in verdicts(talk.diagnosed().incidents())}
    assert told == {"controller-jitter", "controller-stall"}
