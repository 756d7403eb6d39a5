"""Programs and joints that are in order, each in a shape that was once taken for a fault."""

from __future__ import annotations

import math
import random
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from bench.diagnosis.catalogue import scenarios
from bench.diagnosis.hosts import HOSTS
from bench.diagnosis.judging import diagnosed as drawn
from sniffer.ground.coarse import coarse
from sniffer.ground.model import Chunk, Clock
from tests.conversations import MS, TONGUES, Conversation, robot, swinging
from tests.diagnosed import codes, diagnosed, verdicts
from tests.lists import each_in_turn
from tests.servos import lss, polled

if TYPE_CHECKING:
    from collections.abc import Callable

PROTOCOLS = tuple(TONGUES)


def joined_by_a_third(protocol: str, *, was_there: bool) -> Conversation:
    """Let a program look for servo 3 twice, which comes later or was there before."""

    def looks(talk: Conversation, cycle: int) -> None:
        if cycle in (80, 140):
            talk.ask_in_vain(3)
        elif (was_there and cycle < 60) or cycle > 200:
            talk.read(3, swinging(3, talk.now_s))

    return robot(protocol, 7, servos=(1, 2), before=looks)


@each_in_turn(4, "protocol", PROTOCOLS)
def test_a_servo_that_is_plugged_in_later_was_not_away(protocol: str) -> None:
    assert not joined_by_a_third(protocol, was_there=False).diagnosed().incidents()
    assert "away-for-a-while" in codes(joined_by_a_third(protocol, was_there=True).diagnosed())


def paced(protocol: str, *parts: tuple[int, float]) -> Conversation:
    """Let a loop run for some cycles of so many ms each, and then with another period."""
    talk = Conversation(protocol)
    rng = random.Random(7)
    for cycles, ms in parts:
        for _ in range(cycles):
            begin = talk.now_ns
            for servo in (1, 2):
                talk.send(servo, swinging(servo, talk.now_s))
                talk.read(servo, swinging(servo, talk.now_s))
            talk.rest(ms + rng.uniform(0, ms / 50) - (talk.now_ns - begin) / MS)
    return talk


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_program_that_looks_less_often_at_the_end_does_not_stall(protocol: str) -> None:
    talk = Conversation(protocol)
    for servo in (1, 2):
        talk.send(servo, 0.5)
    for cycles, ms in ((400, 25), (30, 100), (40, 500)):
        for _ in range(cycles):
            for servo in (1, 2):
                talk.read(servo, 0.5)
            talk.rest(ms)
    assert not talk.diagnosed().incidents()


@each_in_turn(4, "protocol", PROTOCOLS)
def test_a_pause_that_is_long_for_the_loop_around_it_is_a_stall(protocol: str) -> None:
    beside_a_slower_one = paced(protocol, (60, 100), (1, 160), (450, 25))
    assert "loop-stalls" not in codes(beside_a_slower_one.diagnosed())
    alone = paced(protocol, (60, 100), (225, 25), (1, 160), (225, 25))
    assert "loop-stalls" in codes(alone.diagnosed())


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_program_that_waits_before_it_begins_something_else_does_not_stall(protocol: str) -> None:
    """A loop that stops goes on where it was; who waits for another limb begins his next job."""
    talk = Conversation(protocol)

    def looks(cycles: int) -> None:
        for _ in range(cycles):
            talk.read(1, 0.5)
            talk.read(2, 0.5)
            talk.rest(20)

    looks(200)
    talk.rest(200)
    for servo in (1, 2):  # where it is, and to stay there: seen once
        talk.read(servo, 0.5)
        talk.send(servo, 0.5)
    looks(200)
    assert "loop-stalls" not in codes(talk.diagnosed())


@each_in_turn(4, "protocol", PROTOCOLS)
def test_phases_of_a_period_each_are_no_uneven_loop(protocol: str) -> None:
    parts = [(60, 20 * 1.4**k) for k in range(6)]
    assert not paced(protocol, *parts).diagnosed().incidents()


