"""Drivers that are on too late or off too early: what nobody drives is high, all else is right."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Final, cast

import pytest

from bench.diagnosis.catalogue import scenarios
from bench.diagnosis.ear import tapped
from bench.diagnosis.hosts import HOSTS
from bench.diagnosis.making import bench_of, talked
from bench.diagnosis.scenario import Scenario
from bench.diagnosis.troubles import EarlyRelease, LateDriver, LooseContact, Noise, SlowEdges
from sniffer.diagnosis.physics.undriven import lacks_end, with_begin
from sniffer.diagnosis.rules.line.undriven import FINDINGS
from tests.diagnosed import codes, diagnosed, verdicts
from tests.test_diagnosis_line import ALWAYS, robot_of

if TYPE_CHECKING:
    from collections.abc import Hashable

    from bench.diagnosis.line import Trouble
    from sniffer.diagnosis import Diagnosis

CONTROLLER, SERVO = frozenset({-1}), frozenset({2})

CHECKED: Final = ("mightyzap", "lss", "rs30x")
"""Protocols whose answers have a header."""

ENDS: Final = (
    ("answers-begin-undriven", LateDriver, SERVO),
    ("answers-end-undriven", EarlyRelease, SERVO),
    ("requests-begin-undriven", LateDriver, CONTROLLER),
    ("requests-end-undriven", EarlyRelease, CONTROLLER),
)

UNDRIVEN: Final = frozenset(entry.code for entry in FINDINGS)


def told(protocol: str, trouble: Trouble, host: str = "exact") -> Diagnosis:
    it = robot_of(protocol)
    rows = tapped(talked(it, 5, bench_of(it, 5, troubles=[trouble])))
    heard = HOSTS[host](Scenario("line", protocol, (), it.baud, lambda _: rows), rows, 5)
    return diagnosed(heard.chunks, protocol, baud=it.baud)


@functools.cache
def switched(
    protocol: str,
    kind: type[EarlyRelease],
    who: frozenset[int],
    share: float = 1.0,
    host: str = "exact",
) -> Diagnosis:
    return told(protocol, kind(ALWAYS, (3.0, 9.5), who, share), host)


@pytest.mark.parametrize(("protocol", "host"), [*((p, "exact") for p in CHECKED), ("lss", "usb16")])
@pytest.mark.parametrize(("code", "kind", "who"), ENDS)
def test_a_driver_that_is_on_late_or_off_early_is_told_by_the_end_it_takes(
    code: str, kind: type[EarlyRelease], who: frozenset[int], protocol: str, host: str
) -> None:
    of = switched(protocol, cast("Hashable", kind), who, 0.4, host)
    assert codes(of) & UNDRIVEN == {code}
    assert verdicts(of.incidents())[0] == ("turnaround", ())


@pytest.mark.parametrize(("code", "kind", "who"), ENDS[:2])
def test_where_each_answer_of_a_servo_lacks_an_end_it_is_no_second_servo(
    code: str, kind: type[EarlyRelease], who: frozenset[int]
) -> None:
    for protocol in CHECKED:
        of = switched(protocol, cast("Hashable", kind), who)
        assert code in codes(of)
        assert verdicts(of.incidents()) == [("turnaround", ())]


@pytest.mark.parametrize("protocol", [*CHECKED, "wck"])
@pytest.mark.parametrize(
    "trouble",
    [
        Noise(ALWAYS, 60),
        SlowEdges(ALWAYS, 0.44),
        SlowEdges(ALWAYS, 0.1, 0.4),
        LooseContact(ALWAYS, frozenset({2, 3}), 0.4, 0.15),
    ],
    ids=["noise", "late edges", "long lows", "contact"],
)
def test_what_tears_frames_anywhere_is_no_driver(trouble: Trouble, protocol: str) -> None:
    assert not codes(told(protocol, trouble)) & UNDRIVEN


def test_first_bytes_that_a_tap_lost_are_the_taps() -> None:
    """Of three equal bytes of a header any one that is lost is the first."""
    (scenario,) = scenarios(8101, "tap-loss-told-mightyzap")
    heard = HOSTS["exact"](scenario, scenario.make(8101), 8101)
    told = diagnosed(heard.chunks, scenario.protocol, baud=scenario.baud)
    assert verdicts(told.incidents()) == [("tap-loss", ())]


ANSWER: Final = bytes.fromhex("FD DF 04 00 2A 02 01 ED 00 C0")


@pytest.mark.parametrize("heard", ["7F 47 00 2A 02 01 ED 00 C0", "DF 04 00 2A 02 01 ED 00 C0"])
def test_a_start_bit_that_is_gone_is_looked_for_in_the_next_low_bit(heard: str) -> None:
    assert ANSWER in with_begin(bytes.fromhex(heard), ANSWER)


def test_a_receiver_may_take_bytes_to_find_a_start_bit_again() -> None:
    assert b"*2QD126\r" in with_begin(bytes.fromhex("92 8A 11 C5 32 36 0D"), b"*2QD115\r")


def test_of_a_last_byte_only_upper_bits_are_high_and_all_of_them() -> None:
    line = b"*4QD1\r"
    assert lacks_end(line[:-1] + b"\xcd", line)
    assert not lacks_end(line[:-1] + b"\x4d", line)
    assert not lacks_end(line[:-2] + b"\xf1\r", line)
    assert not lacks_end(line, line)
