"""Servos that acknowledge no order any more, and answer every read: nobody was away."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING, Final

import pytest

from tests.conversations import TONGUES, Conversation, swinging
from tests.diagnosed import codes, found, verdicts
from tests.streams import mightyzap, rs30x, wck

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sniffer.diagnosis import Diagnosis

ORDERS: Final[Mapping[str, Callable[[int, float], tuple[bytes, bytes]]]] = {
    "mightyzap": lambda servo, place: (
        TONGUES["mightyzap"].goal(servo, place),
        mightyzap.packet(servo, 0),
    ),
    "rs30x": lambda servo, place: (
        rs30x.write(servo, 30, round(place * 2400 - 1200).to_bytes(2, "little", signed=True), 1),
        b"\x07",
    ),
    "wck": lambda servo, place: (
        wck.command(1 << 5 | servo, 1 + round(place * 253)),
        bytes([3, 1 + round(place * 253)]),
    ),
}
"""An order, and how it is acknowledged."""


def loop(
    protocol: str,
    who: tuple[int, ...],
    *,
    since_s: float = 8.0,
    reads: int = 5,
    lost: float = 0.0,
) -> Diagnosis:
    """Return the diagnosis of orders to three servos; some acknowledge none from a time on.

    Every so many cycles each is read; some answers are lost by chance.
    """
    rng = random.Random(5)
    talk = Conversation(protocol)
    for cycle in range(450):
        talk.until(cycle / 25)
        for servo in (1, 2, 3):
            place = swinging(servo, talk.now_s)
            order, told = ORDERS[protocol](servo, place)
            talk.say(order)
            is_kept = servo in who and talk.now_s >= since_s
            talk.rest(6 if is_kept else 0.3)
            if not is_kept and rng.random() >= lost:
                talk.say(told)
                talk.rest(0.4)
            if cycle % reads == servo:
                talk.read(servo, place)
    return talk.diagnosed()


@pytest.mark.parametrize("protocol", list(ORDERS))
@pytest.mark.parametrize("reads", [4, 25])
@pytest.mark.parametrize("who", [(2,), (1, 2, 3)])
def test_who_acknowledges_no_order_from_a_moment_on_does_not_restart(
    protocol: str, reads: int, who: tuple[int, ...]
) -> None:
    told = loop(protocol, who, reads=reads)
    assert verdicts(told.incidents()) == [("servo-refuses", who)]
    assert told.incidents()[0].causes[0].confidence > 0.8


@pytest.mark.parametrize("protocol", ["rs30x", "wck"])
def test_orders_that_were_never_acknowledged_are_told_alike(protocol: str) -> None:
    """A protocol in which nobody need acknowledge them (mightyZAP) has nothing to tell."""
    assert verdicts(loop(protocol, (2,), since_s=0.0).incidents()) == [("servo-refuses", (2,))]


def test_what_is_not_acknowledged_is_named_with_since_when() -> None:
    told = loop("rs30x", (2,), lost=0.01)
    (said,) = (f for f in found(told) if f.code == "one-question-unanswered")
    assert said.servo_id == 2
    assert "servo 2 answers no write" in said.what
    assert "since 8.0" in said.what


@pytest.mark.parametrize("protocol", list(ORDERS))
def test_orders_that_are_lost_by_chance_are_not_left(protocol: str) -> None:
    assert "one-question-unanswered" not in codes(loop(protocol, (), lost=0.15))


@pytest.mark.parametrize("protocol", list(ORDERS))
def test_who_is_gone_answers_no_reads_either(protocol: str) -> None:
    """It is ordered more than it is read, so that mostly orders are missed."""
    talk = Conversation(protocol)
    for cycle in range(450):
        talk.until(cycle / 25)
        for servo in (1, 2, 3):
            place = swinging(servo, talk.now_s)
            order, told = ORDERS[protocol](servo, place)
            is_away = servo == 2 and cycle % 60 > 40
            talk.say(order)
            talk.rest(6 if is_away else 0.3)
            if not is_away:
                talk.say(told)
                talk.rest(0.4)
            if cycle % 12 == servo and is_away:
                talk.ask_in_vain(servo, 6)
            elif cycle % 12 == servo:
                talk.read(servo, place)
    assert "one-question-unanswered" not in codes(talk.diagnosed())
