"""What an adapter's echo is told as, and what is none."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest

from sniffer.ground.model import Chunk, Severity
from tests.conversations import (
    TONGUES,
    Conversation,
    echoed,
    one_wire,
    robot,
    through_usb,
    without_clock,
)
from tests.diagnosed import alarms, codes, verdicts
from tests.lists import each_in_turn

PROTOCOLS = tuple(TONGUES)


@each_in_turn(4, "protocol", PROTOCOLS)
def test_an_adapters_echo_is_one_note_and_no_alarm_stands_beside_it(protocol: str) -> None:
    talk = robot(protocol, 4)
    (incident,) = talk.diagnosed(echoed(talk)).incidents()
    assert (incident.cause, incident.severity, incident.servo_ids) == ("echo", Severity.NOTE, ())


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_an_echo_without_a_clock_is_the_same_note(protocol: str) -> None:
    talk = robot(protocol, 4)
    assert verdicts(talk.diagnosed(without_clock(echoed(talk))).incidents()) == [("echo", ())]


def test_an_echo_of_what_nobody_answers_is_said_to_stand_there_twice() -> None:
    talk = Conversation("mightyzap")
    for n in range(200):
        talk.write(talk.tongue.goal(1 + n % 3, (n % 90) / 100))
        talk.rest(5)
    found_codes = codes(talk.diagnosed(echoed(talk)))
    assert "said-twice" in found_codes
    assert "said-twice" not in codes(talk.diagnosed(one_wire(talk)))


@pytest.mark.parametrize("reads", [False, True])
def test_one_goal_said_all_the_time_is_no_echo_where_the_host_takes_two_at_once(
    *, reads: bool
) -> None:
    talk = Conversation("mightyzap")
    for n in range(1000):
        talk.until(n * 0.008)
        talk.write(talk.tongue.goal(1, 0.5))
        if reads and n % 100 == 50:
            talk.read(1, 0.5)
    assert "said-twice" not in codes(talk.diagnosed(through_usb(talk.chunks)))


def test_an_echo_through_a_host_that_takes_two_at_once_is_one() -> None:
    talk = Conversation("mightyzap")
    for n in range(400):
        talk.until(n * 0.03)
        talk.write(talk.tongue.goal(1 + n % 3, (n % 90) / 100))
    assert "said-twice" in codes(talk.diagnosed(through_usb(echoed(talk))))


def test_an_echo_that_differs_shows_that_requests_are_altered_on_the_line() -> None:
    talk = robot("mightyzap", 8)
    rng = random.Random(1)
    heard: list[Chunk] = []
    was_request = False
    for chunk in echoed(talk):
        again = was_request and bool(heard) and heard[-1].data == chunk.data
        if again and rng.random() < 0.03:
            at = rng.randrange(len(chunk.data))
            torn = bytearray(chunk.data)
            torn[at] ^= 1 << rng.randrange(8)
            chunk = replace(chunk, data=bytes(torn))
        was_request = not again
        heard.append(chunk)
    told = talk.diagnosed(heard)
    assert "echo-differs" in codes(told)
    assert "bad-cable" not in alarms(told)
