"""Requests left one by one: in turns, which is no chance, or at any time, which is no start."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

from tests.conversations import Conversation, swinging, without_clock
from tests.diagnosed import codes, found, verdicts
from tests.lists import each_in_turn
from tests.streams import mightyzap

if TYPE_CHECKING:
    from collections.abc import Callable

VOLTAGE = bytes([0x92, 1])
"""Address and length of what a mightyZAP measures of its supply."""


def polled(
    protocol: str, is_lost: Callable[[int], bool], rounds: int = 300, rest_ms: float = 10
) -> Conversation:
    """Return a loop over three servos; answers of the third are lost by the number of the round."""
    talk = Conversation(protocol)
    for cycle in range(rounds):
        for servo in (1, 2, 3):
            if servo == 3 and is_lost(cycle):
                talk.ask_in_vain(servo)
            else:
                talk.read(servo, swinging(servo, talk.now_s))
        talk.rest(rest_ms)
    return talk


@each_in_turn(4, "protocol", ["mightyzap", "lss", "rs30x", "wck"])
def test_who_answers_every_second_request_counts(protocol: str) -> None:
    diagnosis = polled(protocol, lambda cycle: cycle % 2 == 1).diagnosed()
    assert verdicts(diagnosis.incidents()) == [("servo-refuses", (3,))]
    (finding,) = (f for f in found(diagnosis) if f.code == "answers-every-nth")
    assert finding.what == "servo 3 answers one request of 2, in turns: 150 of 300"


def test_who_answers_every_third_request_counts_as_well() -> None:
    diagnosis = polled("mightyzap", lambda cycle: cycle % 3 > 0).diagnosed()
    (finding,) = (f for f in found(diagnosis) if f.code == "answers-every-nth")
    assert finding.what == "servo 3 answers one request of 3, in turns: 100 of 300"


def test_who_loses_answers_now_and_then_does_not_count() -> None:
    assert "answers-every-nth" not in codes(
        polled("mightyzap", lambda cycle: cycle * cycle % 7 == 2).diagnosed()
    )


def test_who_leaves_one_question_of_two_does_not_count() -> None:
    talk = Conversation("mightyzap")
    for _ in range(200):
        talk.read(2, 0.5)
        talk.say(mightyzap.packet(2, 0xF2, VOLTAGE))
        talk.rest(0.3)
        talk.say(mightyzap.packet(2, 0, b"\x78"))
        talk.read(3, 0.5)
        talk.say(mightyzap.packet(3, 0xF2, VOLTAGE))
        talk.rest(25)
    assert "answers-every-nth" not in codes(talk.diagnosed())


@each_in_turn(2, "protocol", ["mightyzap", "rs30x"])
def test_who_misses_single_requests_by_chance_does_not_start_anew(protocol: str) -> None:
    rng = random.Random(1)
    talk = polled(protocol, lambda _: rng.random() < 0.06, rounds=500, rest_ms=20)
    (incident,) = talk.diagnosed().incidents()
    assert incident.cause != "servo-reset-loop"


def test_without_a_clock_no_silence_lasts_for_seconds() -> None:
    talk = polled("mightyzap", lambda cycle: 100 <= cycle < 110 or cycle >= 250)
    told = {f.code: f.what for f in found(talk.diagnosed(without_clock(talk.chunks)))}
    assert told["away-for-a-while"] == "servo 3 was away once, for 10 requests in a row"
    assert told["silent-since"].endswith("not once since, 50 requests")
