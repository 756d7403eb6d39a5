"""Devices that speak unasked beside other faults: each is told, and neither hides the other."""

from __future__ import annotations

import random

from sniffer.diagnosis.physics.uart import both, heard, sent
from tests.conversations import Conversation, robot, swinging, through_usb, without_clock
from tests.diagnosed import codes, verdicts
from tests.lists import each_in_turn
from tests.servos import suffering


def test_frames_torn_where_a_device_says_nothing_are_not_its_doing() -> None:
    d = suffering("rs30x", "chatty:2:6% flip:2.5%", 12.0)
    assert "torn-elsewhere" in codes(d)
    assert verdicts(d.incidents()) == [("chatty-device", (2,)), ("bus-noise", ())]


def test_what_a_device_itself_speaks_into_is_not_torn_elsewhere() -> None:
    for fault in ("chatty:2:20%", "flip:2.5%"):
        assert "torn-elsewhere" not in codes(suffering("rs30x", fault, 12.0))


def test_the_second_answers_of_one_servo_do_not_hide_another_ones_words() -> None:
    d = suffering("rs30x", "chatty:1:8% duplicate-id:2:40%", 12.0)
    assert set(verdicts(d.incidents())) == {("chatty-device", (1,)), ("duplicate-id", (2,))}


def test_who_speaks_in_the_rest_of_a_cycle_is_no_second_servo_of_whoever_was_asked_last() -> None:
    rng = random.Random(4)

    def say(talk: Conversation, cycle: int) -> None:
        if cycle % 12 == 0:  # some ms behind the answer of servo 3, one time more than another
            talk.rest(rng.uniform(1, 14))
            talk.say(talk.tongue.answer(3, swinging(3, talk.now_s)))

    talk = robot("lss", 15, behind=say)
    d = talk.diagnosed()
    assert "behind-its-own-alone" not in codes(d)
    assert verdicts(d.incidents()) == [("chatty-device", (3,))]
    late = talk.diagnosed(through_usb(talk.chunks))  # by which nobody knows how soon it came
    assert verdicts(late.incidents()) == [("chatty-device", (3,))]


def test_who_speaks_in_step_with_the_controller_is_no_second_servo() -> None:
    def say(talk: Conversation, cycle: int) -> None:
        if cycle % 12 == 0:  # a heartbeat of a multiple of the controller's period
            talk.rest(14)
            talk.say(talk.tongue.answer(3, swinging(3, talk.now_s)))

    d = robot("lss", 15, behind=say).diagnosed()
    assert "behind-its-own-alone" not in codes(d)
    assert verdicts(d.incidents()) == [("chatty-device", (3,))]


@each_in_turn(2, "servo", [2, 3])
def test_bare_words_that_go_with_another_servo_are_no_second_answers(servo: int) -> None:
    d = suffering("wck", f"chatty:{servo}:8%", 6.0)  # it speaks before it is asked the next time
    assert "seconds-follow-another" in codes(d)
    assert verdicts(d.incidents()) == [("chatty-device", (servo,))]


def test_bare_second_answers_of_a_servo_go_with_no_other() -> None:
    d = suffering("wck", "duplicate-id:1:20%", 6.0)
    assert "seconds-follow-another" not in codes(d)
    assert verdicts(d.incidents()) == [("duplicate-id", (1,))]


def spoken_into() -> Conversation:
    """Servo 21 has something to say twice a second; mostly the next request begins meanwhile."""

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if cycle % 20 or servo != (22, 37)[cycle // 20 % 2]:
            return False
        said = talk.tongue.answer(21, swinging(21, talk.now_s))
        if cycle % 100 == 60 and cycle < 400:
            talk.say(said)
            talk.rest(1)
            return False
        begin = 19 + cycle // 20 % 3  # its third byte, which tells 21 from 22, is torn each time
        talk.say(heard(both(sent(said), sent(talk.tongue.ask(servo), begin=begin), min)))
        talk.rest(1)
        return True

    return robot("lss", 16, servos=(21, 22, 37), instead=instead, goals=False)


def test_words_that_requests_cut_before_they_say_whose_they_are_go_with_the_whole_ones() -> None:
    """Ids 21 and 22 begin alike; of whom three were heard whole the others may be, too."""
    talk = spoken_into()
    for chunks in (talk.chunks, through_usb(talk.chunks), without_clock(talk.chunks)):
        assert verdicts(talk.diagnosed(chunks).incidents()) == [("chatty-device", (21,))]
