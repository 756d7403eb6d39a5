"""Whose second answers torn places are: by how steadily they come behind a servo's requests."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest

from sniffer.diagnosis.evidence.followed import followed
from sniffer.diagnosis.evidence.owners import owner
from sniffer.diagnosis.evidence.signs import sign_of
from sniffer.diagnosis.physics.uart import both, heard, sent
from sniffer.ground.model import Chunk, Clock
from sniffer.simulation import Fault, simulate
from sniffer.simulation.render import usb_reads
from tests.conversations import MS, Conversation, robot, swinging, through_usb, without_clock
from tests.diagnosed import chunks_of, codes, diagnosed, verdicts
from tests.lists import each_in_turn, in_turn
from tests.streams import mightyzap

if TYPE_CHECKING:
    from sniffer.diagnosis.evidence.owners import Owner

SERVOS = (1, 2, 3, 4, 5)
LATE_MS = 4.0


def late_answers(protocol: str, whose: int) -> Conversation:
    """In every second cycle bytes lie over the answer of servo 3: two answers, ANDed.

    They end a steady time behind the request to ``whose``, 2 or 3: the controller waits between
    the two as long as it happens to.
    """
    rng = random.Random(5)
    asked_s = {}

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        place = swinging(servo, talk.now_s)
        talk.say(talk.tongue.ask(servo))
        asked_s[servo] = talk.now_s
        late = cycle % 2 and servo == 3
        if late:
            one, other = talk.tongue.answer(3, place), talk.tongue.answer(2, 0.3)
            talk.until(asked_s[whose] + (LATE_MS if whose == 2 else 0.5) / 1e3)
            talk.rest(rng.uniform(0, 0.02))
            talk.say(
                bytes(a & b for a, b in zip(one, other[1:] + other, strict=False)) + other[-1:]
            )
        else:
            talk.rest(0.3)
            talk.say(talk.tongue.answer(servo, place))
        talk.rest(rng.uniform(0.2, 1.2))
        return True

    return robot(protocol, 12, servos=SERVOS, instead=instead, goals=False)


def owner_of(talk: Conversation, *, by_usb: bool = False) -> Owner | None:
    chunks = through_usb(talk.chunks) if by_usb else talk.chunks
    (case,) = talk.diagnosed(chunks).cases()
    return owner(case)


@each_in_turn(2, "protocol", ["mightyzap", "rs30x"])
def test_torn_answers_that_end_a_steady_time_behind_another_servos_request_are_that_ones(
    protocol: str,
) -> None:
    told = late_answers(protocol, 2).diagnosed().incidents()
    assert verdicts(told) == [("duplicate-id", (2,))]


@each_in_turn(2, "protocol", ["mightyzap", "rs30x"])
def test_torn_answers_that_come_when_they_are_due_are_their_servos(protocol: str) -> None:
    talk = late_answers(protocol, 3)
    one = owner_of(talk)
    assert one is None or (one.servo_id, one.is_proof) == (3, False)
    assert "answers-twice" not in codes(talk.diagnosed())


def both_at_once(protocol: str) -> Conversation:
    """All answers of servo 2 are those of two servos, a part of a bit apart; no cycle is late."""
    rng = random.Random(5)

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        place = swinging(servo, talk.now_s)
        talk.say(talk.tongue.ask(servo))
        talk.rest(0.25 + rng.gauss(0, 0.006))
        answer = talk.tongue.answer(servo, place)
        if servo == 2:
            other = sent(talk.tongue.answer(servo, place + 0.001), begin=abs(rng.gauss(0.1, 0.5)))
            answer = heard(both(sent(answer), other, min))
            if cycle % 2:  # the first start bit of both is too long for one
                talk.rest(10 / 57.6)
                answer = answer[1:]
        talk.say(answer)
        talk.rest(0.2)
        return True

    return robot(protocol, 12, servos=(1, 2, 3), instead=instead, goals=False, baud=57600)


@each_in_turn(2, "protocol", ["mightyzap", "rs30x"])
def test_torn_answers_that_end_as_steadily_behind_their_own_request_are_not_the_servos_before(
    protocol: str,
) -> None:
    """The controller takes no time of its own between both requests, and first bytes hide."""
    one = owner_of(both_at_once(protocol))
    assert one is None or one.servo_id == 2


def test_two_servos_that_answer_twice_are_two() -> None:
    rng = random.Random(5)

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        talk.read(servo, 0.4)
        if servo in (2, 4):
            talk.say(talk.tongue.answer(servo, 0.5 + 0.01 * (cycle % 7)))
        talk.rest(rng.uniform(0.2, 1.2))
        return True

    told = robot("rs30x", 8, servos=SERVOS, instead=instead, goals=False).diagnosed().incidents()
    assert verdicts(told) == [("duplicate-id", (2, 4))]


def test_stamps_of_a_host_that_holds_bytes_tell_no_owner() -> None:
    assert owner_of(late_answers("mightyzap", 2)) is not None
    assert owner_of(late_answers("mightyzap", 2), by_usb=True) is None


def test_a_host_that_takes_bytes_when_it_has_time_is_no_clock_for_whose_they_are() -> None:
    # its stamps are good to a millisecond, on no grid: servo 0 seemed steadier than servo 1
    frames = list(simulate("wck", seed=3, faults=[Fault("duplicate", 1.0, 1)], duration_s=5.0))
    reads = [Chunk(data, t_ns, Clock.FILE) for t_ns, data in usb_reads(frames, 115200)]
    assert verdicts(diagnosed(reads, "wck").incidents()) == [("duplicate-id", (1,))]
    exact = diagnosed(chunks_of(frames), "wck")
    assert verdicts(exact.incidents()) == [("duplicate-id", (1,))]
    assert owner(next(iter(exact.cases()))) is not None


def by_the_millisecond(talk: Conversation, late_us: int = 0) -> list[Chunk]:
    """Return what is stamped once in a USB frame, up to ``late_us`` late."""
    rng = random.Random(3)
    stamps = [
        -(-(chunk.t_ns or 0) // MS) * MS + rng.randint(0, late_us * 1000) for chunk in talk.chunks
    ]
    return [Chunk(c.data, t, Clock.FILE) for c, t in zip(talk.chunks, stamps, strict=True)]


@in_turn(2)
@pytest.mark.parametrize("late_us", [0, 60])
@pytest.mark.parametrize("protocol", ["mightyzap", "rs30x"])
def test_torn_answers_stamped_by_the_millisecond_are_those_of_the_servo_that_was_asked(
    protocol: str, late_us: int
) -> None:
    rng = random.Random(5)

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        place = swinging(servo, talk.now_s)
        talk.say(talk.tongue.ask(servo))
        talk.rest(rng.uniform(0.3, 0.6))
        one, other = talk.tongue.answer(servo, place), talk.tongue.answer(servo, 0.9)
        both = bytes(a & b for a, b in zip(one, other[1:] + b"\xff", strict=True))
        talk.say(both if servo == 4 else one)
        talk.rest(rng.uniform(0.6, 0.7))
        return True

    talk = robot(protocol, 12, servos=SERVOS, instead=instead, goals=False)
    told = talk.diagnosed(by_the_millisecond(talk, late_us)).incidents()
    assert {i.servo_ids for i in told} <= {(4,)}


@each_in_turn(3, "protocol", ["mightyzap", "rs30x", "lss"])
def test_a_second_answer_that_names_its_servo_is_that_ones_however_stamps_lie(
    protocol: str,
) -> None:
    rng = random.Random(5)

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        talk.read(servo, 0.4)
        if servo == 2:
            talk.rest(rng.uniform(0, 0.9))
            talk.say(talk.tongue.answer(servo, 0.5 + 0.01 * (cycle % 7)))
            talk.rest(rng.uniform(0.2, 0.9))
        return True

    talk = robot(protocol, 8, servos=SERVOS, instead=instead, goals=False)
    for chunks in (talk.chunks, by_the_millisecond(talk)):
        assert verdicts(talk.diagnosed(chunks).incidents()) == [("duplicate-id", (2,))]


def test_answers_of_two_lengths_tell_nothing_that_requests_to_their_servo_do_not_say_too() -> None:
    """What they have in common is a header and an id: a torn request is no piece of an answer."""
    short, long = mightyzap.packet(2, 0), mightyzap.packet(2, 0, b"\x10\x02")
    common, peer = long[:4], mightyzap.packet(1, 0)
    assert short.startswith(common)
    asks = [mightyzap.packet(2, 0xF1), mightyzap.packet(2, 0xF2, b"\x8c\x02")]
    assert sign_of(common, [peer, *asks]) == b""
    assert sign_of(common, [peer]) == common
    assert sign_of(long, [peer, short, *asks]) == long[:6]


def behind(protocol: str, whose: int) -> Conversation:
    """A second answer of ``whose`` lies over what follows: its neighbour's answer, or a request.

    What a UART makes of two senders some bits apart has other bytes than either, and fewer.
    """
    rng = random.Random(7)

    def torn(said: bytes) -> bytes:
        left = rng.randrange(3)
        return said[:left] + rng.randbytes(len(said) - left - rng.randrange(2, 4))

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        place = swinging(servo, talk.now_s)
        is_next = servo == whose + 1
        ask = talk.tongue.ask(servo)
        if is_next and cycle % 2:
            talk.say(torn(ask))  # and nobody answers
            talk.rest(2)
            return True
        talk.say(ask)
        talk.rest(0.3)
        answer = talk.tongue.answer(servo, place)
        talk.say(torn(answer) if is_next else answer)
        talk.rest(rng.uniform(0.2, 1.2))
        return True

    return robot(protocol, 12, servos=SERVOS, instead=instead, goals=False)


@in_turn(3)
@pytest.mark.parametrize("protocol", ["mightyzap", "rs30x", "lss"])
@pytest.mark.parametrize("host", ["exact", "usb", "none"])
def test_all_that_is_torn_behind_one_servos_answers_is_its_second_ones_work(
    protocol: str, host: str
) -> None:
    """Requests and a neighbour's answers: no host need say when they came."""
    talk = behind(protocol, 2)
    chunks = {"exact": talk.chunks, "usb": through_usb(talk.chunks)}.get(host)
    told = talk.diagnosed(without_clock(talk.chunks) if chunks is None else chunks).incidents()
    assert verdicts(told)[:1] == [("duplicate-id", (2,))]


