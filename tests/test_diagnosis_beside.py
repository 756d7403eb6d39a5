"""Faults beside others, faults that spare no frame, and what tells them apart then."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest

from tests.conversations import Conversation, robot, swinging, through_usb, without_clock
from tests.diagnosed import codes, found, verdicts
from tests.lists import each_in_turn
from tests.streams import mightyzap

if TYPE_CHECKING:
    from collections.abc import Callable

    from sniffer.diagnosis import Diagnosis
    from sniffer.ground.model import Chunk


def turned(data: bytes, bits: range, *, lags: bool | None = None, behind: int = 3) -> bytes:
    """Return a frame with one high bit read as low: the first that may be; else it is whole.

    ``lags``: whether the bit before it on the line is low.
    """
    for k in range(behind, len(data)):
        for bit in bits:
            before = bool(bit and data[k] >> (bit - 1) & 1)
            if data[k] >> bit & 1 and (lags is None or lags is not before):
                return data[:k] + bytes((data[k] ^ 1 << bit,)) + data[k + 1 :]
    return data


def torn_read(talk: Conversation, servo: int, tear: Callable[[bytes], bytes]) -> None:
    """Ask a servo and hear a torn answer."""
    talk.say(talk.tongue.ask(servo))
    talk.rest(0.3)
    talk.say(tear(talk.tongue.answer(servo, swinging(servo, talk.now_s))))
    talk.rest(0.4)


# ------------------------------------------------------------------------------ one beside another


def test_a_servo_that_alone_loses_answers_for_a_while_is_seen_beside_what_all_suffered_before() -> (
    None
):
    rng, away = random.Random(4), 0

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        nonlocal away
        if cycle < 240:
            if rng.random() < 0.05:
                torn_read(talk, servo, lambda data: data[:-2] + bytes((data[-2] ^ 8, data[-1])))
                return True
            return False
        if servo != 3:
            return False
        if not away and rng.random() < 0.3:
            away = rng.choice((1, 1, 2, 5))
        away = max(away - 1, 0)
        if away:
            talk.ask_in_vain(servo, 3)
        return away > 0

    told = robot("mightyzap", 16, servos=(1, 2, 3, 4), rate_hz=30, instead=instead, goals=False)
    lost = [f for f in found(told.diagnosed()) if f.code == "comes-and-goes"]
    assert [f.servo_id for f in lost] == [3]
    assert "no other servo lost one" in lost[0].what
    assert ("bad-cable", (3,)) in verdicts(told.diagnosed().incidents())


def test_answers_that_are_all_torn_for_a_while_hide_no_contact_of_another_servo() -> None:
    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo == 1 and 40 <= cycle < 120:
            torn_read(talk, servo, lambda data: turned(data, range(8)))
            return True
        if servo == 3 and cycle % 23 == 7 and cycle > 130:
            talk.ask_in_vain(servo, 3)
            return True
        return False

    told = robot("mightyzap", 12, servos=(1, 2, 3, 4), instead=instead, goals=False).diagnosed()
    assert [f.servo_id for f in found(told) if f.code == "comes-and-goes"] == [3]


# ----------------------------------------------------------------------------- never a whole answer


def test_requests_into_answers_none_of_which_is_ever_whole_are_the_impatient_controllers() -> None:
    talk = Conversation("rs30x")
    ask, answer = talk.tongue.ask, talk.tongue.answer
    for cycle in range(150):
        talk.until(cycle / 25)
        late = answer(1, swinging(1, talk.now_s))
        talk.say(ask(1))
        talk.rest(2)
        if cycle % 3:  # the answer begins within the last byte of the next request
            talk.say(ask(8)[:-1] + bytes((ask(8)[-1] & late[0],)) + late[1:])
        else:
            talk.say(ask(8))
            talk.say(late[1:])
    assert verdicts(talk.diagnosed().incidents())[0] == ("impatient-controller", ())


def test_an_id_that_is_asked_in_vain_all_along_is_absent_without_a_clock_too() -> None:
    talk = robot("wck", 3, behind=lambda talk, cycle: talk.ask_in_vain(9, 2), goals=False)
    told = talk.diagnosed(without_clock(talk.chunks))
    assert verdicts(told.incidents()) == [("servo-absent", (9,))]


def test_first_bytes_of_bare_answers_that_are_swallowed_are_no_noise() -> None:
    rng = random.Random(7)

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if rng.random() > 0.08:
            return False
        torn_read(talk, servo, lambda data: data[1:])
        return True

    talk = robot("wck", 12, servos=(1, 2, 3, 4), instead=instead, goals=False)
    (first, *_) = talk.diagnosed(through_usb(talk.chunks)).incidents()
    assert first.cause == "turnaround"


# ----------------------------------------------------------------------------------- unasked or not


def test_what_begins_as_an_answer_and_is_torn_by_a_request_was_said_unasked() -> None:
    def behind(talk: Conversation, cycle: int) -> None:
        said = talk.tongue.answer(2, swinging(2, talk.now_s))
        if cycle % 40 == 11:
            talk.rest(2)
            talk.say(said)
        elif cycle % 40 == 31:
            talk.rest(2)
            talk.say(said[:8] + talk.tongue.ask(1)[3:])

    told = robot("rs30x", 10, behind=behind, goals=False).diagnosed()
    unasked = [f for f in found(told) if f.code == "speaks-unasked"]
    assert [f.servo_id for f in unasked] == [2]
    assert "began before a request was over" in unasked[0].what


def test_a_torn_request_that_begins_as_answers_of_its_servo_do_is_no_answer_unasked() -> None:
    """Answers of two lengths have their header and id in common, and so have requests."""
    rng = random.Random(8)
    hits = set(rng.sample(range(900), 40))

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        short = cycle % 2
        asked = mightyzap.packet(servo, 0xF1) if short else talk.tongue.ask(servo)
        hit = 3 * cycle + servo in hits and servo == 2
        said = bytearray(asked)
        if hit:
            said[rng.randrange(5, len(said))] ^= 1 << rng.randrange(8)
        talk.say(bytes(said))
        talk.rest(0.3)
        if not hit or cycle % 5 == 0:  # some the servo had whole
            answer = talk.tongue.answer(servo, swinging(servo, talk.now_s))
            talk.say(mightyzap.packet(servo, 0) if short else answer)
        talk.rest(0.5)
        return True

    told = robot("mightyzap", 8, instead=instead, goals=False).diagnosed()
    assert "speaks-unasked" not in codes(told)


@pytest.mark.parametrize("protocol", ["mightyzap", "rs30x", "lss"])
def test_a_device_that_nobody_ever_asks_speaks_unasked(protocol: str) -> None:
    def behind(talk: Conversation, cycle: int) -> None:
        if cycle % 30 == 11:
            talk.rest(3)
            talk.say(talk.tongue.answer(9, 0.4))

    told = robot(protocol, 10, behind=behind, goals=False).diagnosed()
    assert verdicts(told.incidents()) == [("chatty-device", (9,))]


@pytest.mark.parametrize("each", [1, 12])
def test_a_stranger_that_is_heard_where_another_ones_answer_is_due_speaks_unasked(
    each: int,
) -> None:
    """Who waits long for a servo that is away hears then most of what anybody says unasked.

    Who is heard each time answers: another id was given to the servo that is asked.
    """

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != 2:
            return False
        talk.say(talk.tongue.ask(servo))
        talk.rest(3)
        if cycle % each == each // 2:
            talk.say(talk.tongue.answer(9, 0.4))
        talk.rest(12)
        return True

    def alone(talk: Conversation, cycle: int) -> None:
        if cycle in (100, 150):
            talk.rest(3)
            talk.say(talk.tongue.answer(9, 0.4))

    told = robot("mightyzap", 10, rate_hz=20, instead=instead, behind=alone, goals=False)
    causes = {cause for cause, _ in verdicts(told.diagnosed().incidents())}
    assert ("chatty-device" in causes) == (each > 1)


def _acks(
    of: Callable[[int], bool], *, late: bool = False
) -> Callable[[Conversation, int, int], bool]:
    """Let servo 2 say in some cycles what a mightyZAP answers a write with, at once or late."""

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo == 2 and of(cycle) and not late:
            talk.say(mightyzap.packet(2, 0))
            talk.rest(0.4)
        elif servo == 3 and of(cycle) and late:
            talk.read(3, swinging(3, talk.now_s))
            talk.rest(12)
            talk.say(mightyzap.packet(2, 0))
            return True
        return False

    return instead


@pytest.mark.parametrize("host", [list, through_usb, without_clock])
def test_what_looks_like_the_answer_to_a_write_that_is_not_answered_else_was_said_unasked(
    host: Callable[[list[Chunk]], list[Chunk]],
) -> None:
    """It was a slow servo's late answer, or none at all: it is paired with a write."""
    talk = robot("mightyzap", 10, instead=_acks(lambda cycle: cycle % 25 == 11, late=True))
    told = talk.diagnosed(host(talk.chunks))
    assert verdicts(told.incidents()) == [("chatty-device", (2,))]


