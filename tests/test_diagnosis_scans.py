"""Somebody who tries rates until servos answer: what he says at others is no noise."""

from __future__ import annotations

import random

import pytest

from sniffer.diagnosis.physics.uart import heard, sent
from tests.conversations import BAUD, Conversation, swinging, through_usb
from tests.diagnosed import codes, verdicts
from tests.lists import in_turn

RATES = (9600, 19200, 38400, 57600, 115200, 230400, 250000)


def searched(protocol: str, rates: tuple[int, ...] = RATES, servos: int = 12) -> Conversation:
    """Ask each of some ids at each rate, two of which are there, then poll these for a while."""
    talk = Conversation(protocol)
    for rate in rates:
        for servo in range(1, servos + 1):
            if rate != BAUD:
                talk.say(heard(sent(talk.tongue.ask(servo), BAUD / rate)))
                talk.rest(30)
            elif servo <= 2:
                talk.read(servo, 0.5)
            else:
                talk.ask_in_vain(servo)
    poll(talk)
    return talk


def poll(talk: Conversation) -> None:
    for k in range(600):
        servo = 1 + k % 2
        talk.read(servo, swinging(servo, talk.now_s))


@in_turn(4)
@pytest.mark.parametrize("protocol", ["mightyzap", "rs30x", "lss", "wck"])
@pytest.mark.parametrize("is_late", [False, True])
def test_a_search_for_the_rate_is_told_as_one(protocol: str, *, is_late: bool) -> None:
    talk = searched(protocol)
    told = talk.diagnosed(through_usb(talk.chunks) if is_late else None).incidents()
    assert verdicts(told) == [("rate-search", ())]


def test_a_search_that_finds_nobody_is_told_as_one() -> None:
    talk = Conversation("mightyzap")
    for rate in RATES:
        for servo in range(1, 40):
            request = talk.tongue.ask(servo)
            talk.say(request if rate == BAUD else heard(sent(request, BAUD / rate)))
            talk.rest(30)
    assert "rates-tried" in codes(talk.diagnosed())


@pytest.mark.parametrize("rates", [(BAUD,), (BAUD, 57600)])
def test_one_rate_and_another_are_no_search(rates: tuple[int, ...]) -> None:
    assert "rates-tried" not in codes(searched("mightyzap", rates).diagnosed())


def test_noise_is_no_search() -> None:
    talk, rng = Conversation("mightyzap"), random.Random(7)
    for _ in range(200):
        talk.say(rng.randbytes(rng.randrange(4, 30)))
        talk.rest(30)
    poll(talk)
    assert "rates-tried" not in codes(talk.diagnosed())


def test_noise_behind_a_search_is_noise() -> None:
    talk, rng = searched("mightyzap"), random.Random(7)
    for _ in range(40):
        talk.rest(1000)
        poll(talk)
        talk.say(rng.randbytes(rng.randrange(10, 30)))
    assert "rates-tried" not in codes(talk.diagnosed())
