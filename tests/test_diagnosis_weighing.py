"""What is weighed from findings that are given: ways in which damage comes, and how much."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from sniffer.diagnosis.model import Finding
from sniffer.diagnosis.rules.line.motors import strength_of
from sniffer.diagnosis.weighing import explain
from sniffer.diagnosis.weights import WEIGHTS
from sniffer.ground.model import NS
from tests.conversations import T0, Conversation, robot, swinging, through_usb, without_clock
from tests.diagnosed import codes, found

if TYPE_CHECKING:
    from collections.abc import Callable

    from sniffer.ground.model import Chunk

MANNERS = (
    "damage-while-moving",
    "damage-behind-steps",
    "soonest-lost",
    "first-byte-torn",
    "last-byte-torn",
    "same-bit",
    "late-edges",
    "late-bits",
)


def told(code: str, strength: float = 1.0, servo_id: int | None = None) -> Finding:
    return Finding(code, servo_id, T0, T0 + 10**10, 20, code, strength=strength)


@pytest.mark.parametrize("manner", MANNERS)
def test_a_way_in_which_damage_comes_is_no_fault_beside_the_one_that_has_the_damage(
    manner: str,
) -> None:
    assert not explain([told(manner)])


@pytest.mark.parametrize("manner", MANNERS)
def test_damage_that_comes_in_a_way_is_told_by_it(manner: str) -> None:
    (one,) = explain([told(manner), told("bad-checksum"), told("damaged-response")])
    assert len(one.findings) == 3


def test_a_way_in_which_one_servos_answers_are_torn_is_not_of_what_befell_another() -> None:
    torn = [told("first-byte-torn", servo_id=6), told("strays-anywhere", servo_id=None)]
    assert not explain([*torn, told("damaged-frame", servo_id=1)])
    assert explain([*torn, told("damaged-frame", servo_id=6)])


def test_a_cause_that_is_a_manner_of_something_else_is_no_rival_either() -> None:
    more = [told("goes-on-unanswered", 0.7), told("duplicate-response", 0.3, servo_id=2)]
    (explained,) = explain([told("first-byte-torn"), *more])
    causes = [c.cause for c in explained.causes]
    assert "turnaround" not in causes
    assert all(f.code in WEIGHTS[causes[0]] for f in explained.findings)


def apart(code: str, servo_id: int, first_s: float, last_s: float = 100) -> Finding:
    begin, end = T0 + round(first_s * NS), T0 + round(last_s * NS)
    return Finding(code, servo_id, begin, end, 20, code)


def test_a_battery_that_empties_is_low_for_one_servo_after_the_other_and_one_fault() -> None:
    (one,) = explain([apart("voltage-sag", servo, 10 * servo) for servo in (1, 2, 3)])
    assert one.servo_ids == (1, 2, 3)
    later = [apart("voltage-sag", 1, 10, 20), apart("voltage-sag", 2, 30, 40)]
    assert [e.servo_ids for e in explain(later)] == [(1,), (2,)]


def test_who_fell_silent_in_one_moment_is_of_one_incident_whenever_each_is_missed() -> None:
    limp = [apart("joint-limp", 1, 18), apart("joint-limp", 2, 25)]
    assert [e.servo_ids for e in explain(limp)] == [(1,), (2,)]
    silent = [apart("away-for-a-while", servo, 19.5, 20) for servo in (1, 2)]
    (one,) = explain([*limp, *silent])
    assert one.servo_ids == (1, 2)


def test_servos_that_are_away_within_seconds_of_each_other_are_of_one_incident() -> None:
    away = [apart("away-for-a-while", 1, 19, 20), apart("away-for-a-while", 2, 22, 24)]
    assert [e.servo_ids for e in explain(away)] == [(1, 2)]
    away[1] = apart("away-for-a-while", 2, 26, 28)
    assert [e.servo_ids for e in explain(away)] == [(1,), (2,)]


def test_what_befell_a_renamed_servo_is_told_with_the_id_that_two_have_since() -> None:
    gone = [apart(code, 2, 10) for code in ("old-id-asked", "silent-since", "id-changed")]
    twice = replace(apart("id-given-twice", 1, 10), befell=(2,))
    (one,) = explain([*gone, twice])
    assert (one.causes[0].cause, one.servo_ids) == ("duplicate-id", (1,))
    before = apart("old-id-asked", 2, 3)
    assert len(explain([before, *gone, twice])) == 2


def test_strays_at_the_turn_are_of_two_servos_with_one_id_where_there_are_two() -> None:
    strays = [told("strays-at-turn", 0.8), told("truncated-frame")]
    twins = [told(code, servo_id=4) for code in ("answers-always-torn", "damage-one-servo")]
    assert [e.causes[0].cause for e in explain([*twins, *strays])] == ["duplicate-id"]
    assert [e.causes[0].cause for e in explain(strays)] == ["turnaround"]


def test_the_same_bytes_time_and_again_are_no_two_requests_at_once() -> None:
    torn = [told(code) for code in ("damage-in-requests", "requests-run-together")]
    assert [e.causes[0].cause for e in explain(torn)] == ["two-masters"]
    (one,) = explain([*torn, told("same-bytes-torn", servo_id=3)])
    assert one.causes[0].cause == "malformed-command"


def test_alarms_in_the_answers_of_a_servo_whose_clock_is_off_are_misread_bits() -> None:
    off = [told(code, servo_id=2) for code in ("last-bits", "same-bit", "damage-one-servo")]
    hot = [told(code, servo_id=2) for code in ("device-temperature-limit", "device-recovered")]
    assert [e.causes[0].cause for e in explain([*off, *hot])] == ["clock-drift"]
    assert [e.causes[0].cause for e in explain(hot)] == ["overheat"]


def test_a_position_that_jumps_while_two_programs_ask_is_the_answer_to_the_others_question() -> (
    None
):
    torn = [told(code) for code in ("damage-in-requests", "requests-run-together")]
    (one,) = explain([*torn, told("position-jumps", servo_id=2)])
    assert one.causes[0].cause == "two-masters"
    (alone,) = explain([told("position-jumps", servo_id=2)])
    assert alone.causes[0].cause == "position-jump"


@pytest.mark.parametrize(
    ("way", "cause"),
    [("request-swallowed", "impatient-controller"), ("first-byte-torn", "turnaround")],
)
def test_requests_that_are_torn_when_no_answer_is_due_are_neither_haste_nor_a_driver(
    way: str, cause: str
) -> None:
    torn = [told(code) for code in (way, "requests-spoken-into", "damage-everywhere", "noise")]
    assert explain(torn)[0].causes[0].cause == cause
    torn.append(told("torn-when-none-due"))
    assert explain(torn)[0].causes[0].cause == "two-masters"


def test_bare_answers_without_requests_are_torn_by_their_looks_alone() -> None:
    heard = [told(code) for code in ("nobody-asks", "noise", "damage-everywhere")]
    assert [e.causes[0].cause for e in explain(heard)] == ["tap-one-way"]


@pytest.mark.parametrize(("begins", "ends", "counts"), [(3, 1, 0.2), (6, 2, 0.3), (12, 0, 1.0)])
def test_beginnings_that_a_contact_takes_as_often_by_chance_tell_little(
    begins: int, ends: int, counts: float
) -> None:
    """A contact opens within an answer as often as it closes there."""
    lost = [*[slice(2, None)] * begins, *[slice(0, -3)] * ends]

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo == 1 or cycle % 10 != 5 or not lost:
            return False
        part = lost.pop()
        talk.say(talk.tongue.ask(servo))
        talk.rest(0.3)
        talk.say(talk.tongue.answer(servo, swinging(servo, talk.now_s))[part])
        talk.rest(0.5)
        return True

    torn = found(robot("mightyzap", 8, instead=instead, goals=False).diagnosed())
    (first,) = [f for f in torn if f.code == "first-byte-torn"]
    assert first.strength == pytest.approx(counts, abs=0.1)


def test_noise_and_interference_stand_near_each_other_where_no_motion_is_known() -> None:
    noise = [told(code) for code in ("strays-anywhere", "damage-everywhere", "noise")]
    (one,) = explain(noise)
    assert [c.cause for c in one.causes[:2]] == ["bus-noise", "emi-load"]
    assert one.causes[0].confidence < 0.7
    (one,) = explain([*noise, told("damage-whatever-moves")])
    assert one.causes[0].cause == "bus-noise"
    assert one.causes[0].confidence > 0.9


def test_motion_with_which_noise_goes_by_chance_leaves_it_open_what_it_is() -> None:
    """Two and a half standard deviations are met once in eighty looks, two in each capture."""
    noise = [told(code) for code in ("strays-anywhere", "damage-in-requests", "noise")]
    (one,) = explain([*noise, told("damage-while-moving", by_deviations(2.5))])
    assert {c.cause for c in one.causes[:2]} == {"bus-noise", "emi-load"}
    assert one.causes[0].confidence < 0.8
    (one,) = explain([*noise, told("damage-while-moving", by_deviations(4.0))])
    assert one.causes[0].cause == "emi-load"
    assert one.causes[0].confidence > 0.9


def by_deviations(deviations: float) -> float:
    """Return how much it counts that damage goes with motion so far beyond chance, of two ways."""
    return strength_of(deviations, 2)


@pytest.mark.parametrize("heard", [lambda chunks: chunks, through_usb, without_clock])
def test_bare_second_answers_may_be_anothers_where_no_time_tells(
    heard: Callable[[list[Chunk]], list[Chunk]],
) -> None:
    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != 2:
            return False
        talk.say(talk.tongue.ask(servo))
        for _ in range(2):
            talk.rest(0.4)
            talk.say(talk.tongue.answer(servo, swinging(servo, talk.now_s)))
        talk.rest(0.5)
        return True

    talk = robot("wck", 6, instead=instead, goals=False)
    chunks = heard(talk.chunks)
    judged = talk.diagnosed(chunks)
    (twice,) = [f for f in found(judged) if f.code == "answers-twice"]
    (one,) = [i for i in judged.incidents() if i.cause == "duplicate-id"]
    if chunks is talk.chunks:
        assert not twice.may_be
        assert one.causes[0].confidence > 0.9
    else:
        assert one.servo_ids == (2,)
        assert twice.may_be == (1,)
        assert one.causes[0].confidence <= 0.5
        assert one.next.startswith("Disconnect servo after servo")
        assert one.next.endswith("(It may be that of servo 1 instead.)")


def strange(spoken_into: int) -> set[str]:
    """Return what is found of lines, some with a blank for a zero, some that others speak into."""
    talk = Conversation("lss")
    for cycle in range(600):
        talk.until(cycle / 60)
        servo = cycle % 3 + 1
        talk.say(talk.tongue.ask(servo))
        talk.rest(0.4)
        answer = talk.tongue.answer(servo, swinging(servo, talk.now_s))
        if cycle % 30 == 10:
            talk.say(answer[:-1] + b" \r")
        elif cycle % 30 < spoken_into:
            talk.say(answer[:3] + bytes((0x00, 0x14, 0x81, 0xA6)) + answer[-2:])
        else:
            talk.say(answer)
    return codes(talk.diagnosed())


def test_a_strange_sign_tells_its_bit_where_most_torn_lines_have_one() -> None:
    assert "same-bit" in strange(0)


def test_a_strange_sign_tells_nothing_beside_lines_that_others_speak_into() -> None:
    assert "same-bit" not in strange(4)
