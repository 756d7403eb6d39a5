"""What torn frames are taken for, and are not: a line that falls, limits that a servo was given."""

from __future__ import annotations

import itertools
import random
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from sniffer.diagnosis.ledger.damage import IN_REQUEST, Damage
from sniffer.diagnosis.rules.line.crossings import is_two
from tests.conversations import Conversation, robot, through_usb, without_clock
from tests.crossing_rounds import two_rounds
from tests.diagnosed import codes, found, verdicts
from tests.lists import each_in_turn
from tests.streams import mightyzap, rs30x, wck

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from sniffer.diagnosis import Diagnosis

STATE = (0x2A, 18)
"""Position, time, speed, current, temperature and voltage, and six zeros behind them."""


def hit(rng: random.Random, data: bytes, share: float) -> bytes:
    """Return bytes of which a share has lost or gained a bit."""
    return bytes(b ^ (1 << rng.randrange(8)) if rng.random() < share else b for b in data)


def polled(torn_while_moving: float) -> Conversation:
    """Twelve servos, goals and states; they move every second second, and sparks tear then."""
    talk, rng = Conversation("rs30x"), random.Random(11)
    for cycle in range(240):
        talk.until(cycle / 30)
        moves = int(talk.now_s) % 2
        share = torn_while_moving if moves else 0.0
        for servo in range(1, 13):
            place = (cycle % 30) * 20 if moves else 0
            talk.say(hit(rng, rs30x.write(servo, 0x1E, place.to_bytes(2, "little")), share))
            talk.rest(0.2)
            request = rs30x.packet(servo, 0x09, 0, 0, 1)
            asked = hit(rng, request, share)
            talk.say(asked)
            current = (300 if moves else 20).to_bytes(2, "little")
            state = place.to_bytes(2, "little") + bytes([0, 0, 40 * moves, 0]) + current
            state += bytes([30, 0, 0xDC, 2]) + bytes(6)
            if asked == request:
                talk.rest(0.3)
                talk.say(hit(rng, rs30x.returned(servo, STATE[0], state), share))
            talk.rest(0.4)
    return talk


def test_the_zeros_of_torn_states_are_no_falls_of_a_line() -> None:
    told = polled(0.03).diagnosed()
    assert "line-babbles" not in codes(told)
    assert verdicts(told.incidents())[0] == ("emi-load", ())


def spoken_into(begins: bytes, late_ms: float = 0.0) -> Conversation:
    """Three joints; what begins so, and is garbled, stands in place of each 15th answer."""
    garbled = bytes.fromhex("04 00 04 24 30 39 04 A6 65 D5")

    def torn(talk: Conversation, cycle: int, servo: int) -> bool:
        if (cycle + 4 * servo) % 15:
            return False
        talk.say(talk.tongue.ask(servo))
        talk.rest(0.3 + late_ms)
        talk.say(begins.replace(b"1", b"%d" % servo) + garbled[: 8 + cycle % 3])
        talk.rest(0.4)
        return True

    return robot("lss", 6, instead=torn)


def test_answers_that_begin_as_they_should_or_as_requests_do_are_not_torn_in_front() -> None:
    # of two senders start bits get lost: by its bytes it begins later than it did
    for talk in (spoken_into(b"*1QD", 0.1), spoken_into(b"*1", 0.1), spoken_into(b"#1D", 0.1)):
        assert "first-byte-torn" not in codes(talk.diagnosed())
    assert "first-byte-torn" in codes(spoken_into(b"1QD", 0.1).diagnosed())


