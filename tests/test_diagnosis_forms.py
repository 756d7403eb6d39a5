"""In which form a controller asks: malformed, misused, or what only noise makes."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest

from tests.conversations import Conversation, robot, without_clock
from tests.diagnosed import codes, verdicts
from tests.lists import each_in_turn
from tests.streams import mightyzap, rs30x, wck


@pytest.mark.parametrize(
    ("protocol", "request_"),
    [
        ("mightyzap", mightyzap.packet(254, 0x73, b"\x86\x02\x01\x00\x08\x02\x00")),
        ("mightyzap", mightyzap.packet(2, 0xE7, b"\x01")),
        ("rs30x", rs30x.packet(0, 0, 0x1E, 1, 3, bytes([1, 2, 3]))),
        ("lss", b"#2XYZ5\r"),
    ],
)
def test_frames_in_a_form_that_no_manual_has_are_malformed(protocol: str, request_: bytes) -> None:
    def also(talk: Conversation, cycle: int) -> None:
        if cycle % 10 == 0:
            talk.write(request_)

    told = robot(protocol, 6, behind=also).diagnosed()
    assert "odd-commands" in codes(told)
    assert [cause for cause, _ in verdicts(told.incidents())] == ["malformed-command"]


@pytest.mark.parametrize(
    ("body", "cause"),
    [(b"\x8c", "malformed-command"), (b"\xd0\x02", "servo-refuses")],
    ids=["half-a-body", "whole"],
)
def test_a_question_that_no_servo_could_take_is_not_refused_beside_it(
    body: bytes, cause: str
) -> None:
    def also(talk: Conversation, cycle: int) -> None:
        if cycle % 16 == 7:
            talk.write(mightyzap.packet(2, 0xF2, body))
            talk.rest(12)

    told = robot("mightyzap", 12, behind=also).diagnosed()
    assert verdicts(told.incidents()) == [(cause, (2,))]


@pytest.mark.parametrize(
    ("protocol", "bytes_"),
    [("lss", b"#2D1 5\r"), ("rs30x", b"\xfa\xaf\x02\x00\x1e\x02\x01\x01\x02\x55")],
)
def test_the_same_bytes_that_are_no_frame_again_and_again_are_sent_so(
    protocol: str, bytes_: bytes
) -> None:
    def also(talk: Conversation, cycle: int) -> None:
        if cycle % 10 == 0:
            talk.write(bytes_)
            talk.rest(2)

    told = robot(protocol, 6, behind=also).diagnosed()
    assert "same-bytes-torn" in codes(told)
    assert [cause for cause, _ in verdicts(told.incidents())] == ["malformed-command"]


@each_in_turn(
    2,
    ("protocol", "every", "printed"),
    [
        # LSS_Query, LSS_Knob_Mimic of Lynxmotion's Arduino library print on the bus's port
        ("lss", 10, b"\r\n---- LSS telemetry ----\r\nPosition  (1/10 deg) = %d\r\n"),
        ("mightyzap", 5, b"Input @ %d\r\n"),
        ("rs30x", 60, b"rst:0x1 (POWERON_RESET),boot:0x13 (SPI_FAST_FLASH_BOOT) %d\r\n"),
        ("wck", 20, b"Input @ %d\r\n"),
        # a name of three letters and a number, as a sketch that is looked at prints them
        ("rs30x", 12, b"pos: %d\r\n"),
        ("mightyzap", 12, b"ID %d\n"),
    ],
)
def test_what_a_program_prints_on_the_bus_is_its_own_and_no_noise(
    protocol: str, every: int, printed: bytes
) -> None:
    def also(talk: Conversation, cycle: int) -> None:
        if cycle % every == 1:
            talk.write(printed % cycle)
            talk.rest(2)

    told = robot(protocol, 6, behind=also).diagnosed()
    assert "text-sent" in codes(told)
    assert [cause for cause, _ in verdicts(told.incidents())] == ["malformed-command"]


@each_in_turn(2, "has_clock", [True, False])
def test_requests_that_stop_anywhere_were_thrown_away_by_their_sender(has_clock: bool) -> None:
    """As RaspberryPi-DXL-MightyZap does: it empties its port (tcflush) when it has written."""
    rng = random.Random(4)

    def breaks_off(talk: Conversation, cycle: int, servo: int) -> bool:
        if rng.random() > 0.08:
            return False
        asked = rng.choice([talk.tongue.ask(servo), talk.tongue.goal(servo, rng.random())])
        talk.say(asked[: rng.randrange(1, len(asked))])
        talk.rest(40)
        return True

    talk = robot("mightyzap", 12, instead=breaks_off)
    told = talk.diagnosed(talk.chunks if has_clock else without_clock(talk.chunks))
    assert "requests-broken-off" in codes(told)
    assert verdicts(told.incidents())[0] == ("malformed-command", ())


def test_commands_of_four_bytes_can_lack_the_last_one_only() -> None:
    def cut(talk: Conversation, cycle: int, servo: int) -> bool:
        if (7 * cycle + servo) % 10:
            return False
        talk.say(talk.tongue.ask(servo)[:-1])
        talk.rest(20)
        return True

    told = robot("wck", 12, instead=cut).diagnosed()
    assert "requests-broken-off" in codes(told)
    assert verdicts(told.incidents()) == [("malformed-command", ())]


@pytest.mark.parametrize("every", [1, 20])
def test_a_question_to_all_servos_is_answered_by_all_at_once(every: int) -> None:
    """As on the community's pages of the LSS: "#254Q" brought "unreadable characters"."""
    rng = random.Random(5)

    def ask_all(talk: Conversation, cycle: int) -> None:
        if cycle % every == 0:
            talk.say(b"#254Q\r")
            talk.rest(0.3)
            talk.say(bytes(rng.choices(b"\0\2\x08\x20\x22\xc0\x40", k=7)))
            talk.rest(5)

    talk = robot("lss", 6, behind=ask_all, servos=(1, 2) if every > 1 else ())
    assert verdicts(talk.diagnosed().incidents()) == [("malformed-command", ())]


