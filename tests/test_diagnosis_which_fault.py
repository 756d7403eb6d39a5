"""Faults that look alike at first sight: what of the evidence only one of them leaves."""

from __future__ import annotations

import random
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from sniffer.diagnosis.physics.uart import heard as as_heard
from sniffer.diagnosis.physics.uart import sent
from sniffer.ground.model import Chunk, Clock
from tests.conversations import Conversation, robot, swinging
from tests.diagnosed import codes, verdicts
from tests.lists import each_in_turn, in_turn
from tests.streams import mightyzap, rs30x

if TYPE_CHECKING:
    from collections.abc import Callable

SERVOS = (1, 2, 3, 4)


def torn_answers(
    protocol: str, tear: Callable[[random.Random, bytes], bytes], *, share: float
) -> Conversation:
    """Return a robot of which a share of the answers is altered by ``tear``."""
    rng = random.Random(7)

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        talk.say(talk.tongue.ask(servo))
        talk.rest(rng.uniform(0.3, 0.5))
        answer = talk.tongue.answer(servo, swinging(servo, talk.now_s))
        talk.say(tear(rng, answer) if rng.random() < share else answer)
        talk.rest(rng.uniform(0.4, 1.0))
        return True

    return robot(protocol, 12, servos=SERVOS, instead=instead, goals=False)


# -------------------------------------------------------------------------- the turn, or the signal


def test_a_first_byte_that_is_misread_in_one_way_is_torn_at_the_turn_and_no_weak_signal() -> None:
    talk = torn_answers(
        "mightyzap",
        lambda rng, answer: bytes((rng.choice((0xFE, 0xFC, 0xF8)),)) + answer[1:],
        share=0.25,
    )
    told = talk.diagnosed()
    assert verdicts(told.incidents()) == [("turnaround", ())]
    assert not {"late-edges", "one-way-bits", "same-bit"} & codes(told)


def test_a_bit_that_falls_in_the_second_byte_and_others_is_a_weak_signal_and_no_turn() -> None:
    talk = torn_answers(
        "rs30x",
        lambda rng, answer: bytes(
            b & ~0x40 if b & 0x60 == 0x40 and rng.random() < 0.5 else b for b in answer
        ),
        share=0.3,
    )
    told = talk.diagnosed()
    assert verdicts(told.incidents()) == [("signal-integrity", ())]
    assert "first-byte-torn" not in codes(told)


def misread_talk(protocol: str, misread: Callable[[random.Random, bytes], bytes]) -> Conversation:
    """Return a robot of which one frame in twelve, of whomever, is misread."""
    rng = random.Random(9)
    talk = Conversation(protocol)
    for cycle in range(900):
        talk.until(cycle / 60)
        servo = SERVOS[cycle % 3]
        asked = talk.tongue.ask(servo) if cycle % 2 else talk.tongue.goal(servo, rng.random())
        is_torn = rng.random() < 1 / 12
        talk.say(misread(rng, asked) if is_torn else asked)
        if is_torn:
            talk.rest(10)
        if is_torn or not cycle % 2:
            continue
        talk.rest(rng.uniform(0.3, 0.5))
        answer = talk.tongue.answer(servo, rng.random())
        talk.say(misread(rng, answer) if rng.random() < 1 / 12 else answer)
    return talk


def turned(rng: random.Random, frame: bytes, bits: range, *, falls: bool) -> bytes:
    """Turn one bit of a frame, among some of a byte; ``falls``: one that is high."""
    places = [
        (k, b) for k in range(2, len(frame) - 1) for b in bits if frame[k] >> b & 1 or not falls
    ]
    k, bit = rng.choice(places or [(len(frame) - 1, bits[0])])
    return frame[:k] + bytes((frame[k] ^ 1 << bit,)) + frame[k + 1 :]


def test_high_bits_that_fall_in_the_second_half_of_bytes_of_all_are_a_weak_signal() -> None:
    talk = misread_talk("rs30x", lambda rng, f: turned(rng, f, range(4, 8), falls=True))
    told = talk.diagnosed()
    assert "late-bits" in codes(told)
    assert verdicts(told.incidents()) == [("signal-integrity", ())]


