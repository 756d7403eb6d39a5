"""Sessions with phases: what is switched off on purpose, waits or is moved by hand is no fault."""

from __future__ import annotations

import math
import random
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from sniffer.diagnosis.evidence.paces import is_of_slower_loop
from sniffer.diagnosis.ledger.buckets import BUCKET_NS
from sniffer.diagnosis.ledger.exchanges import Pause
from sniffer.ground.model import MS, Direction
from tests.conversations import Conversation, robot, swinging, through_usb
from tests.diagnosed import codes, verdicts
from tests.lists import each_in_turn
from tests.streams import mightyzap, rs30x, wck

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.diagnosis import Diagnosis

TEACHES_S = 8


def taught(protocol: str, *, left_off: tuple[int, ...] = ()) -> Diagnosis:
    """Move two joints, let all go, move them by hand, switch each on again; all that twice."""
    talk = Conversation(protocol)

    def torque(servo: int, on: int) -> bytes:
        if protocol == "mightyzap":
            return mightyzap.packet(servo or 254, 0xF3, bytes((0x80, on)))
        return rs30x.write(servo or 255, 0x24, bytes((on,)))

    for session in range(2):
        begin = talk.now_s
        for servo in (1, 2):
            if not session or servo not in left_off:
                talk.write(torque(servo, 1))
        hung = {servo: swinging(servo, 0) for servo in left_off if session}
        for cycle in range(20 * TEACHES_S):
            talk.until(begin + cycle / 20)
            for servo in (1, 2):
                talk.send(servo, swinging(servo, talk.now_s - begin))
                talk.read(servo, hung.get(servo, swinging(servo, talk.now_s - begin)))
        talk.write(torque(0, 0))
        for cycle in range(20 * TEACHES_S):
            talk.until(begin + TEACHES_S + cycle / 20)
            for servo in (1, 2):
                held = 0.1 + min(0.1, 0.02 * (talk.now_s - begin - TEACHES_S))
                talk.read(servo, hung.get(servo, held))
    return talk.diagnosed()


@pytest.mark.parametrize("protocol", ["mightyzap", "rs30x"])
def test_joints_that_all_are_let_go_at_once_and_moved_by_hand_miss_no_goal(protocol: str) -> None:
    """The second time, too: each was switched on by itself, and is off again with all others."""
    assert not taught(protocol).incidents()


@pytest.mark.parametrize("protocol", ["mightyzap", "rs30x"])
def test_the_joint_that_is_not_switched_on_again_behind_it_is_named(protocol: str) -> None:
    assert verdicts(taught(protocol, left_off=(2,)).incidents()) == [("torque-off", (2,))]


@pytest.mark.parametrize(("protocol", "tap"), [("lss", "exact"), ("wck", "16 ms")])
def test_who_homes_one_joint_after_the_other_and_rests_behind_each_stops_no_loop(
    protocol: str, tap: str
) -> None:
    """Nor does who looks once a second at many, and takes longer for that than a cycle has."""
    servos = (1, 2, 3, 5, 6, 7)
    talk = Conversation(protocol)
    for servo in servos:
        for step in range(20):
            talk.send(servo, 0.5 + step / 100)
            talk.read(servo, 0.5 + step / 100)
            talk.rest(30)
        talk.send(servo, 0.6)
        talk.rest(300)
        talk.read(servo, 0.6)
    for rate, seconds in ((20, 7), (1, 7), (20, 7)):
        begin = talk.now_s
        for cycle in range(rate * seconds):
            talk.until(begin + cycle / rate)
            for servo in servos:
                if rate > 1:
                    talk.send(servo, swinging(servo, talk.now_s))
                talk.read(servo, swinging(servo, talk.now_s))
                talk.rest(2 if rate > 1 else 15)
    heard = through_usb(talk.chunks) if tap == "16 ms" else None
    assert "loop-stalls" not in codes(talk.diagnosed(heard))


def test_a_loop_that_stops_here_and_there_stands_still_though_each_time_as_long() -> None:
    def stops(talk: Conversation, cycle: int, servo: int) -> bool:
        if (cycle, servo) in {(60, 2), (150, 1), (220, 3), (300, 3)}:
            talk.rest(300)
        return False

    told = robot("mightyzap", 12, instead=stops).diagnosed()
    assert verdicts(told.incidents()) == [("controller-stall", ())]


@pytest.mark.parametrize("protocol", ["lss", "wck"])
@pytest.mark.parametrize(("away_s", "told"), [(20, "servo-dead"), (0.6, "brownout")])
def test_a_servo_that_comes_back_only_when_it_is_switched_off_and_on_had_stopped_answering(
    protocol: str, away_s: float, told: str
) -> None:
    """A supply that sags, and a servo that starts anew, are back in seconds."""

    def hangs(talk: Conversation, cycle: int, servo: int) -> bool:
        is_away = servo == 2 and 5 <= cycle / 5 < 5 + away_s
        if is_away:
            talk.ask_in_vain(servo, 30)
        return is_away

    talk = robot(protocol, 32, rate_hz=5, instead=hangs, goals=False)
    assert verdicts(talk.diagnosed().incidents()) == [(told, (2,))]


