"""How a controller waits for answers, and how it asks again."""

from __future__ import annotations

import itertools
import random
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from sniffer.ground.model import Direction
from tests.conversations import (
    BAUD,
    MS,
    T0,
    TONGUES,
    Conversation,
    robot,
    swinging,
    through_usb,
    without_clock,
)
from tests.diagnosed import codes, found, verdicts
from tests.lists import each_in_turn, in_turn

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from sniffer.ground.model import Chunk

PROTOCOLS = tuple(TONGUES)


def one_in(n: int, cycle: int, servo: int) -> bool:
    return cycle % n == n // 2 and servo == 2


@each_in_turn(2, "protocol", ["mightyzap", "rs30x"])
def test_a_request_that_comes_before_the_answer_can_be_over_is_hasty(protocol: str) -> None:
    def hastily(talk: Conversation, cycle: int, servo: int) -> bool:
        if not one_in(9, cycle, servo):
            return False
        talk.say(talk.tongue.ask(2))
        talk.rest(0.2)  # an answer begins after 0.3 ms
        return True

    told = robot(protocol, 8, instead=hastily).diagnosed()
    assert "hasty-request" in codes(told)
    assert verdicts(told.incidents()) == [("impatient-controller", ())]


@each_in_turn(4, "protocol", PROTOCOLS)
def test_waiting_in_vain_as_long_as_usual_is_not_hasty(protocol: str) -> None:
    def in_vain(talk: Conversation, cycle: int, servo: int) -> bool:
        if not one_in(9, cycle, servo):
            return False
        talk.ask_in_vain(2, 30)
        return True

    told = codes(robot(protocol, 8, instead=in_vain).diagnosed())
    assert not told & {"hasty-request", "answers-after-next", "retry-storm"}


def collided(answer: bytes, request: bytes, at: int) -> bytes:
    """Return what is heard of a request that begins ``at`` bytes into an answer: lows win."""
    size = max(len(answer), at + len(request))
    one = answer + b"\xff" * (size - len(answer))
    other = b"\xff" * at + request + b"\xff" * (size - at - len(request))
    return bytes(a & b for a, b in zip(one, other, strict=True))


def impatient(protocol: str) -> Conversation:
    """Return a loop in which one request in thirty or so is said into the answer before it."""
    rng = random.Random(4)
    lost: set[tuple[int, int]] = set()

    def into(talk: Conversation, cycle: int, servo: int) -> bool:
        if (cycle, servo) in lost:
            talk.rest(25)  # what was said into the answer has none of its own
            return True
        if servo == 3 or rng.random() > 0.04:
            return False
        lost.add((cycle, servo + 1))
        talk.say(talk.tongue.ask(servo))
        talk.rest(0.3)
        answer = talk.tongue.answer(servo, swinging(servo, talk.now_s))
        talk.say(collided(answer, talk.tongue.ask(servo + 1), rng.randint(4, len(answer) - 1)))
        return True

    return robot(protocol, 12, instead=into, goals=False)


@each_in_turn(2, "protocol", ["mightyzap", "rs30x"])
def test_requests_that_run_into_answers_are_the_impatient_controllers(protocol: str) -> None:
    told = impatient(protocol).diagnosed()
    assert {"request-swallowed", "request-in-answer"} & codes(told)
    assert verdicts(told.incidents()) == [("impatient-controller", ())]


@in_turn(2)
@pytest.mark.parametrize("protocol", ["mightyzap", "rs30x"])
@pytest.mark.parametrize("host", [through_usb, without_clock])
def test_requests_said_into_answers_are_missing_behind_them_where_no_stamp_tells_it(
    host: Callable[[Iterable[Chunk]], list[Chunk]], protocol: str
) -> None:
    talk = impatient(protocol)
    told = talk.diagnosed(host(talk.chunks))
    assert "request-swallowed" in codes(told)
    assert verdicts(told.incidents()) == [("impatient-controller", ())]