def test_bits_that_are_turned_anywhere_in_bytes_are_noise() -> None:
    talk = misread_talk("rs30x", lambda rng, f: turned(rng, f, range(8), falls=False))
    told = talk.diagnosed()
    assert "late-bits" not in codes(told)
    assert verdicts(told.incidents()) == [("bus-noise", ())]


def test_a_sign_that_stands_in_no_line_tells_the_bit_though_the_number_changes_with_each_line() -> (
    None
):
    """A zero that is read as a blank: behind a row of low bits the first high one is missed."""
    talk = misread_talk("lss", lambda rng, f: f.replace(b"0", b" ") if b"0" in f else f)
    told = talk.diagnosed()
    assert "same-bit" in codes(told)
    assert verdicts(told.incidents()) == [("signal-integrity", ())]


def test_signs_of_any_bit_that_stand_in_no_line_are_noise() -> None:
    told = misread_talk("lss", lambda rng, f: turned(rng, f, range(8), falls=False)).diagnosed()
    assert not {"same-bit", "late-bits", "one-way-bits"} & codes(told)


def test_first_bytes_among_much_of_which_nobody_knows_where_it_is_torn_are_no_turn() -> None:
    rng = random.Random(12)

    def garbled(frame: bytes) -> bytes:
        k = rng.randrange(2, len(frame) - 2)
        return frame[:k] + rng.randbytes(len(frame) - k + 2)

    talk = Conversation("rs30x")
    for cycle in range(900):
        talk.until(cycle / 60)
        servo = SERVOS[cycle % 3]
        if rng.random() < 0.06:
            talk.say(garbled(talk.tongue.ask(servo)))
            talk.rest(10)
            continue
        talk.say(talk.tongue.ask(servo))
        talk.rest(0.4)
        answer = talk.tongue.answer(servo, swinging(servo, talk.now_s))
        torn = rng.random()
        talk.say(answer[1:] if torn < 0.015 else garbled(answer) if torn < 0.07 else answer)
    told = talk.diagnosed()
    assert "first-byte-torn" in codes(told)
    assert "turnaround" not in [cause for cause, _ in verdicts(told.incidents())]


def bare_answers_in_a_log(*, late_by_a_byte: bool) -> set[str]:
    """Return what is found where one byte is left of bare answers, written down as a text log."""
    rng = random.Random(4)

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        talk.say(talk.tongue.ask(servo))
        talk.rest(rng.uniform(0.3, 0.31) + servo / 10)
        if rng.random() < 0.1:
            talk.rest(late_by_a_byte * 0.087)
            talk.say(bytes((rng.randrange(256),)))
            talk.rest(30)
        else:
            talk.say(talk.tongue.answer(servo, swinging(servo, talk.now_s)))
        talk.rest(rng.uniform(0.4, 1.0))
        return True

    talk = robot("wck", 12, servos=SERVOS, instead=instead, goals=False)
    return codes(talk.diagnosed(replace(c, clock=Clock.FILE) for c in talk.chunks))


def test_what_is_left_of_answers_in_a_log_lacks_its_first_byte_where_it_is_later_than_all() -> None:
    assert "first-byte-torn" in bare_answers_in_a_log(late_by_a_byte=True)


def test_what_is_left_of_answers_in_a_log_and_comes_in_time_lacks_another_byte() -> None:
    assert "first-byte-torn" not in bare_answers_in_a_log(late_by_a_byte=False)


