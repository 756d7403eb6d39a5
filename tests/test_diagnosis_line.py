"""Faults of the line, bit by bit: what each finding is told of, and of what it is not."""

from __future__ import annotations

import functools
import random
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

import pytest

from bench.diagnosis import patterns
from bench.diagnosis.bodies import stays, steps
from bench.diagnosis.catalogue import scenarios
from bench.diagnosis.ear import tapped
from bench.diagnosis.hosts import HOSTS
from bench.diagnosis.making import Plan, bench_of, plan, program, second, talked
from bench.diagnosis.scenario import Scenario
from bench.diagnosis.troubles import (
    DriftingClock,
    EarlyRelease,
    HeldLine,
    LooseContact,
    MotorNoise,
    Noise,
    SlowEdges,
    StrayTurn,
    StuckLine,
)
from bench.diagnosis.uart import Clash, Receiver
from sniffer.diagnosis.rules import AREA_OF
from sniffer.diagnosis.rules.line import undriven, unknown
from sniffer.diagnosis.rules.pairing import collisions, outages
from tests import servos
from tests.conversations import Conversation, robot
from tests.crossing_rounds import two_rounds
from tests.diagnosed import codes, diagnosed, verdicts
from tests.interludes import torn_on_one_side, updated
from tests.lists import each_in_turn
from tests.test_diagnosis_by_supply import altered_answers
from tests.test_diagnosis_overlaid import answered_at_once, asked_at_once
from tests.test_diagnosis_shapes import without_blocks
from tests.test_diagnosis_worse import losing
from tests.test_sums import alone, longer

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from bench.diagnosis.bodies import Path
    from bench.diagnosis.line import Pattern, Trouble
    from bench.diagnosis.scenario import Heard
    from sniffer.diagnosis import Diagnosis

    Goals = Callable[[random.Random], Path]

S: Final = 4.0
ALWAYS: Final = ((0.0, 1e3),)
IDS: Final = (1, 2, 3)
CYCLE_MS: Final = 25
"""A cycle of `tests.conversations.robot`."""


def robot_of(protocol: str = "mightyzap", **fixed: Any) -> Plan:
    told: dict[str, Any] = {
        "seconds": (S, S),
        "ids": IDS,
        "baud": 115200,
        "gap_ns": (200_000, 900_000),
        "goals": "each",
        "reads": "state",
        "rate_hz": 25,
        "health_every": 0,
        "retries": 0,
    }
    return plan("line", protocol, 5, **(told | fixed))


def found(
    rows: Sequence[Heard], protocol: str = "mightyzap", baud: int = 115200, host: str = "exact"
) -> set[str]:
    capture = HOSTS[host](Scenario("line", protocol, (), baud, lambda _: rows), rows, 5)
    return codes(diagnosed(capture.chunks, protocol, baud=baud))


def suffering(*troubles: Trouble, it: Plan | None = None, goals: Goals | None = None) -> set[str]:
    it = it or robot_of()
    return found(tapped(talked(it, 5, bench_of(it, 5, goals, troubles=troubles))), it.protocol)


def twins(
    shift_ns: int, protocol: str, clash: Clash, seed: int = 5, baud: int = 115200
) -> set[str]:
    it = robot_of(protocol, goals="none", reads="position", baud=baud)
    bench = bench_of(it, seed, stays, twins=(2,), clash=clash)
    first, last = bench.delays[bench.bodies[2]]
    bench.delays[bench.shadows[2]] = (first + shift_ns, last + shift_ns)
    return found(tapped(talked(it, seed, bench)), protocol, baud)


def of_twins(who: int, shift_ns: int, seed: int, it: Plan) -> Diagnosis:
    """Diagnose a robot in motion in which two share an id, one later than the other."""
    bench = bench_of(it, seed, twins=(who,), clash=Clash.AND)
    first, last = bench.delays[bench.bodies[who]]
    bench.delays[bench.shadows[who]] = (first + shift_ns, last + shift_ns)
    rows = tapped(talked(it, seed, bench))
    heard = HOSTS["exact"](Scenario("line", it.protocol, (), it.baud, lambda _: rows), rows, seed)
    return diagnosed(heard.chunks, it.protocol, baud=it.baud)


def two_masters() -> set[str]:
    it = robot_of(seconds=(14, 14), rate_hz=20)
    bench = bench_of(it, 5, clash=Clash.MIX)

    def loop(hz: float, goals: str, reads: str) -> Pattern:
        return patterns.loop(bench, random.Random(hz), rate_hz=hz, goals=goals, reads=reads)

    other = second(loop(15.7, "none", "state"), (200_000, 900_000), 0.0)
    return found(tapped(talked(it, 5, bench, other, pattern=loop(20, "each", "state"))))


