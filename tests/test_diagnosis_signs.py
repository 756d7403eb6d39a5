"""By which bytes torn places tell whose they are."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING, Final

import pytest

from sniffer.diagnosis.evidence.signs import named_within
from sniffer.diagnosis.physics.uart import both, heard, sent
from sniffer.ground.model import Direction
from tests.conversations import Conversation, robot, swinging, through_usb, without_clock
from tests.diagnosed import codes, verdicts
from tests.lists import each_in_turn
from tests.streams import mightyzap, rs30x

if TYPE_CHECKING:
    from collections.abc import Callable

    from sniffer.diagnosis import Diagnosis

SERVOS: Final = (1, 4, 6, 9)
NAMED: Final = ("lss", "rs30x")
"""Protocols whose answers say whose they are, and requests do not look alike."""

TWIN, BEHIND = 4, 6
"""Whose second answer it is, and over whose answer it lies."""


def laid_over(
    protocol: str, second: Callable[[Conversation, int, int], bytes | None], seconds: float = 12.0
) -> Conversation:
    """Lay something over answers, from their second half on; who pulls low wins."""

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        over = second(talk, cycle, servo)
        if over is None:
            return False
        talk.say(talk.tongue.ask(servo))
        talk.rest(0.3)
        own = talk.tongue.answer(servo, swinging(servo, talk.now_s))
        begin = 10 * (len(own) - 2) + (cycle // 8 * 7 % 40) / 4
        talk.say(heard(both(sent(own), sent(over, begin=begin), min)))
        talk.rest(0.5)
        return True

    return robot(protocol, seconds, servos=SERVOS, instead=instead, goals=False)


def by_one(protocol: str) -> Conversation:
    def second(talk: Conversation, cycle: int, servo: int) -> bytes | None:
        del cycle
        place = 0.8 * swinging(TWIN, talk.now_s)
        return talk.tongue.answer(TWIN, place) if servo == BEHIND else None

    return laid_over(protocol, second)


def by_anybody(protocol: str) -> Conversation:
    """A tap that lost bytes joins what is left of everybody's answers."""

    def second(talk: Conversation, cycle: int, servo: int) -> bytes | None:
        before = SERVOS[SERVOS.index(servo) - 1]
        some = cycle % 8 == SERVOS.index(servo)
        return talk.tongue.answer(before, swinging(before, talk.now_s)) if some else None

    return laid_over(protocol, second)


def names(told: Diagnosis) -> set[int]:
    return {servo for case in told.cases() for servo in named_within(case).values()}


@each_in_turn(2, "protocol", NAMED)
def test_a_second_answer_within_anothers_tells_whose_it_is(protocol: str) -> None:
    """It is read from the first start bit on that the receiver finds, in step or not."""
    talk = by_one(protocol)
    for chunks in (talk.chunks, through_usb(talk.chunks), without_clock(talk.chunks)):
        told = talk.diagnosed(chunks)
        assert names(told) == {TWIN}
        assert verdicts(told.incidents()) == [("duplicate-id", (TWIN,))]


@each_in_turn(2, "protocol", NAMED)
def test_pieces_of_everybodys_answers_are_nobodys_second_answer(protocol: str) -> None:
    told = by_anybody(protocol).diagnosed()
    assert not names(told)
    assert ("duplicate-id", (TWIN,)) not in verdicts(told.incidents())


@pytest.mark.parametrize("protocol", NAMED)
def test_a_sound_bus_names_nobody_within(protocol: str) -> None:
    assert not names(robot(protocol, servos=SERVOS).diagnosed())


def test_a_servo_of_which_nothing_was_sound_is_not_taken_for_one_of_a_like_number() -> None:
    """Ids 54 and 56 begin alike; all that 56 says is torn by its twin."""

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != 56:
            return False
        talk.say(talk.tongue.ask(servo))
        talk.rest(0.3)
        place = swinging(servo, talk.now_s)
        own, other = (talk.tongue.answer(servo, p) for p in (place, 0.7 * place))
        talk.say(heard(both(sent(own), sent(other, begin=31 + (cycle * 5 % 32) / 4), min)))
        talk.rest(0.5)
        return True

    talk = robot("lss", 12, servos=(15, 54, 56, 88), instead=instead, goals=False)
    for chunks in (talk.chunks, through_usb(talk.chunks), without_clock(talk.chunks)):
        assert verdicts(talk.diagnosed(chunks).incidents())[:1] == [("duplicate-id", (56,))]


