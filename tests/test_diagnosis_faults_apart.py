"""Two faults at once are two incidents: each with its own servo, and with what is its own."""

from __future__ import annotations

import random
from dataclasses import replace
from typing import TYPE_CHECKING

from sniffer.diagnosis.physics.uart import both, heard, sent
from sniffer.diagnosis.weighing import explain
from sniffer.ground.model import NS
from tests.conversations import Conversation, robot, swinging
from tests.diagnosed import codes, verdicts
from tests.test_diagnosis_two_at_once import altered, hit
from tests.test_diagnosis_weighing import told

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.diagnosis import Finding


def weighed(findings: Sequence[Finding]) -> list[tuple[str, tuple[int, ...]]]:
    """Return what explains findings, with the servos it is about."""
    return [(one.causes[0].cause, one.servo_ids) for one in explain(findings)]


def test_what_a_controller_does_wrong_with_one_servo_lets_no_other_joint_hang() -> None:
    limp = told("joint-limp", servo_id=13)
    assert set(weighed([told("writes-part", servo_id=7), limp])) == {
        ("partial-write", (7,)),
        ("torque-off", (13,)),
    }
    own = replace(limp, servo_id=7)
    assert weighed([told("writes-part", servo_id=7), own]) == [("partial-write", (7,))]


def test_a_servo_that_is_not_there_takes_no_answers_away_from_another_one() -> None:
    absent = [told("never-answered", servo_id=24), told("no-response", servo_id=24)]
    loses = [told(code, servo_id=5) for code in ("comes-and-goes", "no-response")]
    assert weighed([*absent, *loses]) == [("servo-absent", (24,)), ("bad-cable", (5,))]
    by_servo = {one.servo_ids: one.findings for one in explain([*absent, *loses])}
    assert {f.code for f in by_servo[5,]} == {"comes-and-goes", "no-response"}


def test_outages_at_even_times_that_leave_a_joint_limp_are_restarts() -> None:
    away = [told(c, servo_id=5) for c in ("comes-and-goes", "outages-evenly", "no-response")]
    assert weighed([*away, told("joint-limp-after-restart", servo_id=5)]) == [
        ("servo-reset-loop", (5,))
    ]


def test_a_device_that_speaks_unasked_is_told_beside_bytes_that_the_tap_lost() -> None:
    lost = [told(c) for c in ("answered-though-torn", "requests-torn-short", "pieces-complete")]
    said = [told(c, servo_id=37) for c in ("speaks-unasked", "unsolicited-response")]
    assert weighed([*lost, *said]) == [("tap-loss", ()), ("chatty-device", (37,))]


def test_what_was_there_before_the_tap_lost_bytes_is_no_side_effect_of_that() -> None:
    lost = [told("order-lacks-bytes"), told("truncated-frame", servo_id=2)]
    later = [replace(f, first_ns=f.first_ns + 8 * NS, last_ns=f.last_ns + 8 * NS) for f in lost]
    hangs = [told(c, servo_id=21) for c in ("joint-not-following", "torque-never-on")]
    assert weighed([*later, *hangs]) == [("tap-loss", ()), ("torque-off", (21,))]
    assert weighed([*lost, *hangs]) == [("tap-loss", ())]


def test_a_servo_that_misses_requests_and_never_breaks_off_may_have_its_clock_off() -> None:
    missed = ("comes-and-goes", "misses-now-and-then", "no-response", "torque-survives")
    losses = [told(c, servo_id=10) for c in (*missed, "away-unevenly", "outages-anytime")]
    (alone,) = explain(losses)
    (whole,) = explain([*losses, told("away-without-a-tear", 0.7, servo_id=10)])
    assert [c.cause for c in whole.causes][:2] == ["bad-cable", "clock-drift"]
    assert whole.causes[0].confidence < alone.causes[0].confidence - 0.02


def test_no_clock_chooses_the_question_that_a_servo_leaves_unanswered() -> None:
    missed = ("comes-and-goes", "misses-now-and-then", "no-response", "outages-anytime")
    losses = [told(c, servo_id=16) for c in (*missed, "away-without-a-tear")]
    (one,) = explain([*losses, told("one-question-unanswered", servo_id=16)])
    assert one.causes[0].cause == "servo-refuses"


def test_what_is_spoken_into_and_never_whole_meets_another_answer() -> None:
    torn = [told(c, servo_id=4) for c in ("answers-always-torn", "damage-one-servo")]
    (one,) = explain([*torn, told("answers-spoken-into")])
    assert one.causes[0].cause == "duplicate-id"
    assert one.causes[0].confidence > 0.9


