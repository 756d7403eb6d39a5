"""Joints and their goals: what hangs, what is blocked, and what only looks like it."""

from __future__ import annotations

import math
import random
from typing import TYPE_CHECKING, Final

import pytest

from tests.conversations import Conversation, robot, swinging
from tests.diagnosed import codes, verdicts
from tests.lists import each_in_turn
from tests.servos import finding, heard, lss, polled
from tests.streams import mightyzap, rs30x, wck

if TYPE_CHECKING:
    from collections.abc import Callable

    from sniffer.diagnosis import Diagnosis

HANGS = {"joint-limp", "joint-stalled", "joint-not-following", "joint-limp-after-restart"}


def swings(t: float) -> float:
    """Go to and fro over 60 degrees, a new goal four times a second."""
    return 30 * math.sin(round(t * 4) / 4)


def follows(t: float) -> float:
    """Be there a little later."""
    return 30 * math.sin(t - 0.15)


def works(t: float) -> float:
    return 180 + 60 * math.sin(3 * t)


def test_a_joint_that_stays_where_it_is_with_an_idle_motor_hangs_limp() -> None:
    d = lss(*polled(lambda t: -50.0, swings, milliampere=lambda t: 40))
    assert verdicts(d.incidents()) == [("torque-off", (5,))]
    told = finding(d, "joint-limp")
    assert told is not None
    assert "stood at -50 deg" in told.what
    assert told.places


def test_a_joint_that_stays_where_it_is_and_pushes_is_blocked() -> None:
    d = lss(*polled(lambda t: -50.0, swings, milliampere=lambda t: 900))
    assert verdicts(d.incidents()) == [("stall", (5,))]


def test_a_motor_that_is_off_and_tries_again_for_moments_does_not_push() -> None:
    held = lss(*polled(lambda t: -50.0, swings, milliampere=lambda t: 900 if t < 1.5 else 40))
    tries = lss(*polled(lambda t: -50.0, swings, milliampere=lambda t: 40 if t % 3 > 0.3 else 900))
    assert "joint-stalled" in codes(held)
    assert "joint-stalled" not in codes(tries)
    assert verdicts(tries.incidents()) == [("torque-off", (5,))]


def test_a_joint_that_presses_where_its_one_goal_sent_it_may_do_so_by_plan() -> None:
    def closes(t: float) -> float:
        return 40.0 if t % 8 >= 4 else -40.0

    def meets(t: float) -> float:
        return min(120 * (t % 4) - 40, 10.0) if t % 8 >= 4 else max(10 - 120 * (t % 4), -40.0)

    grips = lss(
        *polled(meets, closes, milliampere=lambda t: 700 if t % 8 > 4.5 else 50, seconds=24)
    )
    (told,) = grips.incidents()
    assert told.cause == "stall"
    assert 0.5 < told.causes[0].confidence < 0.8
    assert "a gripper that holds" in told.next


def looked_at_once_a_move(protocol: str, place: Callable[[float, float], float]) -> Diagnosis:
    """Return the diagnosis of two joints that are sent somewhere, and looked at behind each move.

    ``place`` is where the second one is, by where it was and where it is to be.
    """
    talk = Conversation(protocol)
    at = 0.5
    for move, goal in enumerate((0.3, 0.7, 0.45, 0.8, 0.25, 0.75, 0.4, 0.65, 0.35, 0.6) * 2):
        talk.until(4 * move)
        for step in range(1, 11):
            for servo in (1, 2):
                talk.send(servo, goal)
            talk.rest(10 * step)
        at = place(at, goal)
        talk.until(4 * move + 2.5)
        talk.read(1, goal)
        talk.read(2, at)
    return talk.diagnosed()


@each_in_turn(3, "protocol", ["mightyzap", "lss", "rs30x"])
def test_a_joint_that_hangs_is_seen_by_who_looks_once_a_move(protocol: str) -> None:
    sags = looked_at_once_a_move(protocol, lambda at, goal: at - 0.02)
    stops = looked_at_once_a_move(protocol, lambda at, goal: min(goal, 0.55))
    for joint in (sags, stops):
        assert [i.servo_ids for i in joint.incidents()] == [(2,)]
        assert "joint-not-following" in codes(joint)
    # half of each way is done when it is looked at: a servo that takes its time
    slow = looked_at_once_a_move(protocol, lambda at, goal: (at + goal) / 2)
    assert not slow.incidents()
    assert not looked_at_once_a_move(protocol, lambda at, goal: goal).incidents()