def limited(*, torn: int, writes: int = 0, deg: int = 20, beyond: int = 0) -> Diagnosis:
    """Return what is found where a servo is told its limits so many times, beside torn requests.

    Where it is never told them they are read. ``beyond``: in how many cycles a goal is at 120
    degrees; all others are within 96.
    """
    talk, rng = Conversation("rs30x"), random.Random(5)
    limits = b"".join((sign * deg * 10).to_bytes(2, "little", signed=True) for sign in (1, -1))
    for cycle in range(200):
        talk.until(cycle / 20)
        for servo in (1, 2):
            talk.send(servo, 0.5 + 0.3 * (cycle % 40) / 40)
            talk.read(servo, 0.5 + 0.3 * (cycle % 40) / 40)
        if cycle % 10 == 5 and cycle < 10 * torn:
            request = bytearray(talk.tongue.ask(2))
            request[rng.randrange(2, 7)] ^= 0x24
            talk.write(bytes(request))
            talk.rest(20)
        if cycle % 10 == 7 and cycle < 10 * writes:
            talk.write(rs30x.write(1, 0x08, limits))
        if not writes and not cycle:
            talk.write(rs30x.packet(1, 0x0F, 0x08, 4, 0))
            talk.say(rs30x.returned(1, 0x08, limits))
        if cycle % 20 == 9 and cycle < 20 * beyond:
            talk.write(rs30x.write(1, 0x1E, (1200).to_bytes(2, "little")))
    return talk.diagnosed()


def test_limits_that_one_frame_writes_among_torn_ones_may_be_torn_themselves() -> None:
    assert "goal-beyond-limits" not in codes(limited(torn=8, writes=1))


def test_goals_beyond_limits_are_counted_and_not_those_beside_them() -> None:
    (told,) = [
        f for f in found(limited(torn=0, deg=110, beyond=4)) if f.code == "goal-beyond-limits"
    ]
    assert told.count == 4


def test_limits_count_where_nothing_is_torn() -> None:
    assert "goal-beyond-limits" in codes(limited(torn=0, writes=1))


def test_one_goal_beyond_the_limits_among_torn_frames_may_be_torn_itself() -> None:
    assert "goal-beyond-limits" not in codes(limited(torn=8, deg=110, beyond=1))
    assert "goal-beyond-limits" in codes(limited(torn=8, deg=110, beyond=4))
    assert "goal-beyond-limits" in codes(limited(torn=0, deg=110, beyond=1))


def test_a_burst_over_two_requests_and_the_answer_between_are_not_two_that_run_together() -> None:
    """What begins as one request and ends as another is longer than both: nobody spoke at once."""
    rng = random.Random(8)
    talk = Conversation("rs30x")
    for cycle in range(300):
        talk.until(cycle / 40)
        said = [talk.tongue.ask(1), talk.tongue.answer(1, 0.4), talk.tongue.ask(2)]
        if cycle % 12 == 6:  # from within the first one to within the last
            row = b"".join(said)
            talk.say(row[:5] + rng.randbytes(len(row) - 8) + row[-3:])
        else:
            for data in said:
                talk.say(data)
                talk.rest(0.3)
            talk.say(talk.tongue.answer(2, 0.6))
        talk.read(3, 0.5)
    assert "requests-run-together" not in codes(talk.diagnosed())


def turned(rng: random.Random, frame: bytes) -> bytes:
    """Turn one bit of a frame."""
    k = rng.randrange(len(frame))
    return frame[:k] + bytes((frame[k] ^ 1 << rng.randrange(8),)) + frame[k + 1 :]


@each_in_turn(2, "times", [1, 4])
def test_requests_that_seem_to_run_together_once_are_no_second_controller(times: int) -> None:
    rng = random.Random(4)
    talk = Conversation("rs30x")
    for cycle in range(400):
        talk.until(cycle / 40)
        for servo in (1, 2, 3):
            asked = talk.tongue.ask(servo)
            if cycle % 80 == 40 and cycle // 80 < times and servo == 1:
                talk.say(asked[:5] + talk.tongue.ask(2)[3:])
            elif rng.random() < 0.04:
                talk.say(turned(rng, asked))
            else:
                talk.say(asked)
                talk.rest(0.3)
                answer = talk.tongue.answer(servo, 0.4)
                talk.say(turned(rng, answer) if rng.random() < 0.04 else answer)
            talk.rest(2)
    causes = [cause for cause, _ in verdicts(talk.diagnosed().incidents())]
    assert ("two-masters" in causes) == (times > 1)