@pytest.mark.parametrize(("since", "late"), [(0, False), (350, False), (350, True)])
def test_a_servo_that_answers_each_write_from_some_time_on_was_told_to(
    since: int, *, late: bool
) -> None:
    assert "speaks-unasked" not in codes(
        robot("mightyzap", 10, instead=_acks(lambda cycle: cycle >= since, late=late)).diagnosed()
    )


def test_a_device_whose_requests_are_on_a_wire_that_is_not_heard_is_no_chatty_one() -> None:
    talk = Conversation("mightyzap")
    for cycle in range(200):
        talk.until(cycle / 40)
        talk.ask_in_vain(1, 2)
        talk.say(talk.tongue.answer(9, swinging(9, talk.now_s)))
    assert "speaks-unasked" not in codes(talk.diagnosed())


def test_who_answers_a_request_that_the_tap_has_torn_does_not_speak_unasked() -> None:
    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != 2 or cycle % 12 != 5:
            return False
        asked = talk.tongue.ask(servo)
        talk.say(asked[:-1] + bytes((asked[-1] ^ 0xC0,)))
        talk.rest(0.3)
        talk.say(talk.tongue.answer(servo, swinging(servo, talk.now_s)))
        return True

    told = robot("mightyzap", 8, instead=instead, goals=False).diagnosed()
    assert "unsolicited-response" in codes(told)
    assert "speaks-unasked" not in codes(told)


