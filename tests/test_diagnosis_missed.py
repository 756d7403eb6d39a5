"""Requests that one servo misses one by one: no clock, and no restart, has it so."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest

from tests.conversations import Conversation, robot
from tests.diagnosed import codes
from tests.servos import suffering

if TYPE_CHECKING:
    from sniffer.diagnosis import Diagnosis, Incident

PROTOCOLS = ("mightyzap", "lss", "rs30x", "wck")


def losing(protocol: str, share: float, seed: int = 1) -> Diagnosis:
    """Return the diagnosis of a loop in which servo 2 misses a share of its reads, by chance."""
    rng = random.Random(seed)

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        del cycle
        if servo != 2 or rng.random() >= share:
            return False
        talk.ask_in_vain(servo, 8)
        return True

    return robot(protocol, 30, goals=False, instead=instead).diagnosed()


def of_servo(diagnosis: Diagnosis, servo: int) -> Incident:
    (incident,) = diagnosis.incidents()
    assert incident.servo_ids == (servo,)
    return incident


@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize("share", [0.03, 0.08])
def test_who_misses_the_very_request_that_it_else_answers_has_no_clock_that_is_off(
    protocol: str, share: float
) -> None:
    told = losing(protocol, share)
    assert "same-request-missed" in codes(told)
    incident = of_servo(told, 2)
    first = incident.causes[0]
    assert first.cause == "bad-cable"
    assert first.confidence < 0.8
    assert all(c.confidence < 0.25 for c in incident.causes if c.cause == "clock-drift")


@pytest.mark.parametrize(("protocol", "servo"), [("lss", 5), ("rs30x", 5), ("mightyzap", 1)])
def test_answers_that_a_simulated_servo_drops_are_no_matter_of_its_clock(
    protocol: str, servo: int
) -> None:
    told = suffering(protocol, f"drop-reply:{servo}:6%", 20.0, 2)
    assert of_servo(told, servo).cause == "bad-cable"


def test_a_request_that_is_never_answered_for_a_while_is_not_missed_in_turn() -> None:
    """As of a servo whose clock drifts: it misreads the same bytes each time, and no others."""

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != 2 or not 300 < cycle < 400:
            return False
        talk.ask_in_vain(servo, 8)
        return True

    told = robot("rs30x", 15, goals=False, instead=instead).diagnosed()
    assert "same-request-missed" not in codes(told)


def test_goals_that_are_misread_by_their_bytes_are_not_the_same_request() -> None:
    rng = random.Random(4)
    talk = Conversation("wck")
    for cycle in range(800):
        talk.until(cycle * 0.03)
        for servo in (1, 2, 3):
            place = rng.randrange(250) / 253
            if servo == 2 and place < 0.05:
                talk.say(talk.tongue.goal(servo, place))
                talk.rest(8)
            else:
                talk.send(servo, place)
    assert "same-request-missed" not in codes(talk.diagnosed())


def test_stretches_of_chance_are_told_from_those_of_one_length() -> None:
    assert "missed-one-by-one" in codes(losing("wck", 0.08, seed=2))

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != 2 or cycle % 40 not in (7, 8):
            return False
        talk.ask_in_vain(servo, 8)
        return True

    restarting = robot("wck", 30, goals=False, instead=instead).diagnosed()
    assert "missed-one-by-one" not in codes(restarting)


def test_answers_of_all_that_are_lost_one_by_one_are_told_with_a_doubt() -> None:
    for protocol in ("rs30x", "wck"):
        (incident,) = suffering(protocol, "drop-reply:4%", 14.0).incidents()
        assert incident.cause == "signal-integrity"
        assert incident.causes[0].confidence < 0.7
