"""Who does not wait for answers, and who only looks so: two controllers, lines that are misread."""

from __future__ import annotations

import random

import pytest

from sniffer.diagnosis.acting import SURE
from sniffer.diagnosis.physics.uart import both, heard, sent
from tests.conversations import TONGUES, Conversation, robot, swinging
from tests.diagnosed import codes, found, verdicts
from tests.lists import each_in_turn
from tests.streams import mightyzap

SERVOS = (1, 2, 3, 4)


def late_for_everybody(*, second: bool) -> Conversation:
    """Answers come too late for a controller that gives up after 2.5 ms, or that is disturbed."""
    rng = random.Random(9)
    talk = Conversation("lss")
    for cycle in range(2400):
        servo, after = SERVOS[cycle % 4], SERVOS[(cycle + 1) % 4]
        place = swinging(servo, talk.now_s)
        talk.say(talk.tongue.ask(servo))
        asked, answer = talk.now_s, talk.tongue.answer(servo, place)
        if rng.random() < 0.1:
            talk.until(asked + (rng.uniform(0.2, 9) if second else 2.5) / 1e3)
            talk.say(talk.tongue.ask(after))
            talk.rest(0.3)
            theirs = talk.tongue.answer(after, swinging(after, talk.now_s))
            k = rng.randint(1, 4)
            both = theirs[:k] + bytes(a & b for a, b in zip(answer, theirs[k:], strict=False))
            if rng.random() < 0.6:
                talk.say(both)
                talk.rest(2.5)
            else:
                talk.say(answer)
                talk.rest(0.2)
                talk.say(theirs)
                talk.rest(0.3)
        else:
            talk.rest(rng.uniform(0.3, 0.8))
            talk.say(answer)
            talk.rest(rng.uniform(0.2, 0.4))
    return talk


def test_a_controller_that_gives_up_after_one_time_that_answers_exceed_is_impatient() -> None:
    told = late_for_everybody(second=False).diagnosed()
    assert verdicts(told.incidents())[0] == ("impatient-controller", ())
    gives_up = [f.what for f in found(told) if f.code == "gives-up-early"]
    assert len(gives_up) == 1
    assert "2.5 ms" in gives_up[0]


def unparted(servo: int) -> Conversation:
    """The sign that ends an answer of a servo is misread, and one of the request behind it."""
    talk = Conversation("lss")
    is_torn = False
    for cycle in range(1200):
        asked = SERVOS[cycle % 4]
        request, answer = talk.tongue.ask(asked), talk.tongue.answer(asked, 0.4)
        talk.say(request[:1] + b"%" + request[2:] if is_torn else request)
        talk.rest(0.5)
        if not is_torn:
            is_torn = asked == servo and cycle % 9 == 0
            talk.say(answer[:-1] + b"\xc3" if is_torn else answer)
            talk.rest(0.15)
        else:
            is_torn = False
    return talk


def test_lines_that_lost_the_end_that_parts_them_did_not_run_into_each_other() -> None:
    told = unparted(SERVOS[1]).diagnosed()
    assert "damage-one-servo" in codes(told)
    assert "request-in-answer" not in codes(told)


def test_answers_with_an_altered_id_are_no_late_ones_of_whoever_that_is() -> None:
    rng = random.Random(4)
    talk = Conversation("lss")
    for cycle in range(3000):
        servo = SERVOS[cycle % 4]
        talk.say(talk.tongue.ask(servo))
        if rng.random() < 0.15:  # it heard another request
            talk.rest(30)
            continue
        talk.rest(0.5)
        says = rng.choice(SERVOS) if rng.random() < 0.4 else servo
        talk.say(talk.tongue.answer(says, 0.4))
        talk.rest(0.4 if says == servo else 29)
    told = talk.diagnosed()
    assert "late-response" in codes(told)
    assert "gives-up-early" not in codes(told)


def test_requests_that_come_after_any_time_show_no_timeout() -> None:
    assert "gives-up-early" not in codes(late_for_everybody(second=True).diagnosed())


@pytest.mark.parametrize("protocol", TONGUES)
def test_where_nobody_answers_no_rate_is_sure_and_the_supply_is_looked_at(protocol: str) -> None:
    """Servos without power, or of another port, are as silent as those at another rate."""

    def in_vain(talk: Conversation, cycle: int, servo: int) -> bool:
        talk.ask_in_vain(servo, 25)
        talk.ask_in_vain(servo, 25)
        return True

    (incident,) = (
        robot(protocol, 8, instead=in_vain, rate_hz=6, goals=False).diagnosed().incidents()
    )
    assert incident.causes[0].confidence < SURE
    assert "easure the supply at a servo" in incident.next


@each_in_turn(2, "bits", [22.4, 24.4])
def test_requests_that_always_run_into_answers_are_known_by_those_to_other_servos(
    bits: float,
) -> None:
    """A timeout shorter than any answer: every second request is never heard whole."""
    talk = Conversation("mightyzap")
    talk.read(1, 0.5)
    for _ in range(60):
        for servo, after in ((1, 2), (3, 4)):
            talk.say(mightyzap.packet(servo, 0xF1))
            talk.rest(2.6)
            answer = sent(mightyzap.packet(servo, 0))
            talk.say(heard(both(answer, sent(talk.tongue.ask(after), begin=bits), min)))
            talk.rest(20)
    told = talk.diagnosed()
    assert "request-in-answer" in codes(told)
    assert not {cause for cause, _ in verdicts(told.incidents())} & {"turnaround", "duplicate-id"}
