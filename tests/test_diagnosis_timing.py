"""Cycles, stalls and bus load: what is told of them, and what the stamps do not carry."""

from __future__ import annotations

import itertools
import math
import random
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from sniffer.ground.model import NS, Chunk, Clock, Mark, MarkKind, Severity
from tests.conversations import (
    BAUD,
    MS,
    TONGUES,
    Conversation,
    robot,
    swinging,
    through_usb,
    without_clock,
)
from tests.diagnosed import codes, diagnosed, found, verdicts
from tests.lists import each_in_turn
from tests.streams import mightyzap

if TYPE_CHECKING:
    from sniffer.diagnosis import Diagnosis

PROTOCOLS = tuple(TONGUES)


def stalling(protocol: str, ms: float = 200, every: int = 70) -> Conversation:
    return robot(
        protocol, 10, before=lambda talk, n: talk.rest(ms if n % every == every - 1 else 0)
    )


@each_in_turn(4, "protocol", PROTOCOLS)
def test_a_loop_that_stops_now_and_then_is_the_controllers_stall(protocol: str) -> None:
    incidents = stalling(protocol).diagnosed().incidents()
    assert verdicts(incidents) == [("controller-stall", ())]
    assert incidents[0].count == 5


def test_a_stall_is_told_through_a_host_that_is_late_by_less() -> None:
    talk = stalling("mightyzap", 300)
    assert "loop-stalls" in codes(talk.diagnosed(through_usb(talk.chunks)))


def test_a_stall_that_a_late_host_may_have_made_is_not_told() -> None:
    talk = stalling("mightyzap", 40)
    found = codes(talk.diagnosed(through_usb(talk.chunks)))
    assert "loop-stalls" not in found
    assert "coarse-stamps" in found


def test_without_a_clock_nothing_is_told_of_stalls() -> None:
    talk = stalling("rs30x")
    assert not talk.diagnosed(without_clock(talk.chunks)).incidents()