def test_an_id_that_is_taken_with_the_next_start_only_was_changed_all_the_same() -> None:
    """A servo of LSS answers by its old id until then."""

    def given(talk: Conversation, cycle: int) -> None:
        if cycle == 20:
            talk.write(b"#2CID9\r")

    def restarted(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo == 2 and cycle >= 60:
            talk.ask_in_vain(servo)
        return servo == 2 and cycle >= 60

    told = robot("lss", 12, rate_hz=10, before=given, instead=restarted).diagnosed()
    assert verdicts(told.incidents()) == [("id-changed", (2,))]


@pytest.mark.parametrize(("first", "is_twin"), [(b"\x0c", True), (b"\xf0", False)])
def test_bytes_behind_the_bare_answers_of_one_servo_alone_are_a_second_answer(
    first: bytes, *, is_twin: bool
) -> None:
    """But for those that a pulse before each answer pushes out of it."""
    rng = random.Random(5)

    def third(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo == 2 and cycle > 80:
            talk.rest(rng.uniform(0, 2))
            talk.say(talk.tongue.ask(servo))
            talk.rest(0.3)
            talk.say(first + talk.tongue.answer(servo, swinging(servo, talk.now_s)))
            talk.rest(0.4)
        return servo == 2 and cycle > 80

    told = robot("wck", 10, instead=third, goals=False).diagnosed()
    causes = {one.cause for one in told.incidents()}
    assert ("duplicate-id" in causes) == is_twin
    assert ("turnaround" in causes) != is_twin


def test_who_is_sent_back_from_where_it_sank_has_its_time_from_then_on() -> None:
    """The goal it had before its motor was let go is none of the time between."""
    talk = Conversation("wck")

    def moves(place: float, at: float) -> None:
        talk.say(talk.tongue.goal(2, place))
        talk.rest(0.3)
        talk.say(talk.tongue.answer(2, at))
        talk.rest(40)

    for session in range(2):
        begin = talk.now_s
        while talk.now_s < begin + 8:
            place = 0.5 + 0.3 * math.sin(1.7 * (talk.now_s - begin))
            moves(place, 0.1 if session and talk.now_s == begin else place)
            talk.rest(500 if talk.now_s < begin + 0.1 else 0)
        talk.say(wck.command(6 << 5 | 2, 0x10))
        talk.say(bytes((0x10, 26)))
        for _ in range(60):
            talk.rest(100)
            talk.read(2, 0.1)
    assert not talk.diagnosed().incidents()


def test_the_last_rest_of_a_slower_gait_is_as_long_as_those_before_it() -> None:
    """A cycle of many servos lies across quarter seconds: half of them have no rest of it."""
    rests = np.array([395, 7] * 8 + [392] + [188, 187, 7, 190] * 8) * MS
    line = {"bucket": np.arange(len(rests)), "pause_max": rests}
    last = Pause(392 * MS, 16 * BUCKET_NS - 200 * MS, 0, 0, 0)
    case: Any = SimpleNamespace(line=line, latency_ns=0)
    assert is_of_slower_loop(case, last)
    assert not is_of_slower_loop(case, last._replace(t_ns=40 * BUCKET_NS))


def _loose(protocol: str, opens: Sequence[tuple[float, float, bool]]) -> Conversation:
    """Return how a contact of servo 2 opens, now and then in an answer, where it is asked often."""
    talk = Conversation(protocol)
    for begin, rate, end in ((0, 1, 60), (60, 10, 100), (100, 1, 130)):
        for cycle in range(rate * (end - begin)):
            talk.until(begin + cycle / rate)
            for servo in (1, 2, 3):
                place = swinging(servo, talk.now_s)
                into = [(talk.now_s - a, torn) for a, b, torn in opens if a <= talk.now_s < b]
                if servo != 2 or not into:
                    talk.read(servo, place)
                elif into[0][0] < 0.1 and into[0][1]:
                    talk.say(talk.tongue.ask(servo), Direction.TX)
                    talk.rest(0.3)
                    talk.say(talk.tongue.answer(servo, place)[:-1], Direction.RX)
                    talk.rest(25)
                else:
                    talk.ask_in_vain(servo)
    return talk


@each_in_turn(2, "protocol", ["mightyzap", "rs30x"])
def test_a_contact_that_is_loose_for_seconds_of_a_run_is_no_clock(protocol: str) -> None:
    """It is asked seldom in the rest of the run, and often in a gait: it answers between."""
    opens = ((80.0, 80.3), (80.65, 81.15), (81.35, 81.6), (82.05, 82.45), (82.65, 83.05))
    talk = _loose(protocol, [(a, b, True) for a, b in opens])
    assert verdicts(talk.diagnosed().incidents()) == [("bad-cable", (2,))]


@pytest.mark.parametrize(
    "opens",
    [
        ((80.0, 80.4, True), (80.7, 81.0, False), (81.25, 81.7, True)),
        (
            (80, 80.4, True),
            (80.7, 80.9, False),
            (81.3, 81.7, True),
            (82, 82.2, False),
            (82.6, 83, True),
        ),
    ],
    ids=["three times", "for about as long"],
)
def test_a_contact_that_opens_a_few_times_is_no_restart_where_answers_are_torn(
    opens: Sequence[tuple[float, float, bool]],
) -> None:
    told = _loose("lss", opens).diagnosed().incidents()
    assert verdicts(told) == [("bad-cable", (2,))]