def told_now_and_then(protocol: str, place: Callable[[float], float]) -> set[str]:
    """Return what is found of a joint that is told a goal each 1.9 s, on this side and on that.

    ``place`` is where it is by its goal, half a second behind that.
    """
    talk = Conversation(protocol)
    for move, goal in enumerate((0.5, 0.42, 0.7, 0.44, 0.6, 0.35, 0.62) * 2):
        talk.until(1.9 * move)
        talk.send(1, goal)
        began = talk.now_s
        while talk.now_s < 1.9 * move + 1.8:
            talk.read(1, place(goal) if talk.now_s > began + 0.4 else 0.5)
            talk.rest(60)
    return codes(talk.diagnosed())


@pytest.mark.parametrize("protocol", ["mightyzap", "lss", "rs30x"])
def test_a_joint_that_hangs_between_goals_that_come_now_and_then_does_not_follow(
    protocol: str,
) -> None:
    assert "joint-not-following" in told_now_and_then(protocol, lambda goal: 0.5)
    assert not told_now_and_then(protocol, lambda goal: goal) & HANGS


def loaded(load: Callable[[float], float]) -> Diagnosis:
    """Return the diagnosis of a wCK joint that stands, under goals that swing, with a raw load."""
    talk = Conversation("wck")
    for cycle in range(300):
        talk.until(cycle / 25)
        goal = 127 + round(60 * math.sin(1.2 * talk.now_s))
        state = bytes([round(load(abs(goal - 127) / 60)), 127])
        for request in (wck.command(1 << 5 | 4, goal), wck.command(5 << 5 | 4, 0)):
            talk.say(request)
            talk.rest(0.4)
            talk.say(state)
            talk.rest(0.4)
    return talk.diagnosed()


def test_a_joint_that_pushes_the_harder_the_further_its_goal_is_is_blocked() -> None:
    """A motor that is off does not know where its goal is, however its load is counted."""
    told = loaded(lambda off: 20 + 75 * off)
    assert "joint-stalled" in codes(told)
    assert verdicts(told.incidents()) == [("stall", (4,))]


def test_a_load_that_does_not_go_with_the_goals_is_no_push() -> None:
    rng = random.Random(4)
    assert "joint-stalled" not in codes(loaded(lambda _: rng.uniform(40, 95)))


def test_a_joint_without_measured_load_only_does_not_follow() -> None:
    d = lss(*polled(lambda t: -50.0, swings))
    assert codes(d) & HANGS == {"joint-not-following"}
    (incident,) = d.incidents()
    assert incident.cause == "torque-off"
    assert incident.causes[0].confidence < 0.8


def test_a_joint_whose_effort_was_read_only_before_is_told_without_a_number_for_it() -> None:
    once = [(0.001 * k, "#5QC" if k % 2 == 0 else "*5QC40") for k in range(20)]
    d = lss(*sorted([*polled(lambda t: -50.0, swings), *once]))
    told = finding(d, "joint-not-following")
    assert told is not None
    assert told.what.endswith("deg")
    assert "nan" not in told.what


def test_a_joint_in_the_middle_of_its_goals_hangs_limp_all_the_same() -> None:
    d = lss(*polled(lambda t: 0.0, swings, milliampere=lambda t: 40))
    assert "joint-limp" in codes(d)


def test_a_joint_that_hangs_from_some_moment_on_is_told_from_then_on() -> None:
    d = lss(
        *polled(
            lambda t: follows(t) if t < 6 else -55.0,
            swings,
            seconds=14,
            milliampere=lambda t: works(t) if t < 6 else 40,
        )
    )
    told = finding(d, "joint-limp")
    assert told is not None
    assert told.first_ns - d.cases()[0].first_ns == pytest.approx(6e9, abs=1.5e9)


@pytest.mark.parametrize(
    ("what", "place", "goal"),
    [
        ("follows its goals", follows, swings),
        ("follows a second later", lambda t: 30 * math.sin(t - 0.8), swings),
        ("rests where it was sent", lambda t: 20.0, lambda t: 20.0),
        ("is on its way, slowly", lambda t: min(8 * t, 80), lambda t: 80.0),
        (
            "gets goals that no joint follows",
            lambda t: 2 * math.sin(9 * t),
            lambda t: 12.0 if round(t * 12) % 2 else -12.0,
        ),
        ("gives way a little under its weight", lambda t: follows(t) - 3, swings),
        (
            "rests between moves",
            lambda t: [0.0, 40.0, -40.0][min(int(max(t - 0.4, 0) / 4), 2)],
            lambda t: [0.0, 40.0, -40.0][min(int(t / 4), 2)],
        ),
    ],
    ids=lambda x: x if isinstance(x, str) else "",
)
def test_a_sound_joint_is_not_told_to_hang(what: str, place: object, goal: object) -> None:
    assert callable(place)
    assert callable(goal)
    d = lss(*polled(place, goal, milliampere=works))
    assert not codes(d) & HANGS, what
    assert not d.incidents()