@each_in_turn(4, "protocol", PROTOCOLS)
def test_pauses_that_missing_answers_explain_are_no_stalls(protocol: str) -> None:
    def in_vain(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != 2 or cycle % 60:
            return False
        talk.ask_in_vain(2, 250)
        return True

    assert "loop-stalls" not in codes(robot(protocol, 10, instead=in_vain).diagnosed())


def test_a_person_who_stops_the_program_for_seconds_is_no_stall() -> None:
    talk = robot("lss", 10, before=lambda talk, n: talk.rest(3000 if n == 100 else 0))
    assert not talk.diagnosed().incidents()


@pytest.mark.parametrize(("times", "told"), [(3, False), (6, True)])
def test_rests_that_a_person_may_have_made_are_a_stall_if_they_are_never_long(
    times: int, told: bool
) -> None:
    rests = {60 + 70 * k: 700 + 150 * k for k in range(times)}
    talk = robot("mightyzap", 12 + times, before=lambda talk, n: talk.rest(rests.get(n, 0)))
    assert ("loop-stalls" in codes(talk.diagnosed())) == told


def test_a_program_that_rests_before_each_move_does_not_stall() -> None:
    rng = random.Random(3)
    talk = Conversation("mightyzap")
    for _ in range(40):
        place = rng.random()
        talk.send(1, place)
        for _ in range(rng.randint(8, 20)):
            talk.read(1, place)
            talk.rest(rng.uniform(18, 24))
        talk.rest(rng.uniform(100, 900))
    assert not talk.diagnosed().incidents()


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_program_that_rests_behind_each_look_at_its_servos_does_not_stall(protocol: str) -> None:
    talk = Conversation(protocol)
    for scene in range(7):
        for step in range(40):
            talk.send(1, (scene + step / 40) / 10)
            talk.rest(25)
        for servo in (1, 2, 3):
            talk.read(servo, scene / 10)
        talk.rest(1100)
    assert "loop-stalls" not in codes(talk.diagnosed())


def test_a_program_that_asks_until_it_is_there_and_rests_does_not_stall() -> None:
    """As examples of makers do; where the capture ends, the place is no other one."""
    rng = random.Random(3)
    talk = Conversation("mightyzap")
    for move in range(8):
        talk.send(1, move / 10)
        talk.rest(50)
        for step in range(steps := rng.randint(60, 400)):
            place = (move + step / steps) / 10
            talk.write(bytes.fromhex("FFFFFF0104F2960171"))
            talk.say(bytes.fromhex("FFFFFF01030001FA"))
            talk.read(1, place)
            talk.rest(4)
        talk.rest(200)
        talk.read(1, place)
        talk.rest(rng.uniform(1000, 5000) if move < 7 else 0)
    assert not talk.diagnosed().incidents()


def test_a_program_that_tells_all_it_knows_between_its_moves_does_not_stall() -> None:
    talk = Conversation("lss")
    for move in range(7):
        for servo in (1, 2, 3):
            talk.read(servo, move / 10)
            talk.write(f"#{servo}QV\r".encode())
            talk.say(f"*{servo}QV12000\r".encode())
            talk.rest(1)
        for step in range(40):
            for servo in (1, 2, 3):
                talk.read(servo, (move + step / 40) / 10)
            talk.rest(40)
        talk.rest(700)
    assert not talk.diagnosed().incidents()


def test_a_pause_in_which_the_tap_itself_was_late_is_no_stall() -> None:
    talk = stalling("mightyzap")
    late = [
        replace(chunk, marks=(Mark(MarkKind.HELD, 0, len(chunk.data), 200 * MS),))
        if (chunk.t_ns or 0) - (before.t_ns or 0) > 150 * MS
        else chunk
        for before, chunk in itertools.pairwise([talk.chunks[0], *talk.chunks])
    ]
    assert "loop-stalls" not in codes(talk.diagnosed(late))


def test_goals_that_come_while_a_person_moves_a_slider_are_no_uneven_loop() -> None:
    rng = random.Random(2)
    talk, place, moved = Conversation("lss"), 0.0, itertools.count()
    for _ in range(12):
        for _ in range(rng.randint(20, 80)):
            place = 0.5 + 0.4 * math.sin(next(moved) / 40)
            talk.send(1, place)
            talk.rest(rng.uniform(15, 45))
        for _ in range(rng.randint(5, 20)):
            for servo in (1, 2, 3):
                talk.read(servo, place)
            talk.rest(250)
    assert not talk.diagnosed().incidents()


def trembling(protocol: str, part: float, baud: int = BAUD, *, turns: int = 1) -> Conversation:
    """Let cycles begin late; with ``turns`` each servo is read in every second cycle or third."""
    rng = random.Random(5)
    most = part * 50

    def late(talk: Conversation, cycle: int) -> None:
        del cycle
        talk.rest(rng.uniform(0, most))

    def is_others_turn(talk: Conversation, cycle: int, servo: int) -> bool:
        del talk
        return (cycle + servo) % turns > 0

    return robot(protocol, 12, rate_hz=20, before=late, baud=baud, instead=is_others_turn)


@each_in_turn(4, "protocol", PROTOCOLS)
def test_a_loop_whose_cycles_differ_by_half_is_uneven(protocol: str) -> None:
    assert verdicts(trembling(protocol, 0.7).diagnosed().incidents()) == [("controller-jitter", ())]


@pytest.mark.parametrize("turns", [2, 3])
def test_an_uneven_loop_that_reads_servos_in_turn_is_told(turns: int) -> None:
    """Two cycles are as late as one, so what is asked in every second one seemed steadier."""
    told = trembling("lss", 0.7, turns=turns).diagnosed()
    assert verdicts(told.incidents()) == [("controller-jitter", ())]
    (jitter,) = (f for f in found(told) if f.code == "loop-jitters")
    assert jitter.value("middle_ns") == pytest.approx(50 * MS, rel=0.1)


@pytest.mark.parametrize(("part", "told"), [(0.7, True), (0.15, False)])
@pytest.mark.parametrize("protocol", ["mightyzap", "lss", "rs30x"])
def test_a_loop_that_ends_with_goals_that_nobody_answers_is_timed_like_any(
    protocol: str, part: float, told: bool
) -> None:
    """The rest of each cycle stands behind the goals: it seemed that the loop never rests."""
    rng = random.Random(5)

    def late(talk: Conversation, cycle: int) -> None:
        del cycle
        talk.rest(rng.uniform(0, 50 * part))

    def send(talk: Conversation, cycle: int) -> None:
        del cycle
        for servo in (1, 2, 3):
            talk.send(servo, swinging(servo, talk.now_s))

    talk = robot(protocol, 12, rate_hz=20, goals=False, before=late, behind=send)
    assert ("loop-jitters" in codes(talk.diagnosed())) == told


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_a_loop_that_sleeps_a_little_longer_or_shorter_is_sound(turns: int) -> None:
    assert not trembling("rs30x", 0.15, turns=turns).diagnosed().incidents()


def test_what_trembles_less_than_the_host_is_late_is_not_told() -> None:
    talk = trembling("mightyzap", 0.7)
    assert "loop-jitters" not in codes(talk.diagnosed(through_usb(talk.chunks)))


def timers(baud: int, every: dict[str, float], protocol: str = "lss") -> Conversation:
    """Let one program do several jobs, each every so many seconds, one at a time."""
    talk = Conversation(protocol, baud)
    due = {job: 0.006 * k for k, job in enumerate(every)}
    while talk.now_s < 10:
        job = min(due, key=lambda name: due[name])
        talk.until(due[job])
        for servo in range(1, 7):
            if job == "goals":
                talk.send(servo, swinging(servo, talk.now_s))
            else:
                talk.read(servo, swinging(servo, talk.now_s))
        due[job] = max(due[job] + every[job], talk.now_s)
    return talk


def unstated(talk: Conversation) -> Diagnosis:
    """Return the diagnosis of a log that has times to the millisecond, and no rate."""
    rows = [replace(c, clock=Clock.FILE, t_ns=(c.t_ns or 0) // MS * MS) for c in talk.chunks]
    return diagnosed(rows, talk.protocol)


def test_what_waits_until_the_program_has_done_another_job_makes_no_loop_uneven() -> None:
    told = timers(115200, {"goals": 0.0264, "reads": 0.0611, "looks": 0.0807}).diagnosed()
    assert "loop-jitters" not in codes(told)
    assert not told.incidents()


@pytest.mark.parametrize(
    ("protocol", "baud", "goals", "reads", "looks"),
    [("lss", 9600, 0.112, 0.236, 0.498), ("mightyzap", 19200, 0.172, 0.095, 0.735)],
)
def test_a_line_that_may_be_full_at_its_slowest_rate_has_no_uneven_loop(
    protocol: str, baud: int, goals: float, reads: float, looks: float
) -> None:
    talk = timers(baud, {"goals": goals, "reads": reads, "looks": looks}, protocol)
    assert not unstated(talk).incidents()


def test_an_uneven_loop_is_told_at_a_rate_that_nobody_stated() -> None:
    talk = trembling("lss", 0.7, 38400)
    assert verdicts(unstated(talk).incidents()) == [("controller-jitter", ())]


def test_a_request_that_is_made_twice_in_some_cycles_makes_no_loop_uneven() -> None:
    def twice(talk: Conversation, cycle: int) -> None:
        if cycle % 3 == 0:
            talk.read(1, 0.5)

    assert not robot("mightyzap", 8, behind=twice).diagnosed().incidents()


@pytest.mark.parametrize("protocol", ["mightyzap", "rs30x", "lss"])
def test_a_line_without_a_pause_is_full_and_only_a_note(protocol: str) -> None:
    talk = Conversation(protocol, 57600)
    for n in range(1500):
        servo = 1 + n % 5
        talk.say(talk.tongue.ask(servo))
        talk.rest(0.02)
        talk.say(talk.tongue.answer(servo, 0.5))
        talk.rest(0.02)
    (incident,) = talk.diagnosed().incidents()
    assert incident.cause == "bus-saturated"
    assert incident.severity is Severity.NOTE


def test_a_line_that_says_more_than_its_rate_carries_is_not_full_for_nobody_knows_the_rate() -> (
    None
):
    """An address has none that could be set: the usual one of the protocol was taken for it."""
    talk = Conversation("mightyzap", 115200)
    for n in range(3000):
        talk.read(1 + n % 5, 0.5)
        talk.rest(-0.6)
    assert "bus-full" not in codes(diagnosed(through_usb(talk.chunks), "mightyzap", baud=57600))


def test_a_line_that_is_busy_half_of_the_time_is_not_full() -> None:
    assert not robot("mightyzap", 6, rate_hz=60).diagnosed().incidents()


def test_a_clock_that_is_set_while_damage_is_heard_costs_no_memory() -> None:
    """A computer without a clock of its own begins in 1970 until the network tells it the time."""
    rng = random.Random(5)
    heard = []
    for n, chunk in enumerate(robot("mightyzap", 8).chunks):
        data = bytearray(chunk.data)
        if rng.random() < 0.02:
            data[rng.randrange(len(data))] ^= 0x10
        unset = chunk.t_ns if n < 300 else (chunk.t_ns or 0) + 1_790_000_000 * NS
        heard.append(replace(chunk, data=bytes(data), t_ns=unset))
    told = robot("mightyzap", 1).diagnosed(heard)
    assert told.incidents()


def test_a_line_that_falls_all_the_time_is_not_full() -> None:
    rng = random.Random(4)
    talk = robot("rs30x", 4)
    while talk.now_s < 14:
        talk.say(bytes([0xFF << rng.randrange(1, 8) & 0xFF]))
        talk.rest(rng.uniform(0, 0.02))
        if rng.random() < 0.005:
            talk.say(talk.tongue.ask(1))
    assert "bus-full" not in codes(talk.diagnosed())


@pytest.mark.parametrize(("protocol", "more_ms"), [("wck", 2.0), ("wck", 0.3), ("mightyzap", 4.0)])
def test_a_slow_servo_is_told_by_the_ends_of_answers_where_nobody_stated_the_rate(
    protocol: str, more_ms: float
) -> None:
    """Answers of one length take as long at any rate; when they began is unsure by all of that."""

    def slowly(talk: Conversation, cycle: int, servo: int) -> bool:
        del cycle
        place = swinging(servo, talk.now_s)
        talk.say(talk.tongue.ask(servo))
        talk.rest(0.3 + (more_ms if servo == 2 else 0.0))
        talk.say(talk.tongue.answer(servo, place))
        talk.rest(0.4)
        return True

    talk = robot(protocol, 10, rate_hz=20, baud=57600, instead=slowly)
    rows = [replace(c, clock=Clock.FILE, t_ns=(c.t_ns or 0) // 1000 * 1000) for c in talk.chunks]
    expected = [("slow-servo", (2,))] if more_ms > 1 else []
    assert verdicts(diagnosed(rows, protocol).incidents()) == expected


def test_text_lines_that_differ_in_length_make_no_servo_slow_where_the_rate_is_unsure() -> None:
    def places(servo: int, s: float) -> float:
        return 0.5 if servo == 1 else 0.04 + 0.02 * (int(s) % 2)  # *1QD0 and *2QD-864

    talk = robot("lss", 10, rate_hz=10, baud=9600, path=places)
    rows = [replace(c, clock=Clock.FILE, t_ns=(c.t_ns or 0) // 1000 * 1000) for c in talk.chunks]
    assert "slower-than-peers" not in codes(diagnosed(rows, "lss"))


@each_in_turn(4, "protocol", PROTOCOLS)
def test_a_host_that_is_late_with_one_answer_in_ten_makes_no_servo_slow(protocol: str) -> None:
    """A tenth of its answers is later than nine tenths of its peers', whoever it is."""
    rng = random.Random(2)
    talk = robot(protocol, 10, rate_hz=20, baud=57600)
    late: list[Chunk] = []
    for c in talk.chunks:
        held_ms = rng.uniform(5, 25) if rng.random() < 0.1 else 0.2
        stamp = (c.t_ns or 0) + int(held_ms * MS)
        late.append(
            replace(c, clock=Clock.READ, t_ns=max(stamp, late[-1].t_ns or 0) if late else stamp)
        )
    assert "slower-than-peers" not in codes(diagnosed(late, protocol, baud=57600, latency_ns=MS))


@pytest.mark.parametrize("address", [0x0E, 0x86])
def test_a_servo_that_answers_writes_of_its_memory_later_is_not_slow(address: int) -> None:
    """It answers when its memory is written; one that is as late with its goal is slow."""
    talk = Conversation("mightyzap")
    for _ in range(60):
        for servo in (1, 2, 3):
            for at in (0x86, *((address,) * (servo == 2))):
                talk.say(mightyzap.packet(servo, 0xF3, bytes([at, 0, 3])))
                talk.rest(5 if servo == 2 and at == address else 0.3)
                talk.say(mightyzap.packet(servo, 0))
                talk.rest(0.4)
        talk.rest(20)
    assert ("slower-than-peers" in codes(talk.diagnosed())) == (address == 0x86)
