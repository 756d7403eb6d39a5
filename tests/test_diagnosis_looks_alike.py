"""What is sound and looks like a fault, and faults that look like others: what tells them apart."""

from __future__ import annotations

import random
from dataclasses import replace
from typing import Final

import pytest

from sniffer.diagnosis.physics.clocks import clock_of
from sniffer.diagnosis.physics.uart import heard as as_heard
from sniffer.diagnosis.physics.uart import sent
from sniffer.ground.model import Clock, Direction
from tests.conversations import Conversation, one_wire, robot, swinging
from tests.diagnosed import codes, found, verdicts
from tests.lists import each_in_turn
from tests.servos import BEGAN_NS, heard, suffering
from tests.streams import mightyzap, rs30x
from tests.test_diagnosis_findings import volts

STATE, LOAD_AT = 0x8C, 4
"""Where a mightyZAP tells position, speed and load, and where among these the load stands."""


# ------------------------------------------------------------------------------ sound conversations


def test_looking_for_servos_under_all_ids_again_and_again_is_no_fault() -> None:
    talk = Conversation("mightyzap")
    for _ in range(6):
        for servo in range(1, 40):
            if servo <= 3:
                talk.read(servo, 0.5)
            else:
                talk.ask_in_vain(servo, 8)
        for _ in range(60):
            talk.until(talk.now_s + 0.04)
            for servo in (1, 2, 3):
                talk.read(servo, 0.5)
    assert not talk.diagnosed().incidents()