def test_a_torn_request_that_its_check_lets_pass_is_no_question_that_is_refused() -> None:
    """WCK's sums have seven bits: a read (5 << 5 and the id) without its eighth bit is a move."""
    talk, torn = Conversation("wck"), wck.command(1 << 5 | 15, 0)
    for cycle in range(400):
        talk.until(cycle / 40)
        for servo in (3, 15):
            talk.read(servo, 0.5)
        if cycle in (120, 300):
            talk.write(torn)
            talk.rest(6)
        elif cycle % 4 == 3:
            talk.write(wck.command(5 << 5 | 3, 0)[:-1] + b"\x5a")
            talk.rest(6)
    told = talk.diagnosed()
    assert "one-question-unanswered" not in codes(told)
    assert "servo-refuses" not in {cause for cause, _ in verdicts(told.incidents())}


def test_who_is_asked_three_things_in_one_go_mostly_loses_the_first_and_refuses_none() -> None:
    """Whatever opens a contact does so between the cycles, for most of the time is there."""
    rng = random.Random(2)
    talk, closed_s, open_s = Conversation("rs30x"), 0.0, 0.5
    for cycle in range(120):
        talk.until(cycle / 10)
        for servo, question in itertools.product((1, 2, 3), (0x2A, 0x30, 0x34)):
            if talk.now_s > open_s:
                closed_s = open_s + rng.uniform(0.01, 0.1)
                open_s = closed_s + rng.uniform(0.3, 0.8)
            talk.say(rs30x.packet(servo, 0x0F, question, 2, 0))
            if servo == 2 and talk.now_s < closed_s:
                talk.rest(6)
                continue
            talk.rest(0.3)
            talk.say(rs30x.returned(servo, question, bytes([40, 0])))
            talk.rest(0.3)
    told = talk.diagnosed()
    assert "one-question-unanswered" not in codes(told)
    assert "servo-refuses" not in {cause for cause, _ in verdicts(told.incidents())}


@pytest.mark.parametrize("away", [0.8, 0.4])
def test_one_servo_alone_that_is_away_evenly_restarts_however_long_it_is_away(away: float) -> None:
    talk = Conversation("mightyzap")
    while talk.now_s < 16:
        talk.rest(12)
        if talk.now_s % 1.0 < away:
            talk.ask_in_vain(2, 8)
        else:
            talk.read(2, 0.5)
    told = talk.diagnosed()
    assert "away-again-and-again" in codes(told)
    assert verdicts(told.incidents()) == [("servo-reset-loop", (2,))]


def lines(tear: Callable[[random.Random, bytes], bytes]) -> set[str]:
    """Return what is found where one of forty lines of an LSS bus is torn so."""
    rng, talk = random.Random(9), robot("lss", 6, servos=(1, 2, 3, 4), rate_hz=25)
    torn = [replace(c, data=tear(rng, c.data)) if rng.random() < 0.025 else c for c in talk.chunks]
    return codes(talk.diagnosed(torn))


def without_some(rng: random.Random, line: bytes) -> bytes:
    """Lose one to three signs within a line, or its last ones."""
    at = rng.randrange(2, len(line))
    return line[:at] + line[at + rng.randint(1, 3) :]


def test_torn_lines_of_both_sides_in_which_every_sign_is_sound_lost_what_they_lack() -> None:
    assert "pieces-complete" in lines(without_some)


def test_torn_lines_with_signs_that_no_line_has_were_altered() -> None:
    def flip(rng: random.Random, line: bytes) -> bytes:
        at = rng.randrange(len(line))
        return line[:at] + bytes([line[at] ^ 1 << rng.randrange(8)]) + line[at + 1 :]

    assert "pieces-complete" not in lines(flip)


def test_lines_of_one_side_that_lack_their_first_signs_are_no_loss_of_the_tap() -> None:
    def cut(rng: random.Random, line: bytes) -> bytes:
        return line[rng.randint(1, 2) :] if line.startswith(b"*") else line

    assert "pieces-complete" not in lines(cut)


def with_falls(row: int, rows: int) -> Conversation:
    """Let the idle line fall behind each exchange for two seconds of every four."""
    rng = random.Random(4)

    def behind(talk: Conversation, cycle: int) -> None:
        del cycle
        if talk.now_s % 4 < 2:
            for _ in range(rows):
                talk.rest(0.5)
                talk.say(bytes(0xFF << rng.randrange(4) & 0xFF for _ in range(row)))
            talk.rest(0.5)

    return robot("lss", 14, rate_hz=20, behind=behind)


