"""Answers that come when the next servo is asked already: they are late, and no second ones."""

from __future__ import annotations

from sniffer.diagnosis.physics.uart import both, heard, sent
from sniffer.simulation.buses import simulate
from sniffer.simulation.faults import read_fault
from tests.conversations import Conversation, swinging
from tests.diagnosed import chunks_of, codes, diagnosed, found, verdicts
from tests.lists import each_in_turn

SERVOS = (1, 2, 3, 4)
CYCLES = 60
LATE = 2


def mixed(first: bytes, second: bytes, bits: float) -> bytes:
    """Return what is heard of two at once, of which the second begins so many bits later."""
    return heard(both(sent(first), sent(second, begin=bits), min))


def asked_in_turn(talk: Conversation, servo: int) -> bytes:
    """Ask a servo, wait for as long as one usually takes, and return what it says."""
    talk.say(talk.tongue.ask(servo))
    talk.rest(0.5)
    return talk.tongue.answer(servo, swinging(servo, talk.now_s))


def said_into(*, twin: bool) -> Conversation:
    """One servo answers as late as the next request; or in time, and so does its twin."""
    talk = Conversation("lss")
    for _ in range(CYCLES):
        for servo in SERVOS:
            if servo == LATE + 1 and not twin:
                continue  # its request is said into the answer before
            answer = asked_in_turn(talk, servo)
            if servo != LATE:
                talk.say(answer)
                talk.rest(0.2)
            elif twin:
                talk.say(mixed(answer, talk.tongue.answer(servo, 0.9), 13))
                talk.rest(4.4)
            else:
                talk.rest(4.9)
                talk.say(mixed(talk.tongue.ask(LATE + 1), answer, 13))
                talk.rest(5.3)
    return talk


def test_an_answer_into_which_the_next_request_is_said_each_time_is_no_second_one() -> None:
    told = said_into(twin=False).diagnosed()
    assert verdicts(told.incidents()) == [("impatient-controller", ())]
    (swallowed,) = (f for f in found(told) if f.code == "request-swallowed")
    assert "as long as for two requests" in swallowed.what


def test_a_controller_that_waits_as_long_as_ever_behind_two_answers_swallowed_no_request() -> None:
    told = said_into(twin=True).diagnosed()
    assert verdicts(told.incidents()) == [("duplicate-id", (LATE,))]
    assert "request-swallowed" not in codes(told)


def lain_over(*, absent: int, torn: int, first: bytes = b"") -> Conversation:
    """One servo never answers in time, and another one's answers are torn, but for the first."""
    talk = Conversation("lss")
    for cycle in range(CYCLES):
        for servo in SERVOS:
            if servo == absent:
                talk.ask_in_vain(servo, 5.4)
                continue
            answer = asked_in_turn(talk, servo)
            if servo == torn and (cycle or servo > absent):
                other = talk.tongue.answer(absent if first else torn, 0.9)
                talk.say(mixed(first + answer[len(first) :], other, 13))
                talk.rest(5.3)
            else:
                talk.say(answer)
                talk.rest(0.2)
    return talk


def test_an_answer_that_always_lies_over_the_next_servos_is_late_and_that_one_has_no_twin() -> None:
    """The very first answer of the next one is whole: nobody was asked before it."""
    told = lain_over(absent=4, torn=1, first=b"*").diagnosed()
    assert verdicts(told.incidents()) == [("impatient-controller", ())]
    (behind,) = (f for f in found(told) if f.code == "torn-behind-unanswered")
    assert behind.befell == (4,)


def test_a_servo_that_is_not_there_is_not_late_where_others_are_torn() -> None:
    told = lain_over(absent=3, torn=2).diagnosed()
    assert "torn-behind-unanswered" not in codes(told)
    assert set(verdicts(told.incidents())) == {("duplicate-id", (2,)), ("servo-absent", (3,))}


def test_two_answers_of_one_id_behind_a_servo_that_is_not_there_are_no_late_one() -> None:
    told = lain_over(absent=1, torn=2).diagnosed()
    assert set(verdicts(told.incidents())) == {("duplicate-id", (2,)), ("servo-absent", (1,))}


@each_in_turn(2, "protocol", ["mightyzap", "wck"])
def test_two_servos_that_answer_twice_now_and_then_are_twins_where_no_request_is_torn(
    protocol: str,
) -> None:
    faults = [read_fault(f"duplicate-id:{servo}:4%") for servo in (1, 2)]
    told = diagnosed(chunks_of(simulate(protocol, seed=5, faults=faults, duration_s=12)), protocol)
    assert {cause for cause, _ in verdicts(told.incidents())} == {"duplicate-id"}