def test_rests_of_any_length_before_each_move_are_the_programs_way() -> None:
    rng = random.Random(2)
    talk = Conversation("mightyzap")
    for _ in range(40):
        for servo in (1, 2, 3):
            place = rng.random()
            talk.send(servo, place)
            talk.rest(rng.choice((5, 30, 60)))
            talk.read(servo, place)
        talk.rest(rng.uniform(200, 800))
    assert not talk.diagnosed(
        replace(c, t_ns=(c.t_ns or 0) // 1000 * 1000) for c in talk.chunks
    ).incidents()


def loaded(every_s: float, load: int) -> list[tuple[float, bytes]]:
    """Return a mightyZAP that is looked at so often; it bears something from 4 s to 8 s."""
    out = []
    for k in range(round(14 / every_s)):
        t = k * every_s
        now = load if 4 <= t < 8 else 60
        out += mightyzap_state(t, [2000 + k % 3, 0, now])
    return out


def mightyzap_state(t: float, words: list[int]) -> list[tuple[float, bytes]]:
    data = b"".join(word.to_bytes(2, "little") for word in words)
    asked = mightyzap.packet(1, 0xF2, bytes((STATE, len(data))))
    return [(t, asked), (t + 0.004, mightyzap.packet(1, 0, data))]


def test_a_load_that_is_borne_for_seconds_is_an_overload() -> None:
    assert verdicts(heard(loaded(0.1, 900), "mightyzap").incidents()) == [("overload", (1,))]


def hastening(complains: range) -> list[tuple[float, bytes]]:
    """Return a mightyZAP that hastens behind its goals twice, and complains."""
    out = []
    for k in range(160):
        t = k * 0.05
        goal = 800 + 10 * k + (600 if k >= 60 else 0) + (600 if k >= 100 else 0)
        there = goal - 150 * max(3 - (k - 60) % 40, 0) * (k >= 60)
        code = 0x20 if k in complains else 0
        asked = mightyzap.packet(1, 0xF2, bytes((STATE, 2)))
        out.append((t, mightyzap.packet(1, 0xF3, b"\x86" + goal.to_bytes(2, "little"))))
        out.append((t + 0.004, asked))
        out.append((t + 0.008, mightyzap.packet(1, code, there.to_bytes(2, "little"))))
    return out


def test_an_overload_that_is_taken_back_at_once_while_its_joint_moves_on_is_none() -> None:
    passing = heard(hastening(range(60, 63)), "mightyzap")
    assert {"device-overload", "overload-passes"} <= codes(passing)
    assert not passing.incidents()
    assert not heard(hastening(range(60, 63)), "mightyzap", Clock.NONE).incidents()
    lasting = heard(hastening(range(60, 120)), "mightyzap")
    assert verdicts(lasting.incidents()) == [("overload", (1,))]


def test_two_that_bear_too_much_within_a_second_share_no_low_supply() -> None:
    told = suffering("mightyzap", "overload:1@2s overload:2@2.6s", 7.0)
    assert "complaints-together" in codes(told)
    assert {cause for cause, _ in verdicts(told.incidents())} == {"overload"}


def test_a_goal_that_is_there_for_a_moment_only_leaves_no_joint_stuck() -> None:
    def state(k: int) -> list[tuple[float, bytes]]:
        goal = 3600 if k in (60, 61) else 800 + 10 * k
        asked = mightyzap.packet(1, 0xF2, bytes((STATE, 2)))
        there = (780 + 10 * k).to_bytes(2, "little")
        return [
            (k * 0.025, mightyzap.packet(1, 0xF3, b"\x86" + goal.to_bytes(2, "little"))),
            (k * 0.025 + 0.004, asked),
            (k * 0.025 + 0.008, mightyzap.packet(1, 0x20 if k == 61 else 0, there)),
        ]

    d = heard([row for k in range(200) for row in state(k)], "mightyzap")
    assert verdicts(d.incidents()) == [("position-jump", (1,))]
    assert "stuck-before-alarm" not in codes(d)


def test_loads_at_single_looks_are_the_starts_of_moves() -> None:
    assert "load-high" not in codes(heard(loaded(0.7, 900), "mightyzap"))


def test_a_sixth_of_the_supply_under_load_is_no_breakdown() -> None:
    d = heard(volts(*[12.0] * 40, 10.1, 10.2, *[12.0] * 40), "mightyzap")
    assert not d.incidents()


def test_a_voltage_at_which_no_servo_speaks_was_misread() -> None:
    d = heard(volts(*[12.0] * 40, 1.8, *[12.0] * 40), "mightyzap")
    assert "voltage-sag" not in codes(d)


# ------------------------------------------------------------------------- faults that look alike


def test_an_answer_in_the_next_ones_place_is_late_and_no_second_one() -> None:
    """The controller asks the next servo before the answer is due; the next but one tears it."""
    talk = Conversation("rs30x")
    for cycle in range(120):
        talk.until(cycle / 25)
        hasty = cycle >= 30
        for servo in (1, 8):
            talk.say(talk.tongue.ask(servo))
            if not hasty:
                talk.rest(3)
                talk.say(talk.tongue.answer(servo, swinging(servo, talk.now_s)))
                talk.rest(0.5)
            elif servo == 1:
                talk.rest(2)
        if hasty:
            talk.rest(0.6)
            late = talk.tongue.answer(1, swinging(1, talk.now_s))
            talk.say(late[:-2] + bytes((late[-2] & 0x1E,)))
            talk.rest(1.5)
            talk.say(talk.tongue.answer(8, swinging(8, talk.now_s)))
    told = talk.diagnosed()
    assert "answers-after-next" in codes(told)
    assert "answers-twice" not in codes(told)
    assert verdicts(told.incidents()) == [("impatient-controller", ())]


def test_what_is_left_of_a_request_behind_a_bare_answer_is_the_missing_one() -> None:
    lost = 0

    def into(talk: Conversation, cycle: int, servo: int) -> bool:
        nonlocal lost
        if lost:
            lost -= 1
            return True
        if cycle < 100 or cycle % 3 or servo != 1:
            return False
        lost = 1
        request = talk.tongue.ask(2)
        talk.say(talk.tongue.ask(1))
        talk.rest(0.3)
        talk.say(talk.tongue.answer(1, 0.5) + request[-1:])
        return True

    told = robot("wck", 8, instead=into, goals=False).diagnosed()
    assert "request-swallowed" in codes(told)
    assert verdicts(told.incidents()) == [("impatient-controller", ())]


@pytest.mark.parametrize("lost", [b"", b"\xff\xff\xff"])
def test_a_request_without_its_first_byte_alone_was_not_lost_by_the_tap(lost: bytes) -> None:
    talk, rng, torn = robot("mightyzap", 10, goals=False), random.Random(3), []
    asks = {talk.tongue.ask(servo) for servo in (1, 2, 3)}
    for chunk in one_wire(talk):
        hit = chunk.data in asks and rng.random() < 0.05
        torn.append(replace(chunk, data=lost or chunk.data[1:]) if hit else chunk)
    assert "requests-torn-short" not in codes(talk.diagnosed(torn))


def test_each_byte_of_a_slow_clock_may_be_sampled_sooner_or_later() -> None:
    sound = tuple(b"*13QD%d\r" % n for n in (120, 131, 142))
    early, late = (as_heard(sent(sound[0], 1.06, rise=0.24), m) for m in (0.5, 0.56))
    mixed = bytes(b if k % 2 else a for k, (a, b) in enumerate(zip(early, late, strict=True)))
    assert mixed not in (early, late)
    found = clock_of(tuple((mixed, sound) for _ in range(4)))
    assert found is not None
    assert found.off > 0


def test_a_joint_that_was_not_looked_at_while_it_moved_does_follow() -> None:
    said = []
    for k in range(240):
        t = k / 20
        place = 1000 if t < 6 else 3000
        said.append((t, rs30x_goal(place)))
        if not 5.5 < t < 6.6:  # what was said then was torn
            said += rs30x_state(t + 0.01, place)
    assert not heard(said, "rs30x").incidents(), BEGAN_NS


def rs30x_goal(place: int) -> bytes:
    return rs30x.write(1, 0x1E, (place // 10).to_bytes(2, "little", signed=True))


def rs30x_state(t: float, place: int) -> list[tuple[float, bytes]]:
    """Return a look at position, time, speed and current of a servo."""
    words = (place // 10, 0, 0, 40)
    data = b"".join(word.to_bytes(2, "little", signed=True) for word in words)
    return [
        (t, rs30x.packet(1, 0x0F, 0x2A, len(data), 0)),
        (t + 0.003, rs30x.returned(1, 0x2A, data)),
    ]


@each_in_turn(3, "protocol", ["mightyzap", "lss", "wck"])
def test_a_line_that_is_held_low_for_most_of_the_time_is_neither_text_nor_another_rate(
    protocol: str,
) -> None:
    def holds(talk: Conversation, cycle: int) -> None:
        if cycle == 60:
            for _ in range(1000):
                talk.say(bytes(40))

    told = robot(protocol, 3, behind=holds).diagnosed()
    assert not codes(told) & {"nothing-holds", "bytes-translated"}
    assert [cause for cause, _ in verdicts(told.incidents())][:1] == ["line-stuck"]


# ------------------------------------------------------------------- who is away, and who is not

ELSE: Final = {
    "mightyzap": mightyzap.packet(2, 0xF2, bytes([0, 2])),
    "rs30x": rs30x.packet(2, 0x0F, 0x00, 2, 0),
}
"""A question that the control loop does not ask."""


@each_in_turn(2, "protocol", tuple(ELSE))
def test_who_leaves_one_question_unanswered_is_neither_away_nor_behind_a_bad_contact(
    protocol: str,
) -> None:
    def insists(talk: Conversation, cycle: int) -> None:
        for _ in range(10 if cycle % 40 == 20 else 0):
            talk.say(ELSE[protocol], Direction.TX)
            talk.rest(12)

    told = robot(protocol, 8, behind=insists).diagnosed()
    assert "one-question-unanswered" in codes(told)
    assert verdicts(told.incidents()) == [("retry-storm", (2,))]


def half_asked(talk: Conversation, cycle: int) -> None:
    """Ask servo 2 something else as often as where it is; answer, but for a second now and then."""
    if cycle % 80 < 60:
        talk.say(ELSE["mightyzap"], Direction.TX)
        talk.rest(0.3)
        talk.say(mightyzap.packet(2, 0, bytes(2)), Direction.RX)
        talk.rest(0.4)
    else:
        insist(talk, 10)


def insist(talk: Conversation, times: int, protocol: str = "mightyzap") -> None:
    for _ in range(times):
        talk.say(ELSE[protocol], Direction.TX)
        talk.rest(12)


def test_a_question_that_is_half_of_all_and_is_said_again_in_vain_chooses_itself() -> None:
    told = robot("mightyzap", 8, behind=half_asked).diagnosed()
    assert "one-question-unanswered" in codes(told)
    assert verdicts(told.incidents()) == [("retry-storm", (2,))]


def test_a_capture_that_ends_in_a_storm_of_retries_has_no_dead_servo() -> None:
    def insists(talk: Conversation, cycle: int) -> None:
        insist(talk, 10 if cycle % 40 == 39 else 0)

    told = robot("mightyzap", 8, behind=insists).diagnosed()
    assert "silent-since" not in codes(told)
    assert verdicts(told.incidents()) == [("retry-storm", (2,))]


@each_in_turn(2, "protocol", tuple(ELSE))
def test_a_question_that_is_left_unanswered_whenever_it_is_asked_is_refused(protocol: str) -> None:
    def asks(talk: Conversation, cycle: int) -> None:
        insist(talk, 2 if cycle % 60 == 20 else 0, protocol)

    told = robot(protocol, 8, behind=asks).diagnosed()
    assert verdicts(told.incidents()) == [("servo-refuses", (2,))]
    assert ELSE[protocol].hex(" ").upper() in told.incidents()[0].story


@each_in_turn(2, "protocol", tuple(ELSE))
def test_who_misses_what_it_is_asked_most_chooses_no_question(protocol: str) -> None:
    def away(talk: Conversation, cycle: int, servo: int) -> bool:
        for _ in range(10 if servo == 2 and cycle % 40 == 20 else 0):
            talk.ask_in_vain(2, 12)
        return False

    assert "one-question-unanswered" not in codes(robot(protocol, 8, instead=away).diagnosed())


def beside(times: int, *others: int) -> set[int | None]:
    """Return who is said to be away with others.

    Servo 2 was so many times, servo 3 and some others four times each, never two at once.
    """
    begins = {2: 60, 3: 80} | dict.fromkeys(others, 70)

    def away(talk: Conversation, cycle: int, servo: int) -> bool:
        count, since = divmod(cycle - begins.get(servo, 0), 60)
        often = times if servo == 2 else 4 if servo in begins else 0
        gone = since in range(3) and 0 <= count < often
        if gone:
            talk.ask_in_vain(servo)
        return gone

    told = found(robot("mightyzap", 8, servos=(1, 2, 3, 4), instead=away).diagnosed())
    return {f.servo_id for f in told if f.code == "others-away-too"}


def test_one_silence_beside_anothers_many_is_no_habit_that_they_share() -> None:
    assert beside(1) == set()
    assert beside(3) == {2, 3}


def test_one_silence_beside_those_of_two_others_is_of_the_same_place() -> None:
    assert beside(1, 4) == {2, 3, 4}


def test_torn_answers_are_not_requests_that_were_said_but_once() -> None:
    """Answers and questions of one length have their header, id and size in common."""
    hits = range(20, 200, 30)

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != 2:
            return False
        if cycle in (1, 2):  # once each: what it weighs, what it draws
            talk.say(mightyzap.packet(2, 0xF2, bytes((0x90 + 2 * cycle, 2))))
            talk.rest(0.3)
            talk.say(mightyzap.packet(2, 0, b"\x07\x00"))
            talk.rest(0.4)
        talk.say(talk.tongue.ask(2))
        talk.rest(0.3)
        said = talk.tongue.answer(2, swinging(2, talk.now_s))
        talk.say(said[:-1] + bytes((said[-1] ^ 1 << cycle % 8,)) if cycle in hits else said)
        talk.rest(0.4)
        return True

    told = robot("mightyzap", servos=(1, 2, 3, 4), instead=instead, goals=False).diagnosed()
    assert "bad-checksum" in codes(told)
    assert "request-in-answer" not in codes(told)
