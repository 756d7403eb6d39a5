"""Servos that answer later than the others: because they were told so, or not."""

from __future__ import annotations

import pytest

from sniffer.ground.model import NS
from tests.conversations import T0, Conversation, through_usb
from tests.diagnosed import codes, found, verdicts
from tests.streams import rs30x

DELAY_AT = 0x07
"""Return Delay of RS30x: 100 us, and 50 us for each step."""


def polled(
    told: int | None, late_ms: float, *, states: int | None = None, late_from: int = 200
) -> Conversation:
    """Poll two servos; the first answers later from some round of 400 on, told so or not.

    Or it is asked for its delay before.
    """
    talk = Conversation("rs30x")
    if states is not None:
        talk.say(rs30x.packet(1, 0x0F, DELAY_AT, 1, 0))
        talk.rest(0.2)
        talk.say(rs30x.returned(1, DELAY_AT, bytes([states])))
        talk.rest(1)
    for k in range(400):
        if k == late_from and told is not None:
            talk.write(rs30x.write(1, DELAY_AT, bytes([told])))
        for servo in (1, 2):
            talk.say(talk.tongue.ask(servo))
            talk.rest(late_ms if servo == 1 and k >= late_from else 0.2)
            talk.say(talk.tongue.answer(servo, 0.5))
            talk.rest(1)
    return talk


@pytest.mark.parametrize(
    ("told", "late_ms", "code"),
    [
        (127, 6.6, "slow-by-its-delay"),
        (None, 6.6, "slower-than-peers"),
        (2, 6.6, "slower-than-peers"),
    ],
)
def test_a_servo_that_answers_late_as_it_was_told_does_as_it_was_told(
    told: int | None, late_ms: float, code: str
) -> None:
    diagnosis = polled(told, late_ms).diagnosed()
    (incident,) = diagnosis.incidents()
    assert verdicts([incident]) == [("slow-servo", (1,))]
    assert {"slow-by-its-delay", "slower-than-peers"} & codes(diagnosis) == {code}
    assert incident.next.startswith("It does as it is told") == (code == "slow-by-its-delay")


def test_who_is_called_slow_is_shown_by_the_request_of_a_slow_answer() -> None:
    talk = polled(None, 6.6)
    (slow,) = (f for f in found(talk.diagnosed()) if f.code == "slower-than-peers")
    data = b"".join(chunk.data for chunk in talk.chunks)
    (place,) = slow.places
    assert data[place.offset : place.offset + place.length] == talk.tongue.ask(1)
    assert place.offset >= len(data) // 2


def test_a_servo_that_becomes_slower_than_its_delay_is_so_since_its_first_late_answer() -> None:
    talk = polled(None, 6.6, states=0, late_from=100)
    told = talk.diagnosed()
    (slow,) = (f for f in found(told) if f.code == "slower-than-its-delay")
    (incident,) = told.incidents()
    assert incident.first_ns == slow.first_ns >= T0 + NS // 2


def grown(*slower: int) -> Conversation:
    """Poll three servos for a minute and a half; some take ever longer, 0.3 to 4 ms."""
    talk = Conversation("mightyzap")
    while talk.now_s < 90:
        for servo in (1, 2, 3):
            talk.say(talk.tongue.ask(servo))
            talk.rest(0.3 + 3.7 * talk.now_s / 90 if servo in slower else 0.3)
            talk.say(talk.tongue.answer(servo, 0.5))
            talk.rest(1)
        talk.rest(60)
    return talk


def test_a_servo_that_answers_more_and_more_slowly_is_told_so() -> None:
    diagnosis = grown(2).diagnosed()
    (incident,) = diagnosis.incidents()
    assert verdicts([incident]) == [("slow-servo", (2,))]
    assert "servo 2 answers more and more slowly" in incident.story
    assert "0.67, 1.41, 2.15, 2.89, 3.63 ms on average" in incident.findings[0].what
    assert "delay register" not in incident.next


@pytest.mark.parametrize("slower", [(), (1, 2, 3)])
def test_what_no_servo_or_each_does_is_no_servos(slower: tuple[int, ...]) -> None:
    assert not grown(*slower).diagnosed().incidents()


def test_a_servo_that_is_slow_from_a_moment_on_is_not_slower_and_slower() -> None:
    assert "slower-and-slower" not in codes(polled(None, 6.6).diagnosed())


def test_stamps_that_may_be_late_by_more_tell_of_no_servo_that_it_is_slower() -> None:
    assert not grown(2).diagnosed(through_usb(grown(2).chunks)).incidents()
