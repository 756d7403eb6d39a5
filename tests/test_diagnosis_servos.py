"""Faults of servos, from the bus to the verdict: one incident, the right cause, the right servo."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from sniffer.diagnosis.acting import SURE, next_of
from sniffer.diagnosis.rules import AREA_OF
from sniffer.diagnosis.rules.device.complaints import BY_CHANCE
from sniffer.diagnosis.weighing import explain
from sniffer.simulation.buses import BUSES, simulate
from tests.conversations import Conversation, robot, swinging
from tests.diagnosed import chunks_of, codes, diagnosed, found, verdicts
from tests.lists import each_in_turn, in_turn
from tests.servos import BEGAN_NS, finding, suffering
from tests.streams import mightyzap, rs30x

if TYPE_CHECKING:
    from collections.abc import Callable

    from sniffer.diagnosis import Diagnosis

WITHIN = {"mightyzap": 1, "lss": 2, "wck": 1, "rs30x": 1}

BROWNOUT = "brownout:{}:100%@3s+0.05s"

FAULTS = [
    ("brownout", BROWNOUT, ("mightyzap", "lss", "wck", "rs30x")),
    ("servo-reset-loop", "reset-loop:{}@2s", ("mightyzap", "rs30x")),
    ("servo-dead", "dead:{}@6s", ("mightyzap", "wck")),
    ("servo-absent", "absent:{}", ("mightyzap", "wck")),
    ("slow-servo", "slow:{}", ("mightyzap", "lss", "wck", "rs30x")),
    ("torque-off", "limp:{}@2s", ("mightyzap", "lss", "wck", "rs30x")),
    ("stall", "stall:{}@3s+4s", ("mightyzap", "lss", "wck", "rs30x")),
    ("overload", "overload:{}@2s", ("mightyzap", "lss", "rs30x")),
    ("overheat", "overheat:{}@0.5s", ("mightyzap", "rs30x")),
    ("servo-refuses", "refuse:{}", ("mightyzap", "rs30x")),
    ("chatty-device", "chatty:{}:4%", ("mightyzap", "lss", "wck", "rs30x")),
]

LONG = {"overheat": 16.0}
"""What takes its time; all else shows within ten seconds."""

CASES = [
    pytest.param(cause, protocol, fault.format(WITHIN[protocol]), id=f"{cause}-{protocol}")
    for cause, fault, protocols in FAULTS
    for protocol in protocols
]

DEVICE = [code for code, area in AREA_OF.items() if area == "device"]


@in_turn(2)
@pytest.mark.parametrize(("cause", "protocol", "fault"), CASES)
def test_a_fault_of_a_servo_is_one_incident_with_its_cause_first(
    cause: str, protocol: str, fault: str
) -> None:
    incidents = suffering(protocol, fault, LONG.get(cause, 10.0)).incidents()
    assert verdicts(incidents) == [(cause, (WITHIN[protocol],))]


@each_in_turn(2, "protocol", BUSES)
def test_sound_servos_show_nothing_that_a_faulty_one_would(protocol: str) -> None:
    assert not codes(suffering(protocol, seconds=10.0)) & set(DEVICE)


SHOWS = [
    ("voltage-sag", "mightyzap", BROWNOUT),
    ("device-input-voltage", "mightyzap", BROWNOUT),
    ("away-for-a-while", "rs30x", BROWNOUT),
    ("device-safe-mode", "lss", BROWNOUT),
    ("away-again-and-again", "mightyzap", "reset-loop:{}@2s"),
    ("misses-now-and-then", "lss", "reset-loop:{}@2s"),
    ("back-at-defaults", "rs30x", "reset-loop:{}@2s"),
    ("torque-gone", "rs30x", "reset-loop:{}@2s"),
    ("supply-steady", "mightyzap", "reset-loop:{}@2s"),
    ("silent-since", "wck", "dead:{}@6s"),
    ("never-answered", "wck", "absent:{}"),
    ("slower-than-peers", "wck", "slow:{}"),
    ("joint-limp", "wck", "limp:{}@2s"),
    ("limp-by-status", "lss", "limp:{}@2s"),
    ("joint-stalled", "rs30x", "stall:{}@3s+4s"),
    ("device-blocked", "lss", "stall:{}@3s+4s"),
    ("stuck-before-alarm", "mightyzap", "stall:{}@3s+4s"),
    ("joint-limp-after-alarm", "mightyzap", "stall:{}@3s+4s"),
    ("load-high", "rs30x", "overload:{}@2s"),
    ("device-overload", "mightyzap", "overload:{}@2s"),
    ("temperature-high", "rs30x", "overheat:{}@0.5s"),
    ("temperature-rising", "mightyzap", "overheat:{}@0.5s"),
    ("refuses-command", "mightyzap", "refuse:{}"),
    ("refuses-torque", "rs30x", "refuse:{}"),
    ("goals-without-torque", "rs30x", "refuse:{}"),
    ("speaks-unasked", "wck", "chatty:{}:4%"),
]


@pytest.mark.parametrize(("code", "protocol", "fault"), SHOWS)
def test_what_a_faulty_servo_shows_is_found(code: str, protocol: str, fault: str) -> None:
    seconds = LONG.get(fault.split(":")[0], 10.0)
    assert code in codes(suffering(protocol, fault.format(WITHIN[protocol]), seconds))


def test_a_joint_that_gets_up_to_speed_is_not_stuck() -> None:
    frames = simulate("mightyzap", seed=5, servo_ids=range(1, 13), duration_s=12, start_ns=BEGAN_NS)
    it = diagnosed(chunks_of(frames), "mightyzap")
    assert finding(it, "device-overload") is not None
    assert finding(it, "stuck-before-alarm") is None


@each_in_turn(
    2,
    ("protocol", "register"),
    [
        ("mightyzap", "(Register `force_on`, address 0x80.)"),
        ("rs30x", "(Register `torque_enable`, address 0x24.)"),
        ("lss", ""),
        ("wck", ""),
    ],
)
def test_what_to_do_next_names_the_register_as_this_bus_has_it(
    protocol: str, register: str
) -> None:
    """A servo that is switched by commands has none."""
    (incident,) = suffering(protocol, "limp:1@2s").incidents()
    assert incident.cause == "torque-off"
    assert incident.next.endswith(register)
    assert bool(register) == ("Register" in incident.next)


def test_the_story_of_a_brownout_goes_from_the_sag_over_the_alarm_to_the_silence() -> None:
    (incident,) = suffering("mightyzap", BROWNOUT.format(1), 10.0).incidents()
    story = incident.story
    steps = ("supply of servo 1 sags", "complains of its supply", "servo 1 silent for")
    places = [story.index(step) for step in steps]
    assert places == sorted(places), story


def test_the_story_of_a_blocked_joint_goes_from_its_push_to_letting_go_each_told_once() -> None:
    (incident,) = suffering("mightyzap", "stall:1@3s+4s", 10.0).incidents()
    steps = ("pushes and does not move", "is stuck", "reports an overload", "lets go")
    places = [incident.story.index(step) for step in steps]
    assert places == sorted(places), incident.story
    told = [f.what for f in incident.findings]
    assert len(set(told)) == len(told)
    pushed = next(f for f in incident.findings if f.code == "joint-stalled")
    assert "load 100%" in pushed.what


def with_factory_id(
    path: Callable[[int, float], float], *, dies: float = 9.0, under: int = 0, twice: bool = False
) -> Diagnosis:
    """Return the diagnosis of servos 0 and 1 and of a broadcast each cycle.

    ``path`` is where they are, ``dies`` is when 0 falls silent, ``under`` the id under which it
    answers; ``twice``: two of that id do, some bits apart.
    """
    talk = Conversation("mightyzap")
    both = mightyzap.packet(0xFE, 0x73, bytes((0x82, 1, 0, 4, 1, 4)))
    for cycle in range(320):
        talk.until(cycle / 40)
        talk.write(both)
        for servo in (0, 1):
            talk.send(servo, swinging(servo, talk.now_s))
            if servo == 0 and talk.now_s > dies:
                talk.ask_in_vain(0, 5)
                continue
            talk.say(talk.tongue.ask(servo))
            talk.rest(0.3)
            data = round(path(servo, talk.now_s) * 4095).to_bytes(2, "little")
            talk.say(mightyzap.packet(servo or under, 0, data))
            if servo == 0 and twice:
                talk.say(mightyzap.packet(0, 0, (700).to_bytes(2, "little")))
            talk.rest(0.4)
    return talk.diagnosed()


def test_a_servo_with_the_id_of_the_factory_that_reaches_all_is_a_servo_like_others() -> None:
    sound = with_factory_id(swinging)
    assert not sound.incidents()
    assert [case.servos for case in sound.cases()] == [(0, 1)]
    dead = with_factory_id(swinging, dies=4.0)
    assert verdicts(dead.incidents()) == [("servo-dead", (0,))]
    stands = with_factory_id(lambda servo, s: swinging(servo, s) if servo else 0.5)
    assert [i.servo_ids for i in stands.incidents()] == [(0,)]
    assert "joint-not-following" in codes(stands)
    swapped = with_factory_id(swinging, twice=True)
    assert ("duplicate-id", (0,)) in verdicts(swapped.incidents())


def test_an_id_that_reaches_all_and_that_nobody_answers_under_is_no_servo() -> None:
    alone = with_factory_id(swinging, under=7)
    assert [case.servos for case in alone.cases()] == [(1, 7)]
    assert not alone.incidents()


def test_answers_to_writes_of_which_most_are_torn_are_not_said_unasked() -> None:
    whole = mightyzap.packet(2, 0)

    def writes(talk: Conversation, cycle: int) -> None:
        talk.say(talk.tongue.goal(2, swinging(2, talk.now_s)))
        talk.rest(0.3)
        talk.say(whole if cycle % 6 == 0 else bytes((whole[0] & 0xFE, *whole[1:5], 0x20)))
        talk.rest(0.4)

    talk = robot("mightyzap", servos=(1, 2), goals=False, behind=writes)
    assert "speaks-unasked" not in codes(talk.diagnosed())


@pytest.mark.parametrize(
    ("torn_each", "each", "times", "strength"),
    [(3, 30, 16, BY_CHANCE), (60, 1000, 1, BY_CHANCE), (1000, 1000, 1, 0.8)],
)
def test_an_alarm_that_two_senders_make_of_each_others_frames_is_no_servos(
    torn_each: int, each: int, times: int, strength: float
) -> None:
    """F2 and 8C of a read, each with its highest bit fallen, are an answer with four alarms."""

    def beside(talk: Conversation, cycle: int) -> None:
        if cycle % torn_each == 0:
            talk.say(mightyzap.packet(1, 0xF2, b"\x8c\x02")[:-1])  # torn elsewhere, too
        if cycle % each == 4:
            talk.say(mightyzap.packet(2, 0x72, b"\x0c\x02"))
        talk.rest(5)

    told = found(robot("mightyzap", 12, behind=beside).diagnosed())
    (overload,) = (f for f in told if f.code == "device-overload")
    assert (overload.count, overload.strength) == (times, strength)


def test_of_a_cause_that_is_not_sure_what_settles_it_comes_next_also_where_it_is_alone() -> None:
    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != 2 or not any(begun <= cycle < begun + 8 for begun in (100, 130, 300)):
            return False
        talk.ask_in_vain(servo, 5)
        return True

    diagnosis = robot("mightyzap", 10, instead=instead, goals=False).diagnosed()
    (explained,) = explain(found(diagnosis))
    first = explained.causes[0]
    assert (first.cause, first.confidence < SURE) == ("servo-reset-loop", True)
    for one in (explained, replace(explained, causes=(first,))):
        told = next_of(diagnosis.cases()[0], one)
        assert told.startswith("Feed it from a supply of its own")
        assert ("instead" in told) == (one is explained)


@pytest.mark.parametrize(("gone", "asks"), [((1, 2, 3), "all of them share"), ((2,), "its power")])
def test_where_all_fall_silent_at_once_what_they_share_is_to_be_looked_at(
    gone: tuple[int, ...], asks: str
) -> None:
    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if cycle < 200 or servo not in gone:
            return False
        talk.ask_in_vain(servo, 5)
        return True

    (incident,) = robot("mightyzap", 10, instead=instead, goals=False).diagnosed().incidents()
    assert (incident.cause, incident.servo_ids) == ("servo-dead", gone)
    assert asks in incident.next


def becomes_1(talk: Conversation, cycle: int) -> None:
    """Write to the id where futaba_RS405CB means its reverse mode: servo 2 becomes servo 1."""
    if cycle == 8:
        talk.write(rs30x.write(2, 0x04, b"\1"))


@pytest.mark.parametrize("gap_ms", [0.1, 8.0])
def test_an_id_that_another_servo_has_is_told_with_the_frame_that_gave_it(gap_ms: float) -> None:
    def both(talk: Conversation, cycle: int, servo: int) -> bool:
        if cycle < 8 or servo == 3:
            return False
        if servo == 2:
            talk.ask_in_vain(2)
        else:
            talk.read(1, 0.5)
            talk.rest(gap_ms)
            talk.say(talk.tongue.answer(1, 0.3))
            talk.rest(1)
        return True

    d = robot("rs30x", 1.5, rate_hz=20, before=becomes_1, instead=both).diagnosed()
    assert verdicts(d.incidents()) == [("duplicate-id", (1,))]
    told = finding(d, "id-given-twice")
    assert told is not None
    assert told.what.startswith("servo 2 was given the id 1 at 0.4")


@pytest.mark.parametrize("torn", [True, False])
def test_an_id_is_given_twice_where_its_answers_lie_over_each_other_since(*, torn: bool) -> None:
    def over(talk: Conversation, cycle: int, servo: int) -> bool:
        if cycle < 8 or servo == 3:
            return False
        if servo == 2:
            talk.ask_in_vain(2)
            return True
        if not torn and cycle % 4:  # noise tears one now and then
            return False
        talk.say(talk.tongue.ask(1))
        talk.rest(0.3)
        two = zip(talk.tongue.answer(1, 0.5), b"\xff" + talk.tongue.answer(1, 0.3), strict=False)
        talk.say(bytes(a & b for a, b in two))
        talk.rest(1)
        return True

    d = robot("rs30x", 1.5, rate_hz=20, before=becomes_1, instead=over).diagnosed()
    assert (finding(d, "id-given-twice") is not None) == torn
    assert (verdicts(d.incidents()) == [("duplicate-id", (1,))]) == torn


def test_an_id_that_nobody_has_is_given_once() -> None:
    def begin(talk: Conversation, cycle: int) -> None:
        if cycle == 8:
            talk.write(rs30x.write(4, 0x04, b"\1"))

    d = robot("rs30x", 1.5, rate_hz=20, servos=(1, 2), before=begin).diagnosed()
    assert finding(d, "id-given-twice") is None


@pytest.mark.parametrize("protocol", ["rs30x", "lss"])
def test_a_servo_that_falters_before_it_is_silent_for_good_is_gone(protocol: str) -> None:
    """Its oscillator warms: its answers fail at first now and then; all else goes on."""

    def fails(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != 2 or (cycle < 125 and cycle not in (101, 105, 106, 111, 118)):
            return False
        talk.ask_in_vain(2, 8)
        return True

    d = robot(protocol, 6, instead=fails, goals=False).diagnosed()
    assert verdicts(d.incidents()) == [("servo-dead", (2,))]
    told = finding(d, "misses-now-and-then")
    assert told is not None
    assert told.count <= 6
