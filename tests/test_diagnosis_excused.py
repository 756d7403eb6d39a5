"""What nobody can answer is no lost answer: servos that start anew, ids that were given away."""

from __future__ import annotations

import random
import re

import pytest

from tests.conversations import Conversation, robot, without_clock
from tests.diagnosed import codes, diagnosed, found, verdicts
from tests.lists import each_in_turn, in_turn
from tests.streams import mightyzap, rs30x

ID_AT, SHORT_LIMIT_AT = 0x03, 0x06
"""Addresses of mightyZAP."""

SILENT = {"silent-since", "away-for-a-while", "away-again-and-again"}


def restart(protocol: str, servo: int) -> bytes:
    if protocol == "mightyzap":
        return mightyzap.packet(servo, 0xF8)
    if protocol == "rs30x":
        return rs30x.packet(servo, 0x20, 0xFF)
    return b"#%dRESET\r" % servo


def ask_for_id(talk: Conversation, servo: int) -> None:
    """Ask for a servo's id register where the protocol has one: what a search asks."""
    talk.say(mightyzap.packet(servo, 0xF2, bytes([ID_AT, 1])))
    talk.rest(0.3)
    talk.say(mightyzap.packet(servo, 0, bytes([servo])))
    talk.rest(1)


@each_in_turn(3, "protocol", ["mightyzap", "rs30x", "lss"])
def test_a_servo_that_is_told_to_start_anew_may_be_asked_until_it_has(protocol: str) -> None:
    def starts(talk: Conversation, cycle: int, servo: int) -> bool:
        if cycle % 100 != 50 or servo != 2:
            return False
        talk.write(restart(protocol, servo))
        for _ in range(8):
            talk.ask_in_vain(servo, 50)
        return False

    told = robot(protocol, 16, instead=starts).diagnosed()
    assert not told.incidents()
    assert not told.rest(()).told


