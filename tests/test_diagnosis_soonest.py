"""Losses that follow how soon a servo answers: a driver that is on for too long, or else."""

from __future__ import annotations

import random
from collections.abc import Callable
from types import SimpleNamespace
from typing import TYPE_CHECKING, Final, cast

import pytest

from sniffer.diagnosis.rules.timing.soonest import by_chance, in_order
from tests.conversations import Conversation, robot, swinging
from tests.diagnosed import codes, verdicts
from tests.lists import each_in_turn
from tests.streams import mightyzap

if TYPE_CHECKING:
    from sniffer.diagnosis.evidence.lost import LostAnswers

DELAY_MS: Final = {1: 0.55, 2: 0.35, 3: 0.75, 4: 0.9}
"""How soon the servos answer."""

Left = Callable[[random.Random, int, bytes], tuple[int, int]]
"""Which bytes of a servo's answer are left: from which on, to which."""


def robot_that_loses(protocol: str, left: Left) -> Conversation:
    """Return a robot whose servos answer each in its own time; ``left`` says what is left of it."""
    rng = random.Random(5)

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        talk.say(talk.tongue.ask(servo))
        talk.rest(DELAY_MS[servo] + rng.uniform(0, 0.02))
        answer = talk.tongue.answer(servo, swinging(servo, talk.now_s))
        begin, end = left(rng, servo, answer)
        talk.now_ns += begin * talk.byte_ns
        if answer[begin:end]:
            talk.say(answer[begin:end])
        talk.rest(8 if end - begin < len(answer) else rng.uniform(0.4, 1.0))
        return True

    return robot(protocol, 14, servos=tuple(DELAY_MS), rate_hz=20, instead=instead, goals=False)


def held_for(least_ms: float, most_ms: float) -> Left:
    """The driver of the controller is on behind one request in eight, for so long."""

    def left(rng: random.Random, servo: int, answer: bytes) -> tuple[int, int]:
        if rng.random() > 0.125:
            return 0, len(answer)
        held_ms = rng.uniform(least_ms, most_ms) - DELAY_MS[servo]
        return max(0, min(len(answer), round(held_ms / 0.087 + 0.5))), len(answer)

    return left


def contact_of(*servos: int) -> Left:
    """A contact in front of some servos opens and closes, within answers as well."""

    def left(rng: random.Random, servo: int, answer: bytes) -> tuple[int, int]:
        if servo not in servos or rng.random() > 0.12:
            return 0, len(answer)
        at = rng.randrange(len(answer) + 1)
        return rng.choice(((at, len(answer)), (0, at), (0, 0), (0, 0)))

    return left


@each_in_turn(2, "protocol", ["wck", "rs30x"])
def test_a_driver_that_is_on_for_too_long_takes_most_from_who_answers_soonest(
    protocol: str,
) -> None:
    told = robot_that_loses(protocol, held_for(0.4, 0.95)).diagnosed()
    assert "soonest-lost" in codes(told)
    assert verdicts(told.incidents()) == [("turnaround", ())]


def test_a_contact_at_the_servo_that_answers_soonest_is_a_contact() -> None:
    told = robot_that_loses("wck", contact_of(2)).diagnosed()
    assert "soonest-lost" not in codes(told)
    assert verdicts(told.incidents()) == [("bad-cable", (2,))]


def test_a_contact_at_the_servos_that_answer_soonest_tears_the_ends_of_answers_too() -> None:
    told = robot_that_loses("rs30x", contact_of(1, 2)).diagnosed()
    assert "soonest-lost" not in codes(told)
    assert [cause for cause, _ in verdicts(told.incidents())] == ["bad-cable"]


def test_a_servo_that_loses_more_than_who_answers_sooner_is_not_in_order() -> None:
    shares = {2: 0.12, 1: 0.09, 6: 0.2, 3: 0.1, 4: 0.01}
    lost = [
        cast("LostAnswers", SimpleNamespace(servo=s, share=share)) for s, share in shares.items()
    ]
    assert in_order(lost) == {2, 1, 3, 4}


def test_who_answers_last_loses_most_to_a_controller_that_does_not_wait() -> None:
    """Its next request comes 0.8 ms behind the last one: whoever takes longer speaks in vain."""

    def left(rng: random.Random, servo: int, answer: bytes) -> tuple[int, int]:
        waits_ms = rng.uniform(0.8, 1.6) - DELAY_MS[servo]
        return 0, max(0, min(len(answer), int(waits_ms / 0.087)))

    assert "soonest-lost" not in codes(robot_that_loses("rs30x", left).diagnosed())


def test_a_stray_that_spoils_the_first_byte_of_who_answers_sooner_is_no_clock_of_his() -> None:
    """The other one answers behind it, and it stands alone: it is of the line, not of a servo."""
    rng = random.Random(6)

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        asks = cycle % 2 == 0
        talk.say(talk.tongue.ask(servo) if asks else talk.tongue.goal(servo, rng.random()))
        place = swinging(servo, talk.now_s)
        answer = talk.tongue.answer(servo, place) if asks else mightyzap.packet(servo, 0, b"")
        falls = rng.random() < 0.3
        if servo == 1:
            talk.rest(0.3)
            talk.say(
                bytes((rng.choice((0xBF, 0xDF, 0xDC, 0x80)),)) + answer[1:] if falls else answer
            )
        else:
            if falls:
                talk.rest(0.02)
                talk.say(rng.choice((b"\x00", b"\xc0", b"\xe0")))
            talk.rest(0.6)
            talk.say(answer)
        talk.rest(rng.uniform(0.5, 1.0))
        return True

    talk = robot("mightyzap", 12, servos=(1, 2), instead=instead, goals=False)
    told = talk.diagnosed()
    assert verdicts(told.incidents()) == [("turnaround", ())]
    assert "last-bits" not in codes(told)


def test_how_likely_an_order_is_by_chance_is_one_in_all_orders() -> None:
    assert by_chance([1, 2, 3], [0.3, 0.2, 0.1]) == pytest.approx(1 / 6)
    assert by_chance([1, 2, 3], [0.1, 0.2, 0.3]) == 1.0
    assert by_chance([2, 1, 3, 4], [0.2, 0.3, 0.1, 0.0]) == pytest.approx(1 / 24)
    assert by_chance(range(12), [0.1] * 12) == 1.0
    assert by_chance([0, 0, 0], [0.3, 0.2, 0.1]) == 1.0  # all in one packet
    assert by_chance([1, 1, 2], [0.3, 0.2, 0.1]) == pytest.approx(1 / 3)
    assert by_chance(range(12), [1 / (k + 1) for k in range(12)]) < 0.01
