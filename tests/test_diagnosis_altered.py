"""Frames in which single bits were altered, and that hold all the same: that is damage."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING, Final

from tests.conversations import Conversation, swinging
from tests.diagnosed import codes, found, verdicts
from tests.lists import each_in_turn
from tests.streams import rs30x

if TYPE_CHECKING:
    from collections.abc import Callable

    from sniffer.diagnosis import Diagnosis

SERVOS: Final = (1, 2, 3)


def one_bit(rng: random.Random, data: bytes) -> bytes:
    at = rng.randrange(len(data))
    return data[:at] + bytes([data[at] ^ 1 << rng.randrange(8)]) + data[at + 1 :]


def polled(
    protocol: str,
    alter: Callable[[random.Random, int, bytes], bytes],
    *,
    seed: int = 1,
    goals: bool = False,
) -> Diagnosis:
    """Return a loop over three servos, of which a tap hears frames altered.

    Args:
        protocol: what is spoken.
        alter: takes the random numbers, the servo that speaks (0: the controller) and its frame.
        seed: of the random numbers.
        goals: a goal is sent to each before it is asked.
    """
    rng = random.Random(seed)
    talk = Conversation(protocol)
    for _ in range(400):
        for servo in SERVOS:
            place = swinging(servo, talk.now_s)
            if goals:
                talk.say(alter(rng, 0, talk.tongue.goal(servo, place)))
                talk.rest(0.3)
                if talk.tongue.tells is not None:
                    talk.say(alter(rng, servo, talk.tongue.tells(servo, place)))
                talk.rest(3)
            talk.say(alter(rng, 0, talk.tongue.ask(servo)))
            talk.rest(0.3)
            talk.say(alter(rng, servo, talk.tongue.answer(servo, place)))
            talk.rest(8)
    return talk.diagnosed()


def of_servo_2(rng: random.Random, servo: int, data: bytes) -> bytes:
    return one_bit(rng, data) if servo == 2 and rng.random() < 0.15 else data


def test_bits_that_are_altered_in_bare_answers_of_one_servo_are_its_cable_and_no_worn_sensor() -> (
    None
):
    told = polled("wck", of_servo_2)
    assert {"values-altered", "damage-one-servo"} <= codes(told)
    assert "position-jumps" not in codes(told)
    assert verdicts(told.incidents()) == [("bad-cable", (2,))]


def test_a_sensor_that_jumps_to_anywhere_is_worn_whatever_bits_are_worth() -> None:
    def jumps(rng: random.Random, servo: int, data: bytes) -> bytes:
        far = servo == 2 and rng.random() < 0.02
        return bytes([data[0], (data[1] + rng.choice((45, 75, 98))) % 255]) if far else data

    told = polled("wck", jumps)
    assert "values-altered" not in codes(told)
    assert verdicts(told.incidents()) == [("position-jump", (2,))]


def by_the_tap(rng: random.Random, servo: int, data: bytes) -> bytes:
    del servo
    return one_bit(rng, data) if rng.random() < 0.05 else data


@each_in_turn(3, "seed", range(3))
def test_noise_on_frames_that_are_mostly_zeros_is_no_weak_signal(seed: int) -> None:
    told = polled("wck", by_the_tap, seed=seed, goals=True)
    assert [cause for cause, _ in verdicts(told.incidents())] == ["bus-noise"]


@each_in_turn(3, "seed", [3, 6, 13])
def test_a_sign_that_is_altered_in_a_line_is_no_second_controller_and_no_other_command(
    seed: int,
) -> None:
    told = polled("lss", by_the_tap, seed=seed, goals=True)
    assert not {"requests-run-together", "modifier-misused", "odd-commands"} & codes(told)
    assert [cause for cause, _ in verdicts(told.incidents())] == ["bus-noise"]


def test_looks_right_behind_each_jump_of_a_goal_see_motors_start_and_none_that_bears_much() -> None:
    talk = Conversation("rs30x")
    for k in range(40):
        talk.until(0.36 * k)
        place = 0.2 + 0.6 * (k % 2)
        talk.send(5, place)
        talk.rest(30)
        talk.say(rs30x.packet(5, 0x0F, 0x2A, 8, 0))
        talk.rest(0.3)
        words = (round(place * 2400 - 1200), 0, 0, 1081 if 8 <= k < 18 else 200)
        data = b"".join(word.to_bytes(2, "little", signed=True) for word in words)
        talk.say(rs30x.returned(5, 0x2A, data))
    assert "load-high" not in codes(talk.diagnosed())


def test_what_was_altered_is_shown_where_it_stands() -> None:
    told = polled("wck", of_servo_2)
    (damage,) = (f for f in found(told) if f.code == "damage-one-servo")
    assert [place.what for place in damage.places] == ["a value that one bit altered"] * 3
    assert "of them by a bit of what they measure" in damage.what