@pytest.mark.parametrize("protocol", ["mightyzap", "lss"])
def test_one_that_does_not_come_back_from_its_start_is_missed(protocol: str) -> None:
    def starts(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != 2 or cycle < 200:
            return False
        if cycle == 200:
            talk.write(restart(protocol, servo))
        talk.ask_in_vain(servo, 10)
        return True

    told = robot(protocol, 20, rate_hz=20, instead=starts).diagnosed().incidents()
    assert [who for _, who in verdicts(told)] == [(2,)]


@in_turn(2)
@pytest.mark.parametrize("group", [5, 512])
@pytest.mark.parametrize("protocol", ["mightyzap", "lss"])
def test_one_that_takes_too_long_to_start_is_away_from_the_order_on(
    protocol: str, group: int
) -> None:
    """What was excused as long as it might start counts, also what was heard long ago."""

    def starts(talk: Conversation, cycle: int, servo: int) -> bool:
        if cycle % 100 < 50 or servo != 2:
            return False
        if cycle % 100 == 50:
            talk.write(restart(protocol, servo))
        talk.ask_in_vain(servo, 20)
        return True

    talk = robot(protocol, 45, rate_hz=10, instead=starts, goals=False)
    told = diagnosed(talk.chunks, protocol, group, baud=talk.baud)
    (incident,) = told.incidents()
    assert verdicts([incident]) == [("servo-reset-loop", (2,))]
    away = {f.code: f for f in incident.findings}
    times = away["start-takes-long"].count
    assert away["no-response"].count == 50 * times == 200
    assert "5.0 s behind that at most" in away["start-takes-long"].what
    assert away["away-for-a-while"].what.endswith(
        "(50 requests in a row), since it was told to start anew"
    )


def test_a_start_that_was_ordered_does_not_make_outages_even() -> None:
    """Answers are lost by chance, and the servo is told to start anew each time.

    While it starts it cannot leave again: how long it was there counts from its return.
    """
    rng = random.Random(5)

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != 2 or cycle < 10 or rng.random() > 0.03:
            return False
        talk.ask_in_vain(servo)
        talk.say(restart("mightyzap", servo))
        talk.rest(0.3)
        talk.say(mightyzap.packet(servo, 0, b""))
        talk.rest(0.4)
        for _ in range(20):
            talk.ask_in_vain(servo, 50)
        return True

    told = robot("mightyzap", 60, rate_hz=50, instead=instead).diagnosed()
    assert "outages-evenly" not in codes(told)
    (what,) = (f.what for f in found(told) if f.code == "started-when-missing")
    n = what.split()[1]
    assert f"behind {n} of {n} requests that servo 2 leaves without an answer" in what


def plugged_in(vain: int, servos: int, *, then: int = 0) -> Conversation:
    """Give servos that are plugged in one after the other, each as 0, an id each.

    Until the next one is there 0 is asked ``vain`` times, behind the last one ``then`` times.
    """
    talk = Conversation("mightyzap")
    for servo in range(1, servos + 1):
        ask_for_id(talk, 0)
        talk.write(mightyzap.packet(0, 0xF3, bytes([ID_AT, servo])))
        for _ in range(3):
            ask_for_id(talk, servo)
        for _ in range(vain if servo < servos else then):
            talk.say(mightyzap.packet(0, 0xF2, bytes([ID_AT, 1])))
            talk.rest(100)
    for _ in range(20):
        for servo in range(1, servos + 1):
            talk.read(servo, 0.5)
    return talk


@pytest.mark.parametrize("then", [0, 1])
def test_servos_that_get_ids_one_after_the_other_are_not_one_that_starts_anew(then: int) -> None:
    """Nor is a memory written in a loop, nor is who looks whether 0 is gone left without answer."""
    told = plugged_in(40, 6, then=then).diagnosed()
    assert not told.incidents()
    assert not told.rest(()).told


def test_one_that_takes_its_new_id_with_the_next_start_is_gone_with_that() -> None:
    talk = Conversation("lss")
    for servo in (1, 2, 3):
        talk.read(0, 0.5)
        talk.write(b"#0CID%d\r" % servo)
        talk.read(0, 0.5)
        talk.write(b"#0RESET\r")
        talk.rest(1500)
        talk.read(servo, 0.5)
        for _ in range(40 if servo < 3 else 0):
            talk.ask_in_vain(0, 100)
    assert not talk.diagnosed().incidents()


def test_an_old_id_that_is_asked_on_and_on_counts_as_it_did() -> None:
    told = plugged_in(40, 3, then=60).diagnosed()
    (incident,) = told.incidents()
    assert verdicts([incident]) == [("id-changed", (0,))]
    counts = {f.code: f.count for f in incident.findings}
    assert counts["no-response"] == 60
    assert counts["both-ids-asked"] >= 55


def test_a_goal_is_not_held_against_a_limit_that_was_written_after_it() -> None:
    """Who calibrates drives to the ends first, and writes them down as limits."""
    talk = Conversation("mightyzap")

    def drive(begin: float, end: float) -> None:
        talk.send(1, end)
        for step in range(40):
            talk.read(1, begin + (end - begin) * min(step / 20, 1))
            talk.rest(20)

    drive(0.5, 0)
    talk.write(mightyzap.packet(1, 0xF3, bytes([SHORT_LIMIT_AT, 150, 0])))
    drive(0, 1)
    talk.write(mightyzap.packet(1, 0xF3, bytes([SHORT_LIMIT_AT + 2, 0x3C, 0x0F])))
    drive(1, 0.5)
    assert not talk.diagnosed().incidents()
    drive(0.5, 1)
    assert verdicts(talk.diagnosed().incidents()) == [("goal-out-of-range", (1,))]


@each_in_turn(4, "protocol", ["mightyzap", "rs30x", "lss", "wck"])
def test_servos_that_all_go_away_at_once_share_a_supply(protocol: str) -> None:
    def is_off(talk: Conversation, cycle: int, servo: int) -> bool:
        if cycle % 200 < 100 or cycle > 700:
            return False
        talk.ask_in_vain(servo, 5)
        return True

    told = robot(protocol, 40, rate_hz=20, instead=is_off, goals=False).diagnosed()
    (incident,) = told.incidents()
    assert incident.causes[0].cause in ("brownout", "bad-cable")
    assert "all-away-at-once" in codes(told)
    assert "servo-reset-loop" not in {c.cause for c in incident.causes if c.confidence > 0.2}


def test_without_a_clock_a_start_is_over_after_so_many_requests() -> None:
    """Bytes alone take far less than the seconds for which a servo may start."""

    def starts(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != 2 or cycle < 60:
            return False
        if cycle == 60:
            talk.write(b"#2CB9600\r")
            talk.write(restart("lss", servo))
        talk.ask_in_vain(servo, 10)
        return True

    talk = robot("lss", 8, rate_hz=20, instead=starts)
    told = talk.diagnosed(without_clock(talk.chunks)).incidents()
    assert verdicts(told) == [("baud-changed", (2,))]


def test_a_servo_that_writes_its_memory_is_deaf_meanwhile() -> None:
    """Source: protocols of clients of RS30x, which wait for a second behind a flash write."""

    def keeps(talk: Conversation, cycle: int, servo: int) -> bool:
        if cycle not in (50, 150) or servo != 2:
            return False
        talk.write(rs30x.write(servo, 0x08, b"\xdc\x05"))
        talk.write(rs30x.packet(servo, 0x40, 0xFF))
        for _ in range(8):
            talk.ask_in_vain(servo, 100)
        return False

    told = robot("rs30x", 16, instead=keeps).diagnosed()
    assert not told.incidents()
    assert not told.rest(()).told


def test_of_ids_that_are_given_away_and_back_the_last_order_counts() -> None:
    talk = Conversation("mightyzap")
    for _ in range(3):
        for _ in range(40):
            talk.read(4, 0.5)
        talk.write(mightyzap.packet(4, 0xF3, bytes([ID_AT, 9])))
        for _ in range(5):
            talk.read(9, 0.5)
        talk.write(mightyzap.packet(9, 0xF3, bytes([ID_AT, 4])))
    talk.write(mightyzap.packet(4, 0xF3, bytes([ID_AT, 9])))
    for _ in range(6):
        talk.read(9, 0.5)
        talk.ask_in_vain(4)
    told = [f for f in found(talk.diagnosed()) if f.code == "old-id-asked"]
    assert [(f.servo_id, f.count) for f in told] == [(4, 6)]


@pytest.mark.parametrize("comes_back", [True, False])
def test_without_a_clock_a_silence_is_told_in_requests(comes_back: bool) -> None:
    def away(talk: Conversation, cycle: int, servo: int) -> bool:
        is_away = cycle % 60 >= 50 if comes_back else cycle >= 200
        if servo == 2 and is_away:
            talk.ask_in_vain(servo, 5)
        return servo == 2 and is_away

    talk = robot("lss", 10, instead=away)
    for chunks, is_timed in ((talk.chunks, True), (without_clock(talk.chunks), False)):
        told = [f for f in found(talk.diagnosed(chunks)) if f.code in SILENT]
        assert told
        said = " ".join(f"{f.what}. {f.brief}." for f in told)
        assert "requests" in said
        assert bool(re.search(r"(for|in) [\d.]+ m?s\b", said)) == is_timed