def two_of_one_period() -> set[str]:
    """Two controllers of the same rate, but that their clocks differ by half a percent."""
    it = robot_of(seconds=(12, 12))
    bench = bench_of(it, 5, clash=Clash.MIX)

    def loop(hz: float) -> Pattern:
        return patterns.loop(bench, random.Random(hz), rate_hz=hz, goals="none", reads="state")

    other = second(loop(20.1), (200_000, 900_000), 0.02)
    return found(tapped(talked(it, 5, bench, other, pattern=loop(20))))


def sparks_of_all() -> set[str]:
    """All motors step at once, and for a moment nearly nothing gets by."""
    path = steps(random.Random(1), 1.3)
    it = robot_of(seconds=(14, 14))
    return suffering(MotorNoise(ALWAYS, 1500), it=it, goals=lambda _: path)


def two_loops() -> set[str]:
    """One controller writes, the other reads: no request of both is the same."""
    it = robot_of(seconds=(14, 14))
    bench = bench_of(it, 5)

    def loop(hz: float, goals: str, reads: str) -> Pattern:
        return patterns.loop(bench, random.Random(hz), rate_hz=hz, goals=goals, reads=reads)

    other = second(loop(13.1, "each", "none"), (200_000, 900_000), 0.0)
    return found(tapped(talked(it, 5, bench, other, pattern=loop(20, "none", "state"))))


def as_other(protocol: str, factor: float = 1.0) -> set[str]:
    """A tap that listens at another rate than the line has, or for another protocol."""
    it = robot_of("rs30x", seconds=(2, 2))
    ear = Receiver(round(115200 * factor))
    return found(tapped(talked(it, 5, bench_of(it, 5)), ear), protocol, ear.baud)