def test_frames_of_another_protocol_behind_one_servos_answers_are_no_second_answers() -> None:
    """They are longer than an answer, and more than one for each request."""

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        talk.read(servo, swinging(servo, talk.now_s))
        if servo == 2:
            for other in (20, 21, 22):
                talk.say(mightyzap.packet(other, 0xF2, b"\x8c\x08"))
                talk.rest(0.3)
                talk.say(mightyzap.packet(other, 0, bytes([cycle % 256, 8, 59, 2, 22, 0, 120, 28])))
                talk.rest(0.5)
        return True

    talk = robot("lss", 12, servos=SERVOS, instead=instead, goals=False)
    for chunks in (talk.chunks, through_usb(talk.chunks), without_clock(talk.chunks)):
        assert "answers-twice" not in codes(talk.diagnosed(chunks))


def test_a_short_word_of_another_protocol_behind_one_servos_answers_is_no_second_answer() -> None:
    """It begins as neither of the two that would collide there."""

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        talk.read(servo, swinging(servo, talk.now_s))
        if servo == 2:
            talk.say(b"#%dD%d\r" % (4 + cycle % 3, 10 * cycle))
            talk.rest(0.5)
        return True

    talk = robot("rs30x", 12, servos=SERVOS, instead=instead, goals=False)
    (case,) = talk.diagnosed().cases()
    assert followed(case) is None


