"""Bare answers that state one place and then another: two who answer at once, and what looks so."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

import pytest

from sniffer.diagnosis.physics.uart import both, heard, sent
from tests.conversations import Conversation, robot, swinging, through_usb, without_clock
from tests.diagnosed import codes, diagnosed, verdicts
from tests.lists import each_in_turn
from tests.streams import wck

if TYPE_CHECKING:
    from sniffer.diagnosis import Diagnosis

ODD: Final = 2
SECONDS: Final = 6
SIZE: Final = 2
"""Bytes of a bare answer."""

Says = Callable[[float, random.Random], bytes]


def answering(says: Says, seed: int = 1) -> Conversation:
    """Let one of three servos answer as ``says`` has it, by its place."""
    rng = random.Random(seed)

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != ODD:
            return False
        talk.say(talk.tongue.ask(servo))
        talk.rest(0.4)
        talk.say(says(swinging(servo, talk.now_s), rng))
        talk.rest(0.5)
        return True

    return robot("wck", SECONDS, instead=instead, goals=False)


def own(place: float) -> bytes:
    return bytes([3, 1 + round(place * 253)])


def two(place: float, rng: random.Random) -> bytes:
    """Return what is heard of two that begin up to three bits apart; who pulls low wins."""
    other = sent(bytes([9, 0xB5]), begin=rng.uniform(0.0, 3.0))
    return heard(both(sent(own(place)), other, min))[:SIZE]


def by_turns(place: float, rng: random.Random) -> bytes:
    """Return the answer of the one or of the other of two, whoever is heard."""
    return own(place) if rng.random() < 0.5 else bytes([9, 0xF2])


def by_a_clock(off: float, wanders: float) -> Says:
    """Return answers of a servo whose clock is off, now a little more and now a little less."""
    return lambda place, rng: heard(
        sent(own(place), 1.0 + off + rng.uniform(-wanders, wanders)), rng.uniform(0.5, 0.56)
    )[:SIZE]


def weak(place: float, rng: random.Random) -> bytes:
    """Return an answer of which the highest bit falls in every second."""
    said = own(place)
    return bytes([said[0], said[1] & 0x7F]) if rng.random() < 0.5 else said


@pytest.mark.parametrize("says", [two, by_turns])
def test_a_servo_that_is_here_and_there_by_turns_is_two(says: Says) -> None:
    told = answering(says).diagnosed()
    assert "places-scatter" in codes(told)
    assert verdicts(told.incidents()) == [("duplicate-id", (ODD,))]


def late(talk: Conversation) -> Diagnosis:
    return talk.diagnosed(through_usb(talk.chunks))


def untimed(talk: Conversation) -> Diagnosis:
    return talk.diagnosed(without_clock(talk.chunks))


@pytest.mark.parametrize("host", [late, untimed])
def test_two_that_answer_at_once_are_two_however_late_the_stamps_are(
    host: Callable[[Conversation], Diagnosis],
) -> None:
    assert verdicts(host(answering(two)).incidents()) == [("duplicate-id", (ODD,))]


@each_in_turn(3, "off", [-0.075, -0.06, -0.055, 0.055, 0.0625, 0.07, 0.08])
def test_a_clock_that_is_off_is_no_second_servo(off: float) -> None:
    told = answering(by_a_clock(off, 0.006)).diagnosed()
    assert "places-scatter" not in codes(told)
    assert ("duplicate-id", (ODD,)) not in verdicts(told.incidents())


def test_a_bit_that_falls_again_and_again_is_no_second_servo() -> None:
    assert "places-scatter" not in codes(answering(weak).diagnosed())


def to_and_fro(hz: float) -> Conversation:
    """Send servos from one end to the other with each request, where they are with the next."""
    talk = Conversation("wck")
    for cycle in range(round(SECONDS * hz)):
        talk.until(cycle / hz)
        for servo in range(4):
            place = 0.9 if (cycle + servo) % 2 else 0.1
            talk.say(wck.command(0x40 | servo, 1 + round(place * 253)))
            talk.rest(0.4)
            talk.say(own(1.0 - place))
            talk.rest(0.5)
    return talk


@pytest.mark.parametrize("hz", [5, 10, 20])
def test_a_servo_that_is_sent_to_and_fro_faster_than_any_is_one(hz: float) -> None:
    assert not to_and_fro(hz).diagnosed().incidents()


def test_positions_spoiled_on_the_whole_line_are_no_second_servo() -> None:
    rng = random.Random(4)

    def spoiled(talk: Conversation, cycle: int, servo: int) -> bool:
        if rng.random() > 0.25:
            return False
        talk.say(talk.tongue.ask(servo))
        talk.rest(0.4)
        talk.say(bytes([3, rng.randrange(256)]))
        talk.rest(0.5)
        return True

    assert "places-scatter" not in codes(robot("wck", SECONDS, instead=spoiled).diagnosed())


def test_how_often_places_are_here_and_there_does_not_depend_on_how_a_stream_was_cut() -> None:
    talk = answering(two)
    whole, cut = (diagnosed(talk.chunks, "wck", group, baud=talk.baud) for group in (512, 3))
    assert [i.as_dict() for i in whole.incidents()] == [i.as_dict() for i in cut.incidents()]


def impatient(cycles: int) -> Conversation:
    """Ask a servo before the one before it has answered; that one's request was talked over."""
    talk = Conversation("wck")
    for cycle in range(cycles):
        talk.until(cycle / 40)
        asked = talk.tongue.ask(1)
        talk.say(bytes([*asked[:-1], asked[-1] ^ (0x18 if cycle % 2 else 0)]))
        talk.rest(0.3)
        if not cycle % 2:
            talk.say(own(0.2))
            talk.rest(0.4)
        talk.say(talk.tongue.ask(2))
        talk.rest(0.3)
        if cycle % 2:
            talk.say(own(0.2))
            talk.rest(0.2)
        talk.say(own(0.8))
        talk.rest(0.4)
        for servo in (3, 4):
            talk.read(servo, 0.5)
    return talk