def away(who: frozenset[int], spans_ms: Sequence[int]) -> set[str]:
    """Servos that answer nothing for some spans, again and again, while others do."""

    def in_vain(talk: Conversation, cycle: int, servo: int) -> bool:
        since = cycle % 100 * CYCLE_MS
        if servo not in who or cycle < 100 or since >= spans_ms[cycle // 100 % len(spans_ms)]:
            return False
        talk.ask_in_vain(servo)
        return True

    return codes(robot("mightyzap", 12, instead=in_vain).diagnosed())


def held_at(value: int) -> set[str]:
    """A line that is held at a level, of which a UART makes one value over and over."""

    def hold(talk: Conversation, cycle: int) -> None:
        if cycle % 20 == 10:
            talk.say(bytes((value,)) * 12)

    return codes(robot("mightyzap", 4, behind=hold).diagnosed())


def two_makes(known: str = "mightyzap+wck") -> set[str]:
    """Servos of two makes on one line, of which the tap knows both, or one."""
    it, theirs = robot_of(seconds=(3, 3)), robot_of("wck", seconds=(3, 3))
    guests = bench_of(theirs, 5)
    bench = bench_of(it, 5, also=[guests])
    rng = random.Random(5)
    turns = {"mightyzap": program(it, bench, rng), "wck": program(theirs, guests, rng)}
    rows = tapped(talked(it, 5, bench, pattern=patterns.in_turns(turns)))
    return found(rows, known)


ALL: Final = frozenset(
    {code for code, area in AREA_OF.items() if area == "line"}
    - {entry.code for entry in unknown.FINDINGS}  # `test_diagnosis_unknown_protocol` shows these
    - {entry.code for entry in undriven.FINDINGS}  # and `test_diagnosis_undriven` these
    | {entry.code for part in (collisions, outages) for entry in part.FINDINGS}
)


def drawn(name: str, draw: int) -> set[str]:
    """Return what is found in a conversation of the benchmark."""
    (scenario,) = scenarios(draw, name)
    capture = HOSTS["exact"](scenario, scenario.make(draw), draw)
    return codes(diagnosed(capture.chunks, scenario.protocol, baud=scenario.baud))


FAULTS: Final[Mapping[str, Callable[[], set[str]]]] = MappingProxyType(
    {
        "none": suffering,
        "noise": lambda: suffering(Noise(ALWAYS, 60)),
        "noise for long": lambda: suffering(
            Noise(ALWAYS, 40), it=robot_of(seconds=(8, 8), reads="position")
        ),
        "sparks": lambda: suffering(
            MotorNoise(ALWAYS, 1500), it=robot_of(seconds=(9, 9)), goals=lambda rng: steps(rng, 1.5)
        ),
        "late edges": lambda: suffering(SlowEdges(ALWAYS, 0.44)),
        "long lows": lambda: suffering(SlowEdges(ALWAYS, 0.1, 0.4)),
        "early release": lambda: suffering(EarlyRelease(ALWAYS, (1.5, 6.0), frozenset({-1}), 0.3)),
        "held driver": lambda: suffering(HeldLine(ALWAYS, hold_ns=(60_000, 300_000), share=0.5)),
        "free line": lambda: suffering(StrayTurn(ALWAYS, share=0.7)),
        "stuck": lambda: suffering(StuckLine([(1, 1.2), (2, 2.3), (4, 4.1)])),
        "chatter": lambda: suffering(StuckLine([(1, 2), (4, 5)], 2000, 1.0)),
        "contact": lambda: suffering(
            LooseContact(ALWAYS, frozenset({2, 3}), 0.4, 0.15), it=robot_of(ids=(1, 2, 3, 4))
        ),
        "contact of one": lambda: suffering(LooseContact(ALWAYS, frozenset({2}), 0.4, 0.15)),
        "loose branch": lambda: away(frozenset({2, 3}), (75, 25, 100)),
        "restarts": lambda: away(frozenset({2}), (300, 320, 290)),
        "held": lambda: held_at(0x00),
        "single losses": lambda: codes(servos.suffering("wck", "drop:1:10%", 6.0)),
        "slow clock": lambda: suffering(DriftingClock(2, lambda _: 0.06, 0.36, 0.25)),
        "fast clock": lambda: suffering(DriftingClock(2, lambda _: -0.06, 0.62)),
        "twins": lambda: twins(5_000, "rs30x", Clash.AND),
        "late twins": lambda: twins(1_500_000, "mightyzap", Clash.AND),
        "twins apart": lambda: codes(servos.suffering("lss", "duplicate-id:2:60%", 6.0)),
        "two masters": two_masters,
        "two that ask bare": lambda: drawn("two-masters-wck", 99919),
        "two loops": two_loops,
        "two rounds": lambda: codes(two_rounds(31, 43, apart_ms=0.2).diagnosed()),
        "two of one period": two_of_one_period,
        "two answers at once": lambda: codes(answered_at_once().diagnosed()),
        "two requests at once": lambda: codes(asked_at_once("wck").diagnosed()),
        "sparks of all": sparks_of_all,
        "two makes": two_makes,
        "one of two makes": lambda: two_makes("mightyzap"),
        "other protocol": lambda: as_other("mightyzap"),
        "other rate": lambda: as_other("rs30x", 2.0),
        "near rate": lambda: as_other("rs30x", 128 / 115.2),
        "wrong lengths": lambda: codes(alone("rs30x", longer).diagnosed()),
        "no blocks": lambda: codes(without_blocks(never=True).diagnosed()),
        "a loader": lambda: codes(updated("mightyzap").diagnosed()),
        "one side alone": lambda: codes(torn_on_one_side().diagnosed()),
        "worn contact": lambda: codes(losing(gets_worse=True).diagnosed()),
        "altered answers": lambda: codes(altered_answers().diagnosed()),
    }
)


@functools.cache
def of(fault: str) -> frozenset[str]:
    return frozenset(FAULTS[fault]())


TOLD: Final = (
    ("damage-everywhere", "noise", "held driver"),
    ("damage-undecided", "one side alone", "noise"),
    ("spoken-between", "a loader", "noise"),
    ("damage-one-servo", "fast clock", "noise"),
    ("damage-in-answers", "held driver", "noise"),
    ("damage-in-requests", "early release", "held driver"),
    ("strays-at-turn", "free line", "noise"),
    ("strays-anywhere", "noise", "free line"),
    ("strays-alone", "noise", "two masters"),
    ("same-bit", "twins", "noise"),
    ("one-way-bits", "late edges", "noise"),
    ("late-edges", "late edges", "noise"),
    ("late-bits", "long lows", "noise"),
    ("last-bits", "slow clock", "late edges"),
    ("clock-off", "fast clock", "twins"),
    ("first-byte-torn", "held driver", "early release"),
    ("last-byte-torn", "early release", "held driver"),
    ("answers-torn-anywhere", "altered answers", "held driver"),
    ("answers-twice", "late twins", "early release"),
    ("second-answers-whole", "twins apart", "late twins"),
    ("several-answer-twice", "two that ask bare", "twins apart"),
    ("answers-mixed", "twins", "fast clock"),
    ("answers-always-torn", "fast clock", "contact"),
    ("requests-run-together", "two masters", "late edges"),
    ("requests-overlaid", "two requests at once", "noise"),
    ("stop-bits-held-low", "two answers at once", "slow clock"),
    ("requests-spoken-into", "two masters", "noise"),
    ("torn-when-none-due", "two masters", "held driver"),
    ("streams-apart", "two loops", "contact"),
    ("interleaved-requests", "two masters", "contact"),
    ("unrelated-periods", "two loops", "contact"),
    ("rounds-cross", "two rounds", "contact"),
    ("rhythms-meet", "two of one period", "two loops"),
    ("comes-and-goes", "contact", "noise"),
    ("lost-together", "loose branch", "contact of one"),
    ("lost-more-and-more", "worn contact", "contact of one"),
    ("away-unevenly", "contact", "restarts"),
    ("away-alike", "restarts", "contact"),
    ("back-too-soon", "single losses", "restarts"),
    ("held-low", "stuck", "chatter"),
    ("held-value", "held", "stuck"),
    ("line-babbles", "chatter", "sparks"),
    ("damage-while-moving", "sparks", "noise"),
    ("damage-whatever-moves", "noise for long", "sparks"),
    ("damage-behind-steps", "sparks of all", "chatter"),
    ("two-protocols", "two makes", "other protocol"),
    ("foreign-frames", "one of two makes", "other protocol"),
    ("other-protocol", "other protocol", "one of two makes"),
    ("nothing-holds", "other rate", "noise"),
    ("begins-hold", "wrong lengths", "other rate"),
    ("bits-of-another-rate", "other rate", "other protocol"),
    ("bits-read-twice", "near rate", "other rate"),
    ("kind-never-whole", "no blocks", "two masters"),
)
"""A finding, a fault that brings it, and one that looks alike and does not."""


@pytest.mark.parametrize(("code", "fault", "_"), TOLD)
def test_a_fault_shows(code: str, fault: str, _: str) -> None:
    assert code in of(fault)


@pytest.mark.parametrize(("code", "_", "other"), TOLD)
def test_another_fault_does_not_look_like_it(code: str, _: str, other: str) -> None:
    assert code not in of(other)


def test_requests_whose_last_bytes_a_driver_cuts_are_not_spoken_into_when_none_is_due() -> None:
    assert "last-byte-torn" in of("early release")
    assert "torn-when-none-due" not in of("early release")


def test_answers_that_lie_over_each_other_begin_as_requests_do_and_are_none() -> None:
    told = twins(90_000, "mightyzap", Clash.AND, baud=400_000)
    assert "answers-always-torn" in told
    assert "request-in-answer" not in told


def test_a_clock_that_tears_answers_misses_their_stop_bits() -> None:
    """Two of one id that lie over each other make a few line errors, in their answers only."""
    it = robot_of(ids=(1, 2), baud=57600, gap_ns=(1_000_000, 5_000_000), reads="turn", rate_hz=20)
    told = of_twins(1, 604_748, 5, replace(it, seconds=5))
    assert "last-bits" not in codes(told)
    assert verdicts(told.incidents()) == [("duplicate-id", (1,))]


def test_a_second_answer_that_comes_when_the_next_servo_was_asked_is_not_the_next_ones() -> None:
    it = robot_of("rs30x", ids=(16, 33, 46, 70), reads="turn", rate_hz=100)
    told = of_twins(33, 2_340_383, 9100, replace(it, seconds=8))
    assert verdicts(told.incidents()) == [("duplicate-id", (33,))]


def test_a_clock_that_is_off_is_known_where_there_is_one_servo_alone() -> None:
    """No peer's answers are sound beside it, and the bits it misreads are those of late edges."""
    it = replace(robot_of("rs30x", ids=(4,)), seconds=6)
    clock = DriftingClock(4, lambda _: 0.057, 0.4, 0.2)
    rows = tapped(talked(it, 5, bench_of(it, 5, troubles=[clock])))
    heard = HOSTS["exact"](Scenario("line", "rs30x", (), it.baud, lambda _: rows), rows, 5)
    told = verdicts(diagnosed(heard.chunks, "rs30x", baud=it.baud).incidents())
    assert told == [("clock-drift", (4,))]


@each_in_turn(2, "protocol", ["lss", "wck"])
def test_strays_behind_requests_are_the_turns_by_late_stamps_too(protocol: str) -> None:
    it = robot_of(protocol)
    told = {}
    for trouble in (StrayTurn(ALWAYS, share=0.7), Noise(ALWAYS, 60)):
        rows = tapped(talked(it, 5, bench_of(it, 5, troubles=[trouble])))
        told[type(trouble)] = "strays-at-turn" in found(rows, protocol, host="usb16")
    assert told == {StrayTurn: True, Noise: False}


def test_of_a_sound_line_nothing_is_told() -> None:
    assert not of("none") & ALL


def test_each_finding_of_the_line_is_shown() -> None:
    assert {code for code, _, _ in TOLD} == ALL
