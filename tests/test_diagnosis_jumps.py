"""Jumps: of goals among others that move in small steps, and of positions that no joint does."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest

from sniffer.ground.model import Chunk
from tests.conversations import TONGUES, Conversation, robot, swinging, without_clock
from tests.diagnosed import codes, diagnosed, found, verdicts
from tests.lists import each_in_turn, in_turn
from tests.servos import finding, heard, lss, mightyzap_read, mightyzap_write, polled
from tests.streams import wck

if TYPE_CHECKING:
    from collections.abc import Callable


PROTOCOLS = tuple(TONGUES)

POSITION = 0x8C
"""Where a mightyZAP tells its position."""


@each_in_turn(4, "protocol", PROTOCOLS)
def test_a_goal_that_jumps_and_comes_back_is_a_jump(protocol: str) -> None:
    def path(servo: int, s: float) -> float:
        x = swinging(servo, s)
        return 1 - x if servo == 2 and int(s * 40) in (150, 151, 280) and abs(x - 0.5) > 0.1 else x

    told = robot(protocol, 12, path=path).diagnosed()
    assert [f.servo_id for f in found(told) if f.code == "goal-jump"] == [2]
    assert ("position-jump", (2,)) in verdicts(told.incidents())


@pytest.mark.parametrize("cycles", [range(0), range(38, 40)], ids=["goes-on", "jumps"])
def test_a_goal_that_jumps_in_a_slow_loop_is_a_jump_as_well(cycles: range) -> None:
    def path(servo: int, s: float) -> float:
        x = swinging(servo, s / 3)
        return (0.95 if x < 0.5 else 0.05) if servo == 2 and int(s * 6.5 + 0.1) in cycles else x

    told = robot("lss", 12, path=path, rate_hz=6.5).diagnosed()
    assert [f.servo_id for f in found(told) if f.code == "goal-jump"] == [2] * bool(cycles)


@each_in_turn(4, "protocol", PROTOCOLS)
def test_a_program_that_moves_from_point_to_point_does_not_jump(protocol: str) -> None:
    rng = random.Random(6)
    points = [rng.uniform(0.1, 0.9) for _ in range(12)]

    def path(servo: int, s: float) -> float:
        return points[(int(s) + servo) % len(points)]

    assert "goal-jump" not in codes(robot(protocol, 12, path=path).diagnosed())


def test_a_path_that_went_on_while_the_loop_stood_still_does_not_jump() -> None:
    talk = robot("rs30x", 10, before=lambda talk, n: talk.rest(400 if n % 90 == 89 else 0))
    assert "goal-jump" not in codes(talk.diagnosed())


def test_without_a_clock_only_a_goal_where_no_other_is_comes_back_from_a_jump() -> None:
    """Two pauses look alike, for the path goes on meanwhile: to where it goes anyway."""
    paused = robot("rs30x", 10, before=lambda talk, n: talk.rest(900 if n % 97 in (50, 54) else 0))
    assert "goal-jump" not in codes(paused.diagnosed(without_clock(paused.chunks)))

    def path(servo: int, s: float) -> float:
        return 0.97 if servo == 2 and int(s * 40) in (150, 151) else swinging(servo, s) / 2

    jumps = robot("rs30x", 10, path=path)
    assert "goal-jump" in codes(jumps.diagnosed(without_clock(jumps.chunks)))


@in_turn(4)
@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize("servos", [(2,), (1, 2)])
def test_bytes_without_times_tell_a_jump_by_the_order_of_goals(
    protocol: str, servos: tuple[int, ...]
) -> None:
    """The line of a slow loop is busy for so little that a whole run is a second of bytes."""

    def path(servo: int, s: float) -> float:
        x = swinging(servo, s / 2)
        jumps = servo == 2 and any(0 < s - t < 0.3 for t in (4, 9.3))
        return (0.99 if x < 0.5 else 0.01) if jumps else x

    def rests(talk: Conversation, cycle: int) -> None:
        talk.rest(900 if cycle % 40 in (30, 32) else 0)

    jumps = robot(protocol, 14, path=path, servos=servos, rate_hz=8)
    told = jumps.diagnosed(without_clock(jumps.chunks))
    assert verdicts(told.incidents()) == [("position-jump", (2,))]
    rested = robot(protocol, 14, servos=servos, rate_hz=8, before=rests)
    for sound in (rested, robot(protocol, 14, servos=servos, rate_hz=8)):
        assert "goal-jump" not in codes(sound.diagnosed(without_clock(sound.chunks)))


@pytest.mark.parametrize("away", [1, 4])
def test_bytes_without_times_tell_a_position_that_is_elsewhere_for_a_few_looks(away: int) -> None:
    where = [*SOUND[:50], *[3500] * away, *SOUND[50 + away :]]
    talk = [Chunk(frame) for _, frame in places(*where)]
    assert verdicts(diagnosed(talk, "mightyzap").incidents()) == [("position-jump", (1,))]
    moved = [Chunk(frame) for _, frame in places(*SOUND[:50], *[3500] * 30, *SOUND[80:])]
    assert not diagnosed(moved, "mightyzap").incidents()


def places(*raw: int, every: float = 0.04) -> list[tuple[float, bytes]]:
    return [
        row
        for k, place in enumerate(raw)
        for row in mightyzap_read(1, k * every, POSITION, place.to_bytes(2, "little"))
    ]


SOUND = [2000 + 3 * (k % 20) for k in range(120)]


def test_a_position_that_jumps_and_comes_back_is_what_no_joint_does() -> None:
    d = heard(places(*SOUND[:50], 3500, *SOUND[50:]), "mightyzap")
    assert verdicts(d.incidents()) == [("position-jump", (1,))]


def test_what_to_do_about_a_jump_is_the_servos_or_the_controllers_by_what_jumps() -> None:
    def next_of(path: Callable[[int, float], float]) -> str:
        (incident,) = robot("rs30x", 12, path=path).diagnosed().incidents()
        return incident.next

    (measured,) = heard(places(*SOUND[:50], 3500, *SOUND[50:]), "mightyzap").incidents()
    assert "position sensor" in measured.next

    def jumps(servo: int, s: float) -> float:
        return 0.97 if servo == 2 and int(s * 40) in (150, 151) else swinging(servo, s) / 2

    assert "position sensor" not in next_of(jumps)
    assert "controller" in next_of(jumps)


def test_a_position_that_stays_for_moments_where_no_goal_is_jumped_there() -> None:
    def moved(away: list[int]) -> list[tuple[float, bytes]]:
        goals = [
            mightyzap_write(1, k * 0.04 + 0.02, 0x86, SOUND[k].to_bytes(2, "little"))
            for k in range(120)
        ]
        return sorted([*places(*SOUND[:50], *away, *SOUND[50 + len(away) :]), *goals])

    there = moved([3900] * 4)
    assert verdicts(heard(there, "mightyzap").incidents()) == [("position-jump", (1,))]
    for slowly in ([2300, 2600, 2900, 3200, 3200, 2900, 2600, 2300], [3900] * 20):
        assert "position-jumps" not in codes(heard(moved(slowly), "mightyzap"))


@pytest.mark.parametrize("is_jump", [True, False])
def test_a_position_that_jumps_while_its_joint_moves_to_where_goals_were_has_jumped(
    *, is_jump: bool
) -> None:
    path = [1000 + 60 * k if k < 40 else 3400 - 60 * (k - 40) for k in range(80)]
    there = {57: 1300, 58: 1310, 59: 1295} if is_jump else {}  # where it goes next, and comes from
    goals = [
        mightyzap_write(1, k * 0.04 + 0.02, 0x86, raw.to_bytes(2, "little"))
        for k, raw in enumerate(path)
    ]
    looks = places(*(there.get(k, raw) for k, raw in enumerate(path)))
    d = heard(sorted([*looks, *goals]), "mightyzap")
    assert verdicts(d.incidents()) == ([("position-jump", (1,))] if is_jump else [])
    told = finding(d, "position-jumps")
    assert (told is not None and told.count) == is_jump  # the way back is no jump of its own


def test_a_position_that_jumps_once_without_a_checksum_is_doubt() -> None:
    d = lss(*polled(lambda t: 150.0 if 4.99 < t < 5.01 else 10 + t, lambda t: None))
    assert "doubtful-value" in codes(d)
    assert not d.incidents()


@pytest.mark.parametrize(("begins", "torn", "jumped"), [("D-118", "", True), ("", "D-1#18", False)])
def test_a_line_that_the_capture_begins_within_makes_no_value_doubtful_and_a_torn_one_does(
    begins: str, torn: str, *, jumped: bool
) -> None:
    jumps = polled(
        lambda t: 150.0 if abs(t - 5) < 0.01 or abs(t - 7) < 0.01 else 10 + t, lambda t: None
    )
    d = lss(*([(0.0, begins)] * bool(begins)), *jumps, *([(9.03, torn)] * bool(torn)))
    assert verdicts(d.incidents()) == [("position-jump", (5,))] * jumped


def test_a_position_that_jumps_because_nobody_looked_for_long_does_not_jump() -> None:
    later = [(t + 3.0, data) for t, data in places(*[k + 1500 for k in SOUND])]
    d = heard([*places(*SOUND[:50]), *later], "mightyzap")
    assert not codes(d) & {"position-jumps", "doubtful-value"}


def test_a_position_in_other_numbers_than_its_goals_may_be_there_and_back_within_a_second() -> None:
    """A wCK tells a second, finer position, which counts from elsewhere, as no goal does."""

    def path(servo: int, s: float) -> float:
        del servo
        phase = s % 3.6
        return 0.2 + 0.6 * min(max(min((phase - 2.6) / 0.3, (3.4 - phase) / 0.3), 0.0), 1.0)

    def look(talk: Conversation, cycle: int) -> None:
        if cycle % 18 == 12:  # every 450 ms, once in eight times while it is there
            talk.say(wck.command(7 << 5, 0xC9, bytes([2, 2])))
            talk.rest(0.3)
            talk.say(round(200 + 700 * path(2, talk.now_s)).to_bytes(2, "big"))
            talk.rest(1)

    d = robot("wck", 20, path=path, before=look).diagnosed()
    assert "position-jumps" not in codes(d)
    assert not d.incidents()


def test_each_goal_that_jumps_and_comes_back_is_one_and_is_shown_itself() -> None:
    """One of them at the end of a quarter second, so that its way back is in the next one."""
    talk, jumps = Conversation("mightyzap"), []
    for k in range(1600):
        talk.until(k / 100)
        if k % 300 == 224:
            jumps.append(sum(len(chunk.data) for chunk in talk.chunks))
            talk.send(1, 0.0)
        else:
            talk.send(1, swinging(1, talk.now_s))
        talk.read(1, swinging(1, talk.now_s))
    (told,) = (f for f in found(talk.diagnosed()) if f.code == "goal-jump")
    assert told.count == len(jumps)
    assert [place.offset for place in told.places] == jumps[:3]