@pytest.mark.parametrize("host", [through_usb, without_clock])
def test_answers_that_noise_tears_swallow_no_request(
    host: Callable[[Iterable[Chunk]], list[Chunk]],
) -> None:
    rng = random.Random(5)

    def torn(talk: Conversation, cycle: int, servo: int) -> bool:
        if rng.random() > 0.04:
            return False
        talk.say(talk.tongue.ask(servo))
        talk.rest(0.3)
        answer = bytearray(talk.tongue.answer(servo, 0.5))
        answer[rng.randrange(3, len(answer))] ^= 1 << rng.randrange(8)
        talk.say(bytes(answer))
        talk.rest(25)
        return True

    talk = robot("mightyzap", 12, instead=torn)
    for chunks in (talk.chunks, host(talk.chunks)):
        seen = codes(talk.diagnosed(chunks))
        assert not seen & {"request-swallowed", "request-in-answer", "hasty-request"}
    told = talk.diagnosed()
    assert "impatient-controller" not in [cause for cause, _ in verdicts(told.incidents())]


def test_a_controller_that_asks_all_at_once_by_plan_is_sound() -> None:
    talk = Conversation("mightyzap")
    for n in range(300):
        talk.until(n / 40)
        for servo in (1, 2, 3):
            talk.say(talk.tongue.ask(servo))
            talk.rest(0.1)
        for servo in (1, 2, 3):
            talk.rest(0.2)
            talk.say(talk.tongue.answer(servo, swinging(servo, talk.now_s)))
    assert not talk.diagnosed().incidents()


