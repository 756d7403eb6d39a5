"""What a first fault does not do besides is told as a second one."""

from __future__ import annotations

import functools

import pytest

from sniffer.diagnosis.physics.seen import chance_of, shares_of
from sniffer.simulation import simulate
from sniffer.simulation.faults import Fault
from tests.diagnosed import chunks_of, codes, diagnosed, verdicts
from tests.lists import each_in_turn

Said = tuple[tuple[str, tuple[int, ...]], ...]


@functools.cache
def told(protocol: str, *faults: Fault, seed: int = 2, seconds: float = 12.0) -> Said:
    """Return what is said of a simulated bus that has some faults."""
    frames = simulate(protocol, seed=seed, faults=list(faults), duration_s=seconds)
    return tuple(verdicts(diagnosed(chunks_of(frames), protocol, baud=115200).incidents()))


def test_noise_that_bare_answers_hide_is_told_beside_a_cable_by_the_values_it_alters() -> None:
    said = told("wck", Fault("flip", 0.03), Fault("drop", 0.08, 1))
    assert ("bus-noise", ()) in said
    assert ("bad-cable", (1,)) in said


def test_altered_values_of_one_servo_alone_make_no_noise_of_everybody() -> None:
    assert "bus-noise" not in {cause for cause, _ in told("wck", Fault("drop", 0.08, 1))}


@pytest.mark.parametrize(
    ("fault", "other"),
    [(Fault("drop", 0.28, 2), "bad-cable"), (Fault("duplicate", 0.7, 2), "duplicate-id")],
)
def test_a_loop_that_stops_where_nothing_is_missing_is_no_effect_of_what_is(
    fault: Fault, other: str
) -> None:
    said = {cause for cause, _ in told("rs30x", fault, Fault("hang", 0.03), seconds=20)}
    assert {other, "controller-stall"} <= said


@pytest.mark.parametrize(
    "fault", [Fault("drop", 0.3, 2), Fault("dead", 1.0, 2, first_s=5.0)], ids=lambda f: f.kind
)
def test_an_uneven_loop_is_told_by_the_cycles_in_which_nothing_failed(fault: Fault) -> None:
    said = {cause for cause, _ in told("wck", fault, Fault("jitter", 1.0))}
    assert "controller-jitter" in said
    assert "controller-jitter" not in {cause for cause, _ in told("wck", fault)}


def test_a_servo_that_is_slow_each_time_is_told_beside_noise() -> None:
    said = told("lss", Fault("flip", 0.03), Fault("slow", 1.0, 5))
    assert {("bus-noise", ()), ("slow-servo", (5,))} <= set(said)


def test_bytes_of_a_text_that_are_altered_at_random_have_no_late_bits() -> None:
    frames = simulate("lss", seed=22, faults=[Fault("flip", 0.03)], duration_s=20.0)
    diagnosis = diagnosed(chunks_of(frames), "lss", baud=115200)
    assert not {"late-bits", "same-bit"} & codes(diagnosis)
    assert verdicts(diagnosis.incidents())[0] == ("bus-noise", ())


def test_of_a_digit_only_the_bits_are_seen_that_make_no_other_digit() -> None:
    digits = frozenset(b"0123456789")
    one, other = shares_of([b"0"], digits)
    assert one[:4] == (0, 0, 0, 0)
    assert one[4:] == (0.25, 0.25, 0.25, 0.25)
    assert sum(other) == pytest.approx(1)
    assert chance_of([(one, other)], range(4, 8)) == 1


def test_a_checksum_shows_each_bit_alike() -> None:
    assert chance_of([shares_of([b"\x01\x02"], frozenset())], [3]) == 1 / 8
    # where nothing that is altered would be seen, each bit is as likely
    assert chance_of([shares_of([b"0"], frozenset(range(256)))], [3]) == 1 / 8
    assert chance_of([], range(5, 8)) == 3 / 8


@each_in_turn(2, "other", [Fault("flip", 0.03), Fault("impatient", 0.05)])
def test_cycles_that_all_differ_are_no_two_rhythms_beside_a_fault(other: Fault) -> None:
    said = {cause for cause, _ in told("lss", Fault("jitter", 1.0), other, seed=48, seconds=15)}
    assert "two-masters" not in said
    assert said