def test_noise_is_no_text_though_it_hits_letters() -> None:
    def also(talk: Conversation, cycle: int) -> None:
        if cycle % 4 == 1:
            talk.write(bytes(random.Random(cycle).choices(b"#*QD0123456789abcq\r\x80\xff", k=9)))
            talk.rest(2)

    assert "text-sent" not in codes(robot("lss", 6, behind=also).diagnosed())


def test_a_modifier_that_its_command_does_not_have_is_misused() -> None:
    talk = robot("lss", 5, behind=lambda talk, n: talk.write(b"#2WD90T500\r"))
    assert "modifier-misused" in codes(talk.diagnosed())
    sound = robot("lss", 5, behind=lambda talk, n: talk.write(b"#2P1500S750T20\r"))
    assert "modifier-misused" not in codes(sound.diagnosed())


def test_a_gain_read_that_sets_the_id_is_told() -> None:
    def mixed_up(talk: Conversation, cycle: int) -> None:
        if cycle == 50:
            talk.write(wck.command(7 << 5 | 2, 0x0C, b"\0\0"))
            talk.say(b"\0\0")
            talk.rest(1)

    def scan(talk: Conversation, cycle: int) -> None:
        if cycle == 50:
            talk.write(wck.command(7 << 5 | 2, 0x0C, b"\2\2"))
            talk.say(b"\2\2")
            talk.rest(1)

    assert "gain-read-sets-id" in codes(robot("wck", 4, behind=mixed_up).diagnosed())
    assert "gain-read-sets-id" not in codes(robot("wck", 4, behind=scan).diagnosed())


def test_a_form_that_noise_makes_by_chance_is_no_mistake_of_the_controller() -> None:
    talk = robot("lss", 10)
    rng = random.Random(8)
    heard = []
    for chunk in talk.chunks:
        if rng.random() < 0.02:
            torn = bytearray(chunk.data)
            torn[rng.randrange(1, len(torn) - 1)] ^= 1 << rng.randrange(5)
            chunk = replace(chunk, data=bytes(torn))
        heard.append(chunk)
    causes = [cause for cause, _ in verdicts(talk.diagnosed(heard).incidents())]
    assert "malformed-command" not in causes