def test_requests_hit_by_a_pulse_now_and_then_are_not_the_work_of_the_servo_before() -> None:
    """Those to one servo stand behind one and the same other's answers, in any fixed order."""
    rng = random.Random(8)

    def instead(talk: Conversation, _cycle: int, servo: int) -> bool:
        said = bytearray(talk.tongue.ask(servo))
        hit = servo == 2 and rng.random() < 0.15
        if hit:
            said[rng.randrange(5, len(said))] ^= 1 << rng.randrange(8)
        talk.say(bytes(said))
        talk.rest(0.3)
        if not hit:
            talk.say(talk.tongue.answer(servo, swinging(servo, talk.now_s)))
        talk.rest(0.5)
        return True

    told = robot("mightyzap", 8, instead=instead, goals=False).diagnosed()
    assert "answers-twice" not in codes(told)


def test_a_goal_that_begins_a_request_in_the_middle_is_no_second_answer() -> None:
    """A goal of 255 is FF, with which each request of wCK begins: it is one and a half of them."""
    talk, rng = Conversation("wck"), random.Random(3)
    for cycle in range(200):
        talk.rest(rng.uniform(1, 5))  # as long as the program happens to take
        for servo in (0, 1, 2):
            talk.rest(rng.uniform(0.1, 0.5))
            talk.read(servo, swinging(servo, talk.now_s))
        for servo in (1, 0, 2):
            goal = 255 if servo == 1 and cycle % 18 == 3 else 60 + cycle % 90
            talk.say(bytes((0xFF, 0x20 | servo, goal, ((0x20 | servo) ^ goal) & 0x7F)))
            talk.rest(rng.uniform(0.3, 0.5))
            talk.say(bytes((0x18, 60 + cycle % 90)))
            talk.rest(rng.uniform(0.3, 0.6))
    assert owner_of(talk) is None
