"""Servos that go away together are told together, and outages are counted in one way."""

from __future__ import annotations

import pytest

from sniffer.diagnosis.gathering import steps
from sniffer.diagnosis.model import Finding
from sniffer.ground.wording import servos
from tests.conversations import Conversation, swinging
from tests.diagnosed import found

OPEN_S = ((2.0, 2.3), (7.1, 7.7), (11.2, 11.5), (16.5, 17.4))
"""When the cable is open."""


def chained(gone: tuple[int, ...]) -> Conversation:
    """Return a loop over six servos, some of which are away in the same moments."""
    talk = Conversation("mightyzap")
    while talk.now_s < 22:
        for servo in (1, 2, 3, 4, 5, 6):
            is_open = any(since <= talk.now_s < until for since, until in OPEN_S)
            if servo in gone and is_open:
                talk.ask_in_vain(servo, 5)
            else:
                talk.read(servo, swinging(servo, talk.now_s))
        talk.rest(20)
    return talk


def test_servos_that_are_away_together_are_one_step_of_a_story() -> None:
    (incident,) = chained((4, 5, 6)).diagnosed().incidents()
    assert (incident.cause, incident.count) == ("bad-cable", 4)
    title, _, story = incident.story.partition(": ")
    assert title == "a bad cable or connector (servos 4-6)"
    silent, lost = story.split(" -> ")
    assert silent.startswith("servos 4-6 silent at once for ")
    assert silent.endswith(" ms, 4 times")
    assert lost == (
        "servos 4-6 lose answers in the same 4 moments, servos 1-3 do not "
        "(between 3 and 4 if they are wired in this order)"
    )


def test_where_servos_apart_fail_together_no_place_between_is_named() -> None:
    (incident,) = chained((2, 3, 6)).diagnosed().incidents()
    assert "servos 2, 3 and 6 lose answers in the same 4 moments" in incident.story
    assert "wired" not in incident.story


def test_outages_of_a_servo_have_one_count_in_all_that_is_told_of_it() -> None:
    talk = Conversation("mightyzap")
    for cycle in range(500):
        for servo in (1, 2, 3):
            # one request here, one of two there: four outages in a few turns, six requests
            if servo == 3 and cycle > 200 and cycle % 40 in (0, 2, 4, 5, 8, 9):
                talk.ask_in_vain(servo, 5)
            else:
                talk.read(servo, swinging(servo, talk.now_s))
        talk.rest(20)
    for _ in range(4):
        talk.ask_in_vain(3, 5)
    diagnosis = talk.diagnosed()
    (lost,) = (f for f in found(diagnosis) if f.code == "comes-and-goes")
    (rhythm,) = (f for f in found(diagnosis) if f.code.startswith("outages-"))
    assert f" in {lost.count} outages;" in lost.what
    assert rhythm.what.startswith(f"the {lost.count} outages of servo 3 ")
    assert lost.what.endswith("; 4 more until the end")


def test_servos_that_fall_silent_for_good_at_one_moment_are_one_step() -> None:
    talk = Conversation("mightyzap")
    while talk.now_s < 10:
        for servo in (1, 2, 3, 4):
            if talk.now_s > 6:
                talk.ask_in_vain(servo, 5)
            else:
                talk.read(servo, swinging(servo, talk.now_s))
        talk.rest(20)
    (incident,) = talk.diagnosed().incidents()
    assert incident.story == (
        "a servo that stopped answering (servos 1-4): servos 1-4 silent to the end, for 4 s"
    )


@pytest.mark.parametrize(
    ("ids", "told"),
    [
        ((), ""),
        ((3,), "servo 3"),
        ((4, 3), "servos 3 and 4"),
        ((6, 7, 8, 9, 10), "servos 6-10"),
        ((1, 2, 4, 6, 7, 8), "servos 1, 2, 4 and 6-8"),
    ],
)
def test_servos_in_a_row_are_told_as_a_range(ids: tuple[int, ...], told: str) -> None:
    assert servos(ids) == told


def test_what_several_servos_have_alike_is_one_step() -> None:
    limp = [
        Finding("joint-limp", k, 0, 0, 1, "", brief=f"servo {k} limp since") for k in (1, 2, 12)
    ]
    other = Finding("noise", None, 0, 0, 1, "", brief="frames damaged")
    assert steps([*limp, other]) == ["each of servos 1, 2 and 12 limp since", "frames damaged"]