def test_lines_that_lack_their_first_sign_were_cut_at_the_turn_and_not_by_the_tap() -> None:
    talk = Conversation("lss")
    rng = random.Random(3)
    for cycle in range(1200):
        talk.until(cycle / 60)
        servo = SERVOS[cycle % 3]
        short = cycle % 2
        talk.say(b"#%dQ\r" % servo if short else talk.tongue.ask(servo))
        talk.rest(rng.uniform(0.3, 0.5))
        place = swinging(servo, talk.now_s)
        answer = b"*%dQ6\r" % servo if short else talk.tongue.answer(servo, place)
        talk.say(answer[1:] if rng.random() < 0.2 else answer)
    told = talk.diagnosed()
    assert verdicts(told.incidents()) == [("turnaround", ())]
    assert "pieces-complete" not in codes(told)


def test_what_is_cut_behind_requests_only_was_not_lost_by_the_tap() -> None:
    """A driver that lets go late cuts answers, and the request behind one that nobody answers."""
    rng = random.Random(11)
    talk = Conversation("rs30x")
    for cycle in range(500):
        talk.until(cycle / 40)
        held = rng.random() < 0.2
        for servo in (1, 2):
            talk.say(talk.tongue.goal(servo, swinging(servo, talk.now_s)))
            talk.rest(0.2)
            cut = rng.randint(1, 4) if held and servo == 1 else 0
            talk.say(talk.tongue.ask(servo)[cut:])
            if cut:
                talk.rest(3)
                continue
            talk.rest(0.3)
            cut = rng.randint(1, 3) if rng.random() < 0.15 else 0
            talk.say(talk.tongue.answer(servo, swinging(servo, talk.now_s))[cut:])
            talk.rest(0.5)
    told = talk.diagnosed()
    assert [cause for cause, _ in verdicts(told.incidents())] == ["turnaround"]
    assert not {"pieces-complete", "requests-torn-short"} & codes(told)


# ----------------------------------------------------------------------------- restarts, or a cable


def test_servos_that_are_away_together_at_even_times_hang_on_one_contact() -> None:
    rng = random.Random(2)
    spells = [(3 + 3.7 * k, 3 + 3.7 * k + rng.uniform(0.2, 0.45)) for k in range(9)]

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        away = any(a <= talk.now_s < b for a, b in spells)
        if away and servo >= 3:
            talk.ask_in_vain(servo, 5)
        return away and servo >= 3

    talk = robot("wck", 38, servos=(0, 1, 2, 3, 4, 5, 6), rate_hz=15, instead=instead, goals=False)
    assert verdicts(talk.diagnosed().incidents()) == [("bad-cable", (3, 4, 5, 6))]


# ------------------------------------------------------------------------------- said, or by chance


@pytest.mark.parametrize("torn", [60, 0])
def test_an_alarm_of_one_answer_counts_little_where_many_frames_are_torn(torn: int) -> None:
    rng = random.Random(4)
    hits = set(rng.sample(range(20, 900), torn))

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        place = round(swinging(servo, talk.now_s) * 4095).to_bytes(2, "little")
        talk.say(talk.tongue.ask(servo))
        talk.rest(0.3)
        answer = mightyzap.packet(servo, 0x04 if (cycle, servo) == (150, 2) else 0, place)
        k = rng.randrange(len(answer))
        hit = cycle * 3 + servo in hits
        talk.say(answer[:k] + bytes((answer[k] ^ 0x5A * hit,)) + answer[k + 1 :])
        talk.rest(0.4)
        return True

    told = robot("mightyzap", 8, instead=instead, goals=False).diagnosed()
    causes = [cause for cause, _ in verdicts(told.incidents())]
    assert ("overheat" in causes) == (not torn)


# ------------------------------------------------------------------------------- holes, or noise


def long_answer(protocol: str, servo: int, s: float) -> bytes:
    """Return an answer that states all a servo measures: most of it varies, some never does."""
    place = round(swinging(servo, s) * 1000).to_bytes(2, "little")
    load = round(90 + 80 * swinging(servo, 1.7 * s)).to_bytes(2, "little")
    if protocol == "rs30x":
        return rs30x.returned(
            servo, 0x2A, place + b"\0\0" + load + place + b"\x1f\0\xd2\x02" + bytes(6)
        )
    return mightyzap.packet(servo, 0, place + b"\0\0\xff\x03" + place + load + load + b"\x78\x21")