GOALS: Final = (
    *(68.2, 50.4, 32.6, 25.7, 46.6, 71.6, 71.6, 66.7, 62.1, 62.1, 64.9, 68.2, 68.2, 65.6, 47.8),
    *(30.0, 25.7, 50.8, 71.6, 71.6, 65.8, 62.1, 62.1, 65.6, 68.2, 68.2, 63.0, 45.2, 27.4),
)
"""What a joint was told every 0.4 s; it was there when the next goal came."""

LOOKED_AT: Final = (1, 3, 6, 7, 8, 9, 12, 21, 23, 28)
"""Behind which goals it was looked at, a few milliseconds later."""


def test_a_joint_that_is_looked_at_right_behind_a_goal_is_where_the_goal_before_was() -> None:
    told = [(0.4 * k, f"#5D{round(goal * 10)}") for k, goal in enumerate(GOALS)]
    told += [(0.4 * k + 0.002, "#5QD") for k in LOOKED_AT]
    told += [(0.4 * k + 0.004, f"*5QD{round(GOALS[k - 1] * 10)}") for k in LOOKED_AT]
    assert not lss(*told).incidents()
    hangs = [(t, "*5QD622" if text.startswith("*5QD") else text) for t, text in told]
    assert "joint-not-following" in codes(lss(*hangs))


@pytest.mark.parametrize("stands", [False, True])
def test_who_looks_once_a_second_at_what_moves_once_a_second_does_not_see_it_hang(
    stands: bool,
) -> None:
    """By its other register, which is read oftener, the joint moves all the time."""
    said: list[tuple[float, bytes]] = []
    for k in range(280):
        t = 0.05 * k
        place = 127 + 50 * math.sin(math.tau * t)
        said.append((t, wck.command(2 << 5 | 31, 2, bytes((round(place), round(place))))))
        if k % 3 == 0:
            ten = 512 if stands else round(place * 4.02)
            said.append((t + 0.01, wck.command(0xE0, 0xC9, bytes((1, 1)))))
            said.append((t + 0.012, bytes((ten >> 7, ten & 127))))
        if k % 20 == 0:
            said.append((t + 0.02, wck.command(5 << 5 | 1, 0)))
            said.append((t + 0.022, bytes((1, 152))))
    assert ("joint-limp" in codes(heard(said, "wck"))) == stands


@pytest.mark.parametrize("order", ["#5L", "#5H", "#5WD900", "#5MD300", "#5RESET"])
def test_a_joint_that_was_told_something_else_since_does_not_miss_its_goal(order: str) -> None:
    d = lss(
        *polled(
            lambda t: follows(t) if t < 6 else -70.0,
            lambda t: swings(t) if t < 5.8 else None,
            milliampere=lambda t: 40,
            also=[(5.9, order)],
        )
    )
    assert not codes(d) & HANGS


def test_goals_in_another_unit_end_those_in_degrees() -> None:
    d = lss(
        *polled(
            lambda t: follows(t) if t < 6 else -70.0,
            lambda t: swings(t) if t < 5.8 else None,
            milliampere=lambda t: 40,
            also=[(6 + 0.5 * k, f"#5P{900 + k}") for k in range(10)],
        )
    )
    assert not codes(d) & HANGS


def hangs_from_second_6() -> list[tuple[float, str]]:
    return polled(
        lambda t: follows(t) if t < 6 else -70.0,
        swings,
        seconds=14,
        milliampere=lambda t: works(t) if t < 6 else 40,
    )


def test_a_joint_that_hangs_since_its_servo_was_away_is_limp_after_a_restart() -> None:
    kept = [(t, line) for t, line in hangs_from_second_6() if not (6 < t < 6.3 and "Q" in line)]
    d = lss(*kept, *[(6.02 + 0.07 * k, "#5QD") for k in range(4)])
    assert {"joint-limp-after-restart", "away-for-a-while"} <= codes(d)
    assert len(d.incidents()) == 1