def test_an_answer_that_comes_behind_the_next_request_makes_no_second_servo_of_its_servo() -> None:
    assert "places-scatter" not in codes(impatient(300).diagnosed())


def fallen() -> Conversation:
    """Let the line fall for some bits behind 3 in 10 requests: a byte nobody sent.

    One servo stands in the middle; where the others stand, their loads read as places look alike.
    """
    rng = random.Random(7)

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        talk.say(talk.tongue.ask(servo))
        talk.rest(0.2)
        if rng.random() < 0.3:
            talk.say(bytes([rng.choice((0xE0, 0xF0, 0xFC))]))
        talk.rest(0.2)
        talk.say(own(0.6 if servo == ODD else 0.01 + 0.05 * swinging(servo, talk.now_s)))
        talk.rest(0.5)
        return True

    return robot("wck", SECONDS, instead=instead, goals=False)


@pytest.mark.parametrize("host", [late, untimed, lambda talk: talk.diagnosed()])
def test_stray_bytes_before_answers_of_all_servos_make_no_second_servo(
    host: Callable[[Conversation], Diagnosis],
) -> None:
    told = host(fallen())
    assert "places-scatter" not in codes(told)
    assert "duplicate-id" not in {cause for cause, _ in verdicts(told.incidents())}


@pytest.mark.parametrize("host", [late, untimed, lambda talk: talk.diagnosed()])
def test_a_servo_that_is_two_is_two_beside_a_stray_byte_now_and_then(
    host: Callable[[Conversation], Diagnosis],
) -> None:
    rng = random.Random(11)

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        hit = rng.random() < 0.03
        if servo != ODD and not hit:
            return False
        talk.say(talk.tongue.ask(servo))
        talk.rest(0.2)
        if hit:
            talk.say(b"\x80")
        talk.rest(0.2)
        talk.say(two(swinging(servo, talk.now_s), rng) if servo == ODD else own(0.4))
        talk.rest(0.5)
        return True

    told = host(robot("wck", SECONDS, instead=instead, goals=False))
    assert ("duplicate-id", (ODD,)) in verdicts(told.incidents())