@in_turn(2)
@pytest.mark.parametrize("protocol", ["mightyzap", "rs30x"])
@pytest.mark.parametrize("fault", ["tap-loss", "bus-noise"])
def test_what_few_holes_join_is_told_from_what_noise_alters(protocol: str, fault: str) -> None:
    """Holes of 4 to 24 bytes in the stream, or as many bytes altered."""
    rng = random.Random(6)
    talk = Conversation(protocol)
    for cycle in range(4000):
        talk.until(cycle / 200)
        servo = SERVOS[cycle % 4]
        if protocol == "rs30x":
            talk.say(rs30x.packet(servo, 0x0F, 0x2A, 18, 0))
        else:
            talk.say(mightyzap.packet(servo, 0xF2, b"\x86\x0e"))
        talk.rest(0.3)
        talk.say(long_answer(protocol, servo, talk.now_s))
    chunks, left = [], 0
    for chunk in talk.chunks:
        data, begin = bytearray(chunk.data), 0
        if fault == "bus-noise":
            if rng.random() < 0.0002 * len(data):
                data[rng.randrange(len(data))] ^= rng.randint(1, 255)
        elif not left and rng.random() < 0.0002 * len(data):
            left, begin = rng.randint(4, 24), rng.randrange(len(data))
        n = min(left, len(data) - begin)
        del data[begin : begin + n]
        left -= n
        chunks.append(Chunk(bytes(data), chunk.t_ns, chunk.clock))
    told = talk.diagnosed([chunk for chunk in chunks if chunk.data])
    assert verdicts(told.incidents()) == [(fault, ())]
    assert ("frames-spliced" in codes(told)) == (fault == "tap-loss")


def beside_a_clock_that_is_off(protocol: str, *, holes: bool) -> Conversation:
    """Servo 1 has a clock that is off; the tap loses bytes now and then, or as many are altered."""
    rng = random.Random(8)
    talk = Conversation(protocol)
    for cycle in range(2400):
        talk.until(cycle / 120)
        servo = SERVOS[cycle % 4]
        if protocol == "rs30x":
            talk.say(rs30x.packet(servo, 0x0F, 0x2A, 18, 0))
        else:
            talk.say(talk.tongue.ask(servo))
        talk.rest(0.8)
        if protocol == "rs30x":
            answer = long_answer(protocol, servo, talk.now_s)
        else:
            answer = talk.tongue.answer(servo, swinging(servo, talk.now_s))
        talk.say(as_heard(sent(answer, 1.062, rise=0.22)) if servo == 1 else answer)
    out, left = [], 0
    for chunk in talk.chunks:
        data = bytearray(chunk.data)
        if holes:
            if not left and rng.random() < 0.01:
                left, begin = rng.randint(20, 90), rng.randrange(len(data))
            else:
                begin = 0
            n = min(left, len(data) - begin)
            del data[begin : begin + n]
            left -= n
        elif rng.random() < 0.01:
            for k in range(rng.randrange(len(data))):
                data[k] ^= rng.randint(1, 255)
        out.append(Chunk(bytes(data), chunk.t_ns, chunk.clock))
    talk.chunks = [chunk for chunk in out if chunk.data]
    return talk


@each_in_turn(2, "protocol", ["lss", "rs30x"])
def test_holes_are_told_beside_a_clock_that_is_off(protocol: str) -> None:
    told = beside_a_clock_that_is_off(protocol, holes=True).diagnosed()
    assert set(verdicts(told.incidents())) == {("clock-drift", (1,)), ("tap-loss", ())}


@each_in_turn(2, "protocol", ["lss", "rs30x"])
def test_altered_beginnings_are_no_holes_beside_a_clock_that_is_off(protocol: str) -> None:
    told = beside_a_clock_that_is_off(protocol, holes=False).diagnosed()
    assert "pieces-complete" not in codes(told)
    assert "tap-loss" not in {cause for cause, _ in verdicts(told.incidents())}