def test_a_line_that_falls_for_seconds_and_is_well_between_is_stuck_though_frames_get_by() -> None:
    talk = with_falls(20, 2)
    for chunks in (talk.chunks, through_usb(talk.chunks), without_clock(talk.chunks)):
        told = talk.diagnosed(chunks)
        assert "line-babbles" in codes(told)
        assert [i.cause for i in told.incidents()] == ["line-stuck"]


def test_a_byte_now_and_then_between_frames_is_no_line_that_falls_all_the_time() -> None:
    assert "line-babbles" not in codes(with_falls(1, 20).diagnosed())


def test_frames_of_another_make_are_no_line_that_falls_though_they_come_for_seconds() -> None:
    """A third of a mightyZAP packet is FF and 00, as a line that falls is."""

    def behind(talk: Conversation, cycle: int) -> None:
        del cycle
        if talk.now_s % 4 < 2:
            for servo in range(1, 9):
                talk.rest(0.5)
                talk.say(mightyzap.packet(servo, 0xF3, b"\x86\x00\x0f"))
            talk.rest(0.5)

    assert "line-babbles" not in codes(robot("rs30x", 14, rate_hz=20, behind=behind).diagnosed())


def asked_in_turn(talk: Conversation) -> Iterator[tuple[int, int, bytes]]:
    """Ask three servos in turn; yield the cycle, the servo, and what it is to answer now."""
    for cycle in range(500):
        talk.until(cycle / 40)
        for servo in (1, 2, 3):
            talk.say(talk.tongue.ask(servo))
            talk.rest(0.3)
            yield cycle, servo, talk.tongue.answer(servo, 0.4)


def held_within_answers(wait_ms: float) -> set[str]:
    """A line falls low within answers and stays so; servo 1 answers garbled, and who asks waits."""
    rng = random.Random(3)
    talk = Conversation("rs30x")
    for cycle, servo, answer in asked_in_turn(talk):
        if servo == 3 and cycle in (60, 130, 190):
            talk.say(answer[: rng.randint(4, 8)] + b"\0")
            talk.rest(400)
        elif servo == 1 and cycle > 250 and rng.random() < 0.5:
            talk.say(turned(rng, answer[:-1] + b"\0"))
            talk.rest(wait_ms)
        else:
            talk.say(answer)
            talk.rest(2)
    return codes(talk.diagnosed())


def test_a_silence_longer_than_anybody_waits_for_an_answer_is_the_lines() -> None:
    assert "held-low" in held_within_answers(4)


def test_a_silence_as_long_as_the_controller_waits_for_answers_is_the_controllers() -> None:
    assert "held-low" not in held_within_answers(400)


def test_two_of_many_torn_places_that_end_low_are_no_line_that_is_held() -> None:
    rng = random.Random(5)
    talk = Conversation("rs30x")
    for cycle, servo, answer in asked_in_turn(talk):
        if servo == 3 and cycle in (130, 190):
            talk.say(answer[:6] + b"\0")
            talk.rest(400)
        elif rng.random() < 0.1:
            talk.say(turned(rng, answer))
            talk.rest(4)
        else:
            talk.say(answer)
            talk.rest(2)
    assert "held-low" not in codes(talk.diagnosed())


def test_two_torn_lines_in_a_row_are_not_two_requests_at_once() -> None:
    def at_once(got: bytes, *firsts: bytes) -> bool:
        place = Damage(0, len(got), 0, 0, IN_REQUEST, 1, got, b"", ())
        return is_two(place, firsts, (b"#3D120\r",), 1)

    assert at_once(b"#1D12#3D120\r", b"#1D1205\r")
    assert not at_once(b"#1D{70\r#2D\xff120\r", b"#1D5\r", b"#1D-1205T900\r")


def test_rounds_cross_little_where_far_more_is_torn_than_they_cross() -> None:
    talk = two_rounds(31, 43, apart_ms=0)
    torn = [replace(c, data=c.data + c.data[:-1]) for c in talk.chunks]
    crossing = [f for f in found(talk.diagnosed(torn)) if f.code == "rounds-cross"]
    assert [f.strength < 0.5 for f in crossing] == [True]