def answers_lie_over_each_other(noise: float) -> Conversation:
    """Servo 2 and its twin answer a byte or so apart; of others some frames are hit by a pulse."""
    rng = random.Random(5)

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        place = swinging(servo, talk.now_s)
        if servo == 2:
            talk.say(talk.tongue.ask(2))
            talk.rest(0.12)
            second = sent(talk.tongue.answer(2, 0.5), begin=rng.uniform(0.5, 12))
            talk.say(heard(both(sent(talk.tongue.answer(2, place)), second, min)))
            talk.rest(0.3)
            return True
        if rng.random() >= noise:
            return False
        ask, answer = talk.tongue.ask(servo), talk.tongue.answer(servo, place)
        if rng.random() < 0.5:
            talk.say(hit(ask, rng))
            talk.rest(5)
            return True
        talk.say(ask)
        talk.rest(0.3)
        talk.say(hit(answer, rng))
        talk.rest(0.3)
        return True

    return robot("mightyzap", 10, servos=(1, 2, 3, 4), instead=instead, goals=False)


def test_first_bytes_that_a_second_answer_tears_turn_no_direction_too_late() -> None:
    d = answers_lie_over_each_other(0.03).diagnosed()
    assert "answers-mixed" in codes(d)
    assert "first-byte-torn" not in codes(d)
    causes = {(i.cause, i.servo_ids) for i in d.incidents()}
    assert ("duplicate-id", (2,)) in causes
    assert {cause for cause, _ in causes} <= {"duplicate-id", "bus-noise", "emi-load"}


def test_what_second_answers_tear_while_motors_work_is_no_interference() -> None:
    """Only while joints move is the next servo asked so soon that the second answer tears that."""

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != 2:
            return False
        is_moving = cycle // 60 % 2 == 0
        talk.read(2, path(2, talk.now_s))
        talk.say(talk.tongue.answer(2, path(2, talk.now_s) + 0.1))
        talk.rest(0.4)
        if is_moving:
            talk.say(altered(talk.tongue.ask(3)))
        return True

    def path(servo: int, s: float) -> float:
        return swinging(servo, s if int(s * 40) // 60 % 2 == 0 else int(s * 40) // 60 * 1.5)

    d = robot("rs30x", 24, servos=(1, 2, 3, 4), path=path, instead=instead).diagnosed()
    assert "damage-while-moving" not in codes(d)
    assert verdicts(d.incidents()) == [("duplicate-id", (2,))]


def test_a_line_that_tears_most_frames_of_all_has_no_controller_that_does_not_wait() -> None:
    """Requests are missing behind torn answers as they are behind sound ones; nothing is spared."""
    rng = random.Random(11)

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        ask, answer = talk.tongue.ask(servo), talk.tongue.answer(servo, swinging(servo, talk.now_s))
        is_heard = rng.random() < 0.45
        talk.say(ask if is_heard else hit(ask, rng))
        talk.rest(0.3 if is_heard else 4)
        if is_heard:
            talk.say(answer if rng.random() < 0.15 else hit(answer, rng))
            talk.rest(0.3)
        return True

    d = robot("mightyzap", 12, servos=range(1, 9), rate_hz=20, instead=instead, goals=False)
    told = d.diagnosed().incidents()
    assert "impatient-controller" not in {i.cause for i in told}
    assert told[0].cause == "bus-noise"


def lone(*, misses: float, tears: float) -> Conversation:
    """One servo is asked and nobody else: it misses requests, or these are torn on the line."""
    rng = random.Random(2)

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        ask, answer = talk.tongue.ask(servo), talk.tongue.answer(servo, swinging(servo, talk.now_s))
        is_torn, is_missed = rng.random() < tears, rng.random() < misses
        talk.say(hit(ask, rng) if is_torn else ask)
        talk.rest(4 if is_torn or is_missed else 0.3)
        if not is_torn and not is_missed:
            talk.say(hit(answer, rng) if rng.random() < misses / 4 + tears else answer)
            talk.rest(0.3)
        return True

    return robot("mightyzap", 40, servos=(2,), rate_hz=40, instead=instead, goals=False)


def test_of_a_servo_alone_on_its_bus_missing_answers_to_whole_requests_are_its_own() -> None:
    (first, *_) = lone(misses=0.03, tears=0).diagnosed().incidents()
    assert (first.cause, first.servo_ids) == ("bad-cable", (2,))
    assert "comes-and-goes" not in codes(lone(misses=0, tears=0.03).diagnosed())