# ---------------------------------------------------------------------------------- which bits fall


def hit(torn: Callable[[int, bytes], bytes], *servos: int) -> set[str]:
    """Return what is found where every fifth answer of some servos is torn."""
    return codes(struck(torn, *servos))


def struck(torn: Callable[[int, bytes], bytes], *servos: int) -> Diagnosis:
    """Return the diagnosis of that."""
    count = 0

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        nonlocal count
        if servo not in servos or cycle % 5 != servo:
            return False
        count += 1
        torn_read(talk, servo, lambda data: torn(count, data))
        return True

    return robot("mightyzap", 8, instead=instead, goals=False).diagnosed()


@each_in_turn(3, "every", [1, 2, 6])
def test_edges_that_come_late_count_as_far_as_they_are_what_tears(every: int) -> None:
    def torn(n: int, data: bytes) -> bytes:
        return data[:6] if n % every else turned(data, range(1, 8), lags=True, behind=6)

    [late] = [f for f in found(struck(torn, 1, 2, 3)) if f.code == "late-edges"]
    assert (late.strength == 1.0) == (every < 3)


def test_bits_of_which_half_are_as_the_one_before_are_no_late_edges() -> None:
    def torn(n: int, data: bytes) -> bytes:
        return turned(data, range(1, 8), lags=n % 2 != 0, behind=6)

    assert "late-edges" not in hit(torn, 1, 2, 3)


def test_bits_of_the_second_half_of_bytes_of_one_servo_alone_are_its_clocks() -> None:
    def torn(n: int, data: bytes) -> bytes:
        return turned(data, range(4, 8) if n % 3 else range(4, 5), behind=6)

    assert "last-bits" in hit(torn, 1)
    assert "last-bits" not in hit(torn, 1, 2, 3)