@each_in_turn(4, "protocol", PROTOCOLS)
def test_a_request_that_is_repeated_without_end_is_a_storm_of_retries(protocol: str) -> None:
    def stubborn(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != 2 or cycle % 100 != 50:
            return False
        for _ in range(40):
            talk.ask_in_vain(2, 12)
        return False

    assert verdicts(robot(protocol, 10, instead=stubborn).diagnosed().incidents()) == [
        ("retry-storm", (2,))
    ]


def test_two_retries_are_no_storm() -> None:
    def retried(talk: Conversation, cycle: int, servo: int) -> bool:
        if one_in(40, cycle, servo):
            for _ in range(2):
                talk.ask_in_vain(2, 12)
        return False

    assert "retry-storm" not in codes(robot("mightyzap", 10, instead=retried).diagnosed())


def test_a_controller_that_asks_one_servo_only_repeats_itself_without_a_storm() -> None:
    talk = Conversation("mightyzap")
    for n in range(400):
        if n < 200:
            talk.read(1, 0.5)
        else:
            talk.ask_in_vain(1, 20)
        talk.rest(10)
    assert "retry-storm" not in codes(talk.diagnosed())


@in_turn(4)
@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize("heard", ["both ways", "one way"])
def test_who_asks_a_joint_until_it_has_arrived_does_not_storm_when_answers_are_missing(
    protocol: str, heard: str
) -> None:
    talk = Conversation(protocol)
    for move in range(24):
        servo = 1 + move % 2
        place = 0.3 + (move % 5) / 10
        talk.send(servo, place)
        for look in range(14):
            if move % 6 == 3 and 4 <= look < 10:
                talk.ask_in_vain(servo, 30)
            else:
                talk.read(servo, place)
                talk.rest(30)
    one_way = [c for c in talk.chunks if c.direction == Direction.TX]
    told = codes(talk.diagnosed(one_way if heard == "one way" else None))
    assert "retry-storm" not in told


@each_in_turn(4, "protocol", PROTOCOLS)
def test_asking_a_servo_that_is_not_there_is_told_with_what_it_costs(protocol: str) -> None:
    talk = robot(protocol, 6, rate_hz=20, before=lambda talk, n: talk.ask_in_vain(9, 20))
    diagnosis = talk.diagnosed()
    assert verdicts(diagnosis.incidents()) == [("servo-absent", (9,))]
    (cost,) = [f for f in found(diagnosis) if f.code == "absent-costs"]
    assert 0.3 < cost.value("share") < 0.5


# ---------------------------------------------------------------------------------- what overlaps


def test_requests_that_overlap_answers_are_told_by_exact_stamps_only() -> None:
    talk = robot("mightyzap", 4)
    heard: list[Chunk] = []
    for k, chunk in enumerate(talk.chunks):
        early = k % 40 == 20 and len(chunk.data) == len(talk.tongue.ask(1))
        t_ns = (chunk.t_ns or 0) - MS * early
        heard.append(replace(chunk, t_ns=max(t_ns, heard[-1].t_ns or 0) if heard else t_ns))
    assert "request-over-answer" not in codes(talk.diagnosed(through_usb(heard)))


def test_a_conversation_of_the_tests_takes_the_time_of_its_bytes() -> None:
    talk = Conversation("mightyzap")
    talk.read(1, 0.5)
    assert talk.now_ns - T0 == 18 * (10**10 // BAUD) + 700_000


def test_a_program_that_waits_for_power_at_its_start_makes_no_storm() -> None:
    """It asks one servo, less and less often, and nothing else waits meanwhile."""
    talk = robot("mightyzap", 6, servos=(1, 2))
    waits = Conversation("mightyzap")
    for nth in range(11):
        waits.ask_in_vain(1, 50 * 1.3**nth)
    late_ns = waits.now_ns - T0
    said = [replace(c, t_ns=(c.t_ns or 0) + late_ns) for c in talk.chunks]
    assert not codes(talk.diagnosed([*waits.chunks, *said])) & {"retry-storm"}


@pytest.mark.parametrize("rest_ms", [450, 150])
def test_a_program_that_stands_about_as_long_as_it_goes_rests_by_plan(rest_ms: int) -> None:
    def rests(talk: Conversation, cycle: int) -> None:
        if cycle % 24 == 23:
            talk.rest(rest_ms)

    talk = Conversation("rs30x")
    for cycle in range(500):
        for servo in (1, 2, 3):
            talk.read(servo, swinging(servo, talk.now_s))
        talk.rest(20)
        rests(talk, cycle)
    assert ("loop-stalls" in codes(talk.diagnosed())) == (rest_ms == 150)


def late_over_the_next(protocol: str, *, torn_alone: bool = False) -> Conversation:
    """Return a loop of which each fifth answer is given up, and lies over the next one.

    Or of which as many answers get lost, and as many are torn, whatever was before.
    """
    rng = random.Random(6)
    late: list[bytes] = []

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        del cycle
        answer = talk.tongue.answer(servo, swinging(servo, talk.now_s))
        if servo != 4 and not late and rng.random() < 0.2:
            late.append(answer)
            talk.ask_in_vain(servo, 2)
            return True
        if (rng.random() < 0.13) if torn_alone else late:
            talk.say(talk.tongue.ask(servo))
            talk.rest(0.3)
            other = late.pop() if late else bytes(rng.randbytes(len(answer)))
            talk.say(bytes(a & b for a, b in itertools.zip_longest(other, answer, fillvalue=255)))
            talk.rest(0.4)
            return True
        late.clear()
        return False

    return robot(protocol, 8, servos=(1, 2, 3, 4), instead=instead, goals=False)


@in_turn(2)
@pytest.mark.parametrize("clock", [True, False])
@pytest.mark.parametrize("protocol", ["lss", "mightyzap", "rs30x"])
def test_late_answers_that_lie_over_the_next_ones_are_no_weak_signal(
    protocol: str, clock: bool
) -> None:
    talk = late_over_the_next(protocol)
    told = talk.diagnosed(talk.chunks if clock else without_clock(talk.chunks))
    assert verdicts(told.incidents())[0] == ("impatient-controller", ())
    assert "torn-behind-unanswered" in codes(told)


def test_answers_that_are_torn_wherever_they_stand_are_not_those_of_two() -> None:
    told = late_over_the_next("mightyzap", torn_alone=True).diagnosed()
    assert "torn-behind-unanswered" not in codes(told)