def test_a_servo_that_says_it_is_limp_while_it_has_goals_is_without_torque() -> None:
    said = [(k * 0.5, f"#5D{(-1) ** k * 300}") for k in range(20)]
    said += [(k * 0.5 + 0.4, "#5Q *5Q1") for k in range(20)]
    d = lss(*said)
    assert verdicts(d.incidents()) == [("torque-off", (5,))]
    released = [(k * 0.5, "#5L") for k in range(20)]
    assert not lss(*[(t, x) for t, x in said if "D" not in x], *released).incidents()


def switched_on(servos: tuple[int, ...], hanging: tuple[int, ...]) -> Diagnosis:
    """Diagnose an RS30x client that reads positions alone; some joints stand still."""

    def torque(talk: Conversation, cycle: int) -> None:
        for servo in servos if not cycle else ():
            talk.write(rs30x.write(servo, 0x24, b"\x01"))

    def still(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo in hanging:
            talk.read(servo, 0.2)
        return servo in hanging

    return robot("rs30x", 8, before=torque, instead=still).diagnosed()


def test_joints_that_nobody_switches_on_are_one_omission_whenever_they_are_to_move() -> None:
    told = switched_on((), (1, 2, 3))
    assert "torque-never-on" in codes(told)
    (incident,) = told.incidents()
    assert (incident.cause, incident.servo_ids) == ("torque-off", (1, 2, 3))
    assert incident.causes[0].confidence > 0.7


def test_the_one_joint_that_is_left_out_when_the_others_are_switched_on_is_named() -> None:
    told = switched_on((1, 3), (2,))
    assert "torque-never-on" in codes(told)
    assert verdicts(told.incidents()) == [("torque-off", (2,))]


def test_a_joint_that_stands_beside_others_that_move_may_have_been_switched_on_before() -> None:
    assert "torque-never-on" not in codes(switched_on((), (2,)))
    assert "torque-never-on" not in codes(switched_on((1, 2, 3), (2,)))


@pytest.mark.parametrize(("left_behind", "stalls"), [(b"", True), (b"\x41", False)])
def test_a_bare_answer_that_took_a_stray_for_its_first_byte_tells_no_load(
    left_behind: bytes, *, stalls: bool
) -> None:
    """What it says its load is was the stray, its place the load, and the last byte is nobody's."""
    talk = Conversation("wck")
    for cycle in range(280):
        talk.until(cycle / 40)
        for servo in (1, 2, 3):
            place = swinging(servo, talk.now_s)
            talk.say(talk.tongue.goal(servo, place))
            talk.rest(0.3)
            shifted = servo == 2 and 100 <= cycle < 240
            talk.say(
                bytes((0xF0, 3)) + left_behind if shifted else talk.tongue.answer(servo, place)
            )
            talk.rest(0.4)
    assert ("joint-stalled" in codes(talk.diagnosed())) == stalls


def held_for_a_while(*, switched_on: float) -> Diagnosis:
    """A mightyZAP joint that stands from 4 to 7 s, with its torque written at 0 s and once more."""
    talk = Conversation("mightyzap")
    on = mightyzap.packet(1, 0xF3, bytes((0x80, 1)))
    talk.write(on)
    at = 0.5
    for cycle in range(480):
        talk.until(cycle / 40)
        if cycle == round(40 * switched_on):
            talk.write(on)
        goal = swinging(1, talk.now_s)
        at = at if 4 <= talk.now_s < 7 else goal
        talk.send(1, goal)
        talk.read(1, at)
    return talk.diagnosed()


def test_a_joint_that_follows_again_though_nobody_switched_its_torque_on_was_blocked() -> None:
    assert verdicts(held_for_a_while(switched_on=0.5).incidents()) == [("stall", (1,))]
    # who is switched on again where it goes on may have been off
    assert verdicts(held_for_a_while(switched_on=6.9).incidents()) == [("torque-off", (1,))]


@each_in_turn(3, "protocol", ["lss", "mightyzap", "rs30x"])
def test_a_loop_that_rests_for_minutes_does_not_look_seldom(protocol: str) -> None:
    """A mean of some seconds from look to look made every one of a moving joint count."""

    def rests(talk: Conversation, cycle: int) -> None:
        if cycle == 200:
            talk.rest(600_000)

    assert not codes(robot(protocol, 10, behind=rests).diagnosed())
