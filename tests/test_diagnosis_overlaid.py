"""Two requests at once: what is heard of them is known bit by bit, with and without times."""

from __future__ import annotations

import random

import pytest

from sniffer.diagnosis.physics.comparing import header_of
from sniffer.diagnosis.physics.overlaid import of_two
from sniffer.diagnosis.physics.uart import BITS, both, heard, received, sent
from sniffer.ground.model import Mark, MarkKind
from tests.conversations import TONGUES, Conversation, robot, swinging, without_clock
from tests.diagnosed import codes, verdicts
from tests.lists import in_turn

ASKS = {name: [tongue.ask(servo) for servo in (1, 2, 3)] for name, tongue in TONGUES.items()}


def at_once(first: bytes, second: bytes, bits: float) -> bytes:
    """Return what is heard where the second begins so many bits behind the first, by a UART."""
    return heard(both(sent(first), sent(second, begin=bits), min))


@pytest.mark.parametrize("protocol", list(TONGUES))
@pytest.mark.parametrize("bits", [12.6, 15.3])
def test_two_requests_that_lie_over_each_other_are_known(protocol: str, bits: float) -> None:
    first, second, _ = ASKS[protocol]
    got = at_once(first, second, BITS * header_of(ASKS[protocol]) + bits)
    assert got not in (first, second)
    assert of_two(got, ASKS[protocol])


@pytest.mark.parametrize("protocol", list(TONGUES))
def test_a_request_of_which_a_pulse_altered_a_byte_is_not_two(protocol: str) -> None:
    rng = random.Random(7)
    for request in ASKS[protocol]:
        for _ in range(40):
            got = bytearray(request)
            got[rng.randrange(2, len(got) - 1)] ^= 1 << rng.randrange(8)
            assert not of_two(bytes(got), ASKS[protocol])


@pytest.mark.parametrize("protocol", list(TONGUES))
def test_pieces_that_are_joined_as_they_were_sent_are_not_two(protocol: str) -> None:
    """A tap that lost bytes joins the beginning of one request to the end of another."""
    first, second, third = ASKS[protocol]
    for got in (first[:3] + second[-2:], second[:-1] + third[-2:], first[:2] + third[-1:]):
        assert not of_two(got, ASKS[protocol])


def asked_at_once(protocol: str) -> Conversation:
    """Return a loop into which somebody else asks now and then."""
    talk, rng = Conversation(protocol), random.Random(3)
    for k in range(600):
        if k % 40 == 5:
            first, second = rng.sample(ASKS[protocol], 2)
            talk.say(at_once(first, second, rng.uniform(20, 30)))
            talk.rest(12)
        talk.read(1 + k % 3, swinging(1 + k % 3, talk.now_s))
    return talk


@in_turn(2)
@pytest.mark.parametrize("clock", [True, False])
@pytest.mark.parametrize("protocol", ["wck", "lss"])
def test_who_else_asks_is_known_by_requests_at_once(protocol: str, clock: bool) -> None:
    talk = asked_at_once(protocol)
    told = talk.diagnosed(talk.chunks if clock else without_clock(talk.chunks))
    assert "requests-overlaid" in codes(told)
    assert verdicts(told.incidents()) == [("two-masters", ())]


@pytest.mark.parametrize("clock", [True, False])
def test_short_pulses_between_sound_frames_are_known_without_times(clock: bool) -> None:
    """Two who speak at once tear frames, and leave no byte alone between two that are sound."""
    talk = Conversation("rs30x")
    for k in range(300):
        if k % 31 == 4:
            talk.say(b"\xff" if k % 2 else b"\xfe")
            talk.rest(3)
        talk.read(1 + k % 3, swinging(1 + k % 3, talk.now_s))
    told = talk.diagnosed(talk.chunks if clock else without_clock(talk.chunks))
    assert "strays-alone" in codes(told)
    assert "strays-alone" not in codes(asked_at_once("wck").diagnosed())


def answered_at_once() -> Conversation:
    """Return a loop in which two servos of id 2 stand alike, and one answers some bits later."""
    talk, rng = Conversation("wck"), random.Random(3)
    for k in range(240):
        servo = 1 + k % 3
        if servo != 2:
            talk.read(servo, swinging(servo, talk.now_s))
            continue
        talk.say(talk.tongue.ask(servo))
        talk.rest(0.3)
        answer = bytes((2, 128))
        bits = received(both(sent(answer), sent(answer, begin=rng.uniform(0.2, 1.4)), min))
        marks = [Mark(MarkKind.FRAMING, n, 1) for n, b in enumerate(bits) if not b.stop]
        talk.say(bytes(b.value for b in bits), marks=tuple(marks))
        talk.rest(0.4)
    return talk


def test_two_at_rest_hold_each_others_stop_bits_low_as_no_clock_does() -> None:
    told = answered_at_once().diagnosed()
    assert "stop-bits-held-low" in codes(told)
    assert verdicts(told.incidents()) == [("duplicate-id", (2,))]


def test_what_two_answers_at_once_pull_low_is_no_weak_signal() -> None:
    """Where one is less than a bit behind, bits fall one way, as the ones before them."""
    rng = random.Random(3)

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        place = swinging(servo, talk.now_s)
        talk.say(talk.tongue.ask(servo))
        talk.rest(0.12)
        bits = sent(talk.tongue.answer(servo, place))
        if servo == 1:
            bits = both(bits, sent(talk.tongue.answer(1, 0.5), begin=rng.uniform(0, 1)), min)
        talk.say(heard(bits))
        talk.rest(0.2)
        return True

    talk = robot("rs30x", 8, servos=(1, 2, 3), instead=instead, goals=False)
    assert verdicts(talk.diagnosed().incidents()) == [("duplicate-id", (1,))]


def test_two_loops_of_which_hardly_a_request_is_whole_send_no_wrong_form() -> None:
    """Each request begins as it should, and the other one's ends it."""
    talk, rng = Conversation("rs30x"), random.Random(3)
    goals = [talk.tongue.goal(servo, servo / 8) for servo in (1, 2, 3, 4)]
    for k in range(500):
        first, second = rng.sample(goals + ASKS["rs30x"], 2)
        if k % 9:
            talk.say(at_once(first, second, rng.uniform(45, 75)))
            talk.rest(12)
        else:
            talk.read(1 + k % 3, swinging(1 + k % 3, talk.now_s))
    told = talk.diagnosed()
    assert {"begins-hold", "requests-overlaid"} <= codes(told)
    assert verdicts(told.incidents())[0] == ("two-masters", ())
    assert "malformed-command" not in {cause for cause, _ in verdicts(told.incidents())}