def among_others(talk: Conversation, cycle: int, said: bytes, asked: bytes) -> None:
    """Say something that nobody asked for; the next request begins over it. Who pulls low wins."""
    talk.rest(1)
    talk.say(heard(both(sent(said), sent(asked, begin=10 * len(said) - 25 + cycle % 5), min)))
    talk.rest(1)


def chatting(protocol: str, who: int = 9) -> Conversation:
    """Let a servo speak now and then, always behind the exchanges of the same other one."""

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo == 6 and cycle % 12 == 7:
            said = talk.tongue.answer(who, swinging(who, talk.now_s))
            among_others(talk, cycle, said, talk.tongue.ask(servo))
            return True
        return False

    return robot(protocol, 16, servos=SERVOS, instead=instead, goals=False)


@each_in_turn(2, "protocol", NAMED)
def test_what_is_torn_behind_one_servo_and_says_that_it_is_anothers_is_that_ones(
    protocol: str,
) -> None:
    talk = chatting(protocol)
    for chunks in (talk.chunks, through_usb(talk.chunks), without_clock(talk.chunks)):
        assert verdicts(talk.diagnosed(chunks).incidents()) == [("chatty-device", (9,))]


def test_a_servo_that_speaks_unasked_is_known_though_its_answers_to_writes_are_bare() -> None:
    """What answers of two kinds have in common is nothing where one is a byte without a header."""

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        talk.say(rs30x.write(servo, 0x20, b"\x10\x00", flags=1))
        talk.rest(0.3)
        talk.say(b"\x07")
        talk.rest(0.3)
        if servo == 6 and cycle % 50 == 7:
            said = talk.tongue.answer(9, swinging(9, talk.now_s))
            among_others(talk, cycle, said, talk.tongue.ask(1))
        return False

    talk = robot("rs30x", 16, servos=SERVOS, instead=instead, goals=False)
    assert verdicts(talk.diagnosed().incidents()) == [("chatty-device", (9,))]


def test_an_id_that_is_misread_in_ones_own_head_names_nobody_else() -> None:
    """A bit of the id falls in each third answer of 6: it is 4 then, who was asked before."""

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != BEHIND:
            return False
        talk.say(talk.tongue.ask(servo))
        talk.rest(0.3)
        said = bytearray(talk.tongue.answer(servo, swinging(servo, talk.now_s)))
        said[3] ^= 2 * (cycle % 3 == 0)
        talk.say(bytes(said))
        talk.rest(0.4)
        return True

    told = robot("mightyzap", servos=SERVOS, instead=instead, goals=False).diagnosed()
    assert "bad-checksum" in codes(told)
    assert not names(told)


def test_two_of_one_id_whose_heads_are_mixed_do_not_speak_for_another_id() -> None:
    """51 and 51, two bits apart, are read as 32 by a receiver."""

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != 51:
            return False
        talk.say(talk.tongue.ask(servo))
        talk.rest(0.3)
        own, other = (talk.tongue.answer(servo, p) for p in (0.4, 0.6))
        talk.say(heard(both(sent(own), sent(other, begin=0.6 + cycle % 9 / 4), min)))
        talk.rest(0.5)
        return True

    told = robot("rs30x", servos=(20, 32, 51), instead=instead, goals=False).diagnosed()
    assert (51,) in [servos for _, servos in verdicts(told.incidents())]
    assert "speaks-unasked" not in codes(told)


def test_data_of_many_torn_answers_that_look_like_the_head_of_another_one_are_none() -> None:
    """Position 08xx, speed 5, as servo 8 answers to three bytes; the last byte is misread."""
    talk = Conversation("mightyzap", 57600)
    rng = random.Random(4)
    for cycle in range(600):
        talk.until(cycle / 20)
        for servo in (1, 2, 3, 8):
            size = 3 if servo == 8 else 8
            talk.say(mightyzap.packet(servo, 0xF2, bytes((0x8C, size))), Direction.TX)
            talk.rest(0.3)
            speed = rng.choice((5, 6, 7, 40, 41, 42, 43, 44))
            place = 0x0700 + cycle if servo != 3 else 0x07F0 + cycle % 48
            data = place.to_bytes(2, "little") + bytes((speed, 0, 0, 4, 0x79, 0x1D))
            said = bytearray(mightyzap.packet(servo, 0, data[:size]))
            if servo == 3 and rng.random() < 0.6:
                said[-1] ^= 1 << rng.randrange(8)
            talk.say(bytes(said), Direction.RX)
            talk.rest(0.4)
    assert "speaks-unasked" not in codes(talk.diagnosed())