def test_what_is_asked_several_times_in_a_cycle_makes_no_loop_uneven() -> None:
    talk = Conversation("wck")
    rng = random.Random(4)
    for cycle in range(300):
        talk.until(cycle / 4)
        for _ in range(3):
            talk.read(1, 0.5)
            talk.rest(rng.uniform(0, 8))
    assert not talk.diagnosed().incidents()


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_stamps_that_are_a_millisecond_late_make_no_controller_impatient(protocol: str) -> None:
    talk = Conversation(protocol, 9600)
    for cycle in range(300):
        servo = 1 + cycle % 2
        talk.say(talk.tongue.ask(servo))
        talk.rest(0.3)
        talk.say(talk.tongue.answer(servo, 0.5))
        talk.rest(0.03)
    # byte by byte, as an adapter with a timer of a millisecond hands them on
    late = random.Random(2)
    chunks = []
    for chunk in talk.chunks:
        assert chunk.t_ns is not None
        for k, byte in enumerate(chunk.data):
            t = chunk.t_ns - (len(chunk.data) - 1 - k) * talk.byte_ns
            stamp = -(-t // MS) * MS + late.randrange(MS // 4)
            chunks.append(Chunk(bytes([byte]), stamp, Clock.READ))
    told = diagnosed(chunks, protocol, baud=9600, latency_ns=MS)
    assert "answers-after-next" not in codes(told)


def test_a_joint_at_rest_whose_last_digits_tremble_does_not_jump() -> None:
    def rests(t: float, spike: float) -> float:
        return 20 + (spike if round(t / 0.04) % 40 == 13 else 0)

    assert not lss(*polled(lambda t: rests(t, 0.4), lambda t: 20.0)).incidents()
    told = lss(*polled(lambda t: rests(t, 15), lambda t: 20.0)).incidents()
    assert verdicts(told) == [("position-jump", (5,))]


def grips(t: float) -> float:
    """Close on something at 10 degrees, and open again, every six seconds."""
    since = t % 6
    return min(-50 + 80 * since, 10.0) if since < 3 else max(10 - 80 * (since - 3), -50.0)


def holds(t: float) -> float:
    return 150.0 if 0.75 < t % 6 < 3 else 30.0


def closes(t: float) -> float:
    return 40.0 if t % 6 < 3 else -50.0


def test_a_gripper_that_holds_something_is_not_limp() -> None:
    d = lss(*polled(grips, closes, seconds=30, milliampere=holds))
    assert not d.incidents()
    pressing = lss(*polled(grips, closes, seconds=30, milliampere=lambda t: 6 * holds(t)))
    assert [i.cause for i in pressing.incidents()] == ["stall"]


def chased(goal: Callable[[float], float], speed: float) -> Callable[[float], float]:
    """Return where a joint is that goes to its goals at a speed, in degrees a second."""
    places = [goal(0.0)]
    for k in range(1, 4000):
        ahead = goal(k / 100) - places[-1]
        places.append(places[-1] + math.copysign(min(abs(ahead), speed / 100), ahead))
    return lambda t: places[round(t * 100)]


def test_a_slow_joint_whose_goal_is_changed_on_its_way_is_not_blocked() -> None:
    def goal(t: float) -> float:
        since = t % 5
        return -45.0 if since < 3 else 45.0 if since < 3.4 else -40.0 if since < 3.8 else 48.0

    d = lss(*polled(chased(goal, 15), goal, seconds=30, milliampere=lambda t: 600.0))
    assert "joint-stalled" not in codes(d)


def test_a_joint_that_rests_while_its_goal_steps_in_the_last_moment_is_not_limp() -> None:
    def goal(t: float) -> float:
        return -50.0 if t % 10 < 5.17 else 50.0

    stated = [(k / 100, f"#5D{round(goal(k / 100) * 10)}") for k in range(2000)]
    place = chased(goal, 30)
    said = polled(place, lambda t: None, seconds=20, milliampere=lambda t: 30, also=stated)
    assert "joint-limp" not in codes(lss(*said))


@pytest.mark.parametrize("protocol", ["mightyzap", "rs30x", "lss"])
def test_a_move_home_behind_the_last_goal_of_a_path_is_no_jump(protocol: str) -> None:
    talk = robot(protocol, 8, servos=(1,))
    home = 0.95 if swinging(1, talk.now_s) < 0.5 else 0.05
    talk.send(1, home)
    for _ in range(60):
        talk.rest(50)
        talk.read(1, home)
    assert "goal-jump" not in codes(talk.diagnosed())


@each_in_turn(2, "protocol", ["lss", "rs30x"])
def test_a_log_with_hundredths_of_a_second_tells_of_no_slow_servo(protocol: str) -> None:
    """Whose answer is the next hundredth's is a matter of the loop, and not of the servo."""
    talk = robot(protocol, 10, servos=range(1, 7), rate_hz=11, baud=57600)
    chunks = [
        replace(c, t_ns=round(c.t_ns or 0, -7), clock=Clock.FILE, marks=coarse(len(c.data), 2))
        for c in talk.chunks
    ]
    told = diagnosed(chunks, protocol)
    assert not codes(told)
    assert told.sentence().endswith("stamps good to 10 ms")


@pytest.mark.parametrize("protocol", ["mightyzap", "lss", "rs30x"])
def test_a_joint_that_is_met_at_one_place_on_its_way_three_times_does_not_stand(
    protocol: str,
) -> None:
    def wanted(t: float) -> float:
        return 0.5 + 0.3 * math.sin(2 * math.pi * t / 1.6)

    def looked_at(place: Callable[[float], float]) -> set[str]:
        talk = Conversation(protocol)
        looks = [4.95, 6.55, 8.15, 9, 9.8, 10.2, 10.9, 11.3, 12.2, 13.0]  # three at one place
        for step in range(135):
            talk.until(step / 10)
            talk.send(1, wanted(talk.now_s))
            if looks and talk.now_s > looks[0]:
                talk.read(1, place(looks.pop(0)))
        return codes(talk.diagnosed())

    assert "joint-not-following" not in looked_at(lambda t: wanted(t - 0.1))
    assert "joint-not-following" in looked_at(lambda t: 0.85)


def test_a_joint_of_bursts_that_is_looked_at_now_and_then_does_not_stand_where_it_was_met() -> None:
    """Drawn traffic: one servo of seven is read behind each burst of goals, whichever it is."""
    (scenario,) = scenarios(99931, "sound-bursts-lss")
    told, _ = drawn(HOSTS["exact"](scenario, scenario.make(99931), 99931))
    assert told == ()
