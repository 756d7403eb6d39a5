"""Requests in a row to one servo without an answer: one outage, however often it is asked."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from sniffer.ground.model import Severity
from tests.conversations import Conversation, swinging
from tests.diagnosed import codes, found, verdicts
from tests.lists import in_turn

if TYPE_CHECKING:
    from collections.abc import Callable

    from sniffer.diagnosis.diagnosis import Diagnosis

PROTOCOLS = ["mightyzap", "lss", "rs30x", "wck"]

SERVOS = (1, 2, 3, 4)


def looped(
    protocol: str, is_lost: Callable[[int, float], bool], seconds: float, rest_ms: float
) -> Conversation:
    """Return a loop over four servos; answers are lost by the servo and the time."""
    talk = Conversation(protocol)
    begun_s = talk.now_s
    while talk.now_s - begun_s < seconds:
        for servo in SERVOS:
            if is_lost(servo, talk.now_s - begun_s):
                talk.ask_in_vain(servo)
            else:
                talk.read(servo, swinging(servo, talk.now_s))
        talk.rest(rest_ms)
    return talk


@in_turn(4)
@pytest.mark.parametrize("rest_ms", [20, 100])
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_one_outage_is_told_alike_however_often_a_servo_is_asked(
    protocol: str, rest_ms: float
) -> None:
    diagnosis = looped(protocol, lambda s, t: s == 2 and 8 <= t < 8.5, 16, rest_ms).diagnosed()
    (incident,) = diagnosis.incidents()
    # nothing is known of its supply: it may have started anew
    assert [ranked.cause for ranked in incident.likely] == ["brownout", "servo-outage"]
    assert incident.causes[0].percent < 60
    assert (incident.servo_ids, incident.count) == ((2,), 1)
    (finding,) = (f for f in found(diagnosis) if f.code == "away-seldom")
    assert finding.what.endswith("; 3 of 3 others answered all that they were asked meanwhile")


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_an_outage_that_has_not_ended_with_the_capture_is_no_dead_servo(protocol: str) -> None:
    diagnosis = looped(protocol, lambda s, t: s == 2 and t >= 9.5, 10, 100).diagnosed()
    (incident,) = diagnosis.incidents()
    assert (incident.cause, incident.servo_ids) == ("servo-outage", (2,))
    assert incident.severity == Severity.WARN
    assert "servo 2 silent to the end, for 0." in incident.story


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_of_a_servo_that_has_just_fallen_silent_nobody_is_sure_that_it_is_dead(
    protocol: str,
) -> None:
    """Many requests in little time: no accident, and it may start anew."""
    diagnosis = looped(protocol, lambda s, t: s == 2 and t >= 9.5, 10, 20).diagnosed()
    (incident,) = diagnosis.incidents()
    assert (incident.cause, incident.servo_ids) == ("servo-dead", (2,))
    assert 40 <= incident.causes[0].percent < 85


@in_turn(4)
@pytest.mark.parametrize("rest_ms", [20, 1000])
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_who_is_silent_to_the_end_for_longer_than_a_start_takes_stopped_answering(
    protocol: str, rest_ms: float
) -> None:
    diagnosis = looped(protocol, lambda s, t: s == 2 and t >= 10, 15, rest_ms).diagnosed()
    assert verdicts(diagnosis.incidents()) == [("servo-dead", (2,))]


def test_an_outage_of_all_servos_is_none_of_one() -> None:
    diagnosis = looped("mightyzap", lambda s, t: 8 <= t < 8.5, 16, 20).diagnosed()
    assert "away-seldom" not in codes(diagnosis)


def test_one_answer_that_is_lost_is_no_outage() -> None:
    diagnosis = looped("mightyzap", lambda s, t: s == 2 and 8 <= t < 8.04, 16, 20).diagnosed()
    assert not diagnosis.incidents()
    assert diagnosis.rest([]).told == "1 x no-response (servo 2)"


def test_outages_that_are_a_habit_are_not_told_one_by_one() -> None:
    diagnosis = looped("wck", lambda s, t: s == 2 and t % 4 >= 3.5, 20, 20).diagnosed()
    assert "away-seldom" not in codes(diagnosis)


def test_a_silence_is_told_by_its_bounds_and_several_by_the_shortest_and_the_longest() -> None:
    once = looped("mightyzap", lambda s, t: s == 2 and 8 <= t < 8.5, 16, 100).diagnosed()
    assert away(once) == "servo 2 was away once, for 398 to 639 ms (4 requests in a row)"
    often = looped(
        "mightyzap", lambda s, t: s == 2 and t % 4 >= (3.5 if t < 8 else 2.5), 20, 100
    ).diagnosed()
    assert away(often) == (
        "servo 2 was away 4 times, for 530 to 1591 ms (4 to 12 requests in a row)"
    )


def away(diagnosis: Diagnosis) -> str:
    """Return what is told of silences."""
    (finding,) = (f for f in found(diagnosis) if f.code == "away-for-a-while")
    return finding.what
