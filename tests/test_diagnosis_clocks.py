"""A servo whose clock is off, where hardly anything it says is whole."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import pytest

from sniffer.diagnosis.physics.uart import both, heard, sent
from sniffer.protocols import PROTOCOLS
from sniffer.protocols.base import answer_begins
from tests.conversations import TONGUES, Conversation, robot, swinging, through_usb, without_clock
from tests.diagnosed import codes, verdicts
from tests.lists import each_in_turn, in_turn
from tests.streams import mightyzap, rs30x

NAMED: Final = ("mightyzap", "rs30x", "lss")
"""Protocols whose answers begin with whom they are from."""

SICK: Final = 2

Tears = Callable[[bytes], bytes]


def fast(said: bytes) -> bytes:
    return heard(sent(said, 0.942))


def slow(said: bytes) -> bytes:
    return heard(sent(said, 1.062, rise=0.22))


def headless(said: bytes) -> bytes:
    """A driver that is on for too long takes the first byte."""
    return said[1:]


def of_two(said: bytes) -> bytes:
    """Two answer at once, the second a bit and a half later; who pulls low wins."""
    other = said[:-3] + bytes(b ^ 0x15 for b in said[-3:])
    return heard(both(sent(said), sent(other, begin=1.5), min))


def answering(
    protocol: str,
    tears: Tears,
    servos: tuple[int, ...] = (SICK,),
    since: float = 0.0,
    goals: bool = True,
) -> Conversation:
    """Let what one servo answers be torn from a time on."""

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != SICK or talk.now_s < since:
            return False
        talk.say(talk.tongue.ask(servo))
        talk.rest(0.4)
        talk.say(tears(talk.tongue.answer(servo, swinging(servo, talk.now_s))))
        talk.rest(0.6)
        return True

    return robot(protocol, servos=servos, instead=instead, goals=goals)


@pytest.mark.parametrize("protocol", NAMED)
def test_how_an_answer_begins_follows_from_the_request(protocol: str) -> None:
    tongue, known = TONGUES[protocol], PROTOCOLS[protocol]
    for servo in (1, 7, 99):
        head = answer_begins(known, tongue.ask(servo))
        assert len(head) >= 4
        assert tongue.answer(servo, 0.3).startswith(head)
        assert len(answer_begins(known, tongue.goal(servo, 0.3))) < len(head) + 2
    assert answer_begins(known, b"\x00\x01") == b""


def test_a_protocol_that_does_not_say_how_answers_begin_is_asked_in_vain() -> None:
    assert answer_begins(PROTOCOLS["wck"], TONGUES["wck"].ask(1)) == b""


@in_turn(2)
@pytest.mark.parametrize("tears", [fast, slow])
@pytest.mark.parametrize("protocol", ["mightyzap", "rs30x"])
def test_a_clock_is_known_to_be_off_though_no_answer_at_all_is_sound(
    protocol: str, tears: Tears
) -> None:
    talk = answering(protocol, tears)
    for chunks in (talk.chunks, through_usb(talk.chunks), without_clock(talk.chunks)):
        told = talk.diagnosed(chunks)
        assert verdicts(told.incidents())[:1] == [("clock-drift", (SICK,))]


@in_turn(2)
@pytest.mark.parametrize("tears", [headless, of_two])
@pytest.mark.parametrize("protocol", ["mightyzap", "rs30x"])
def test_what_else_tears_all_answers_of_the_only_servo_is_no_clock(
    protocol: str, tears: Tears
) -> None:
    assert "clock-off" not in codes(answering(protocol, tears).diagnosed())


def ends_late(said: bytes) -> bytes:
    """A clock that is so little off that the last bits of the last byte alone are misread."""
    return said[:-1] + bytes((said[-1] ^ (0x08, 0x30, 0x50, 0xE0)[said[-2] % 4],))


def anyhow(said: bytes) -> bytes:
    """Something spoils the last byte in any of its bits."""
    return said[:-1] + bytes((said[-1] ^ (0x01, 0x32, 0x56, 0xE4)[said[-2] % 4],))


@pytest.mark.parametrize("protocol", ["mightyzap", "rs30x"])
def test_where_no_answer_was_ever_whole_checksums_tell_which_bits_are_misread(
    protocol: str,
) -> None:
    told = answering(protocol, ends_late).diagnosed()
    assert "last-bits" in codes(told)
    assert verdicts(told.incidents())[:1] == [("clock-drift", (SICK,))]
    assert "last-bits" not in codes(answering(protocol, anyhow).diagnosed())


def ask_the_fast_one(talk: Conversation, servo: int, place: float) -> None:
    talk.say(talk.tongue.ask(servo))
    talk.rest(0.4)
    talk.say(fast(talk.tongue.answer(servo, place)))


def test_answers_in_turn_with_others_that_tell_nothing_are_compared_all_the_same() -> None:
    """Every fourth answer is told; of those between only a bare byte is heard."""

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != SICK or talk.now_s < 2:
            return False
        if cycle % 4:
            talk.say(rs30x.write(servo, 0x1E, bytes((cycle % 100, 0)), flags=1))
            talk.rest(0.4)
            talk.say(fast(b"\x07"))
        else:
            ask_the_fast_one(talk, servo, swinging(servo, talk.now_s))
        talk.rest(0.6)
        return True

    told = robot("rs30x", 12, instead=instead, goals=False).diagnosed()
    assert "clock-off" in codes(told)
    assert verdicts(told.incidents())[:1] == [("clock-drift", (SICK,))]


def test_a_clock_whose_servo_is_asked_while_it_moves_is_no_interference_of_motors() -> None:
    """What tears the answers of one servo alone goes with how often it is asked."""

    def path(servo: int, s: float) -> float:
        return swinging(servo, s) if s % 4 > 2 else 0.5

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != SICK or talk.now_s < 2:
            return False
        if talk.now_s % 4 > 2:
            ask_the_fast_one(talk, servo, path(servo, talk.now_s))
            talk.rest(0.6)
        return True

    told = robot("rs30x", 20, path=path, instead=instead).diagnosed()
    assert "damage-while-moving" not in codes(told)
    assert verdicts(told.incidents()) == [("clock-drift", (SICK,))]


@each_in_turn(2, "tears", [fast, slow])
def test_of_writes_that_only_its_peers_are_heard_to_answer_the_torn_answers_are_its_own(
    tears: Tears,
) -> None:
    """The answer to a write is the same each time, so it is torn into the same bytes each time."""
    talk = Conversation("mightyzap")
    for _ in range(120):
        for servo in (1, SICK, 3):
            place = swinging(servo, talk.now_s)
            done, state = mightyzap.packet(servo, 0), talk.tongue.answer(servo, place)
            for asked, said in (
                (talk.tongue.goal(servo, place), done),
                (talk.tongue.ask(servo), state),
            ):
                talk.say(asked)
                talk.rest(0.4)
                talk.say(tears(said) if servo == SICK else said)
                talk.rest(20 if servo == SICK else 0.4)
        talk.rest(5)
    told = talk.diagnosed()
    assert verdicts(told.incidents())[:1] == [("clock-drift", (SICK,))]
    assert "same-bytes-torn" not in codes(told)
