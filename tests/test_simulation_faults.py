"""What a servo or a controller does wrong in a simulation, seen as a decoder sees it."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Final

import pytest

from sniffer.ground.model import NS, SnifferError
from sniffer.simulation import BUSES, Fault, TrueFrame, simulate
from sniffer.simulation.faults import FAULTS, LASTING_FAULTS, read_fault
from sniffer.simulation.overlap import overheard
from sniffer.simulation.respond import Responder
from tests.lists import each_in_turn
from tests.test_simulation import Decoded

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

EVERY_BUS = each_in_turn(4, "name", BUSES)
BEGINS_S: Final = 2.0
POSITIONS: Final = ("present_position", "position")
GOALS: Final = ("goal_position",)
LOADS: Final = ("present_load", "load", "present_current")


def played(name: str, *faults: str, seconds: float = 6.0, seed: int = 3) -> list[TrueFrame]:
    wanted = [read_fault(text) for text in faults]
    return list(simulate(name, seed=seed, faults=wanted, duration_s=seconds))


def of(
    frames: Sequence[TrueFrame], servo_id: int, names: Sequence[str]
) -> Iterator[tuple[float, int]]:
    """Yield when a servo's answers, or what it is told, say a register, and its number."""
    for f in frames:
        for who, name, raw in f.values:
            if who == servo_id and name in names:
                yield f.t_end_ns / NS, raw


def answered(frames: Sequence[TrueFrame], servo_id: int) -> list[float]:
    return [
        f.t_end_ns / NS
        for f in frames
        if f.kind == "response" and f.servo_id == servo_id and f.wire
    ]


def possible(name: str, kinds: Sequence[str] = tuple(FAULTS)) -> list[str]:
    return [kind for kind in kinds if kind not in BUSES[name].unknown_faults]


@EVERY_BUS
def test_every_fault_gives_the_same_bytes_for_the_same_seed_and_never_overlaps(name: str) -> None:
    for kind in possible(name):
        faults = [Fault(kind, 0.05, first_s=0.3)]
        runs = [list(simulate(name, seed=2, faults=faults, duration_s=1.2)) for _ in range(2)]
        assert runs[0] == runs[1]
        for a, b in itertools.pairwise(runs[0]):
            assert a.t_end_ns <= b.t_start_ns, kind


@EVERY_BUS
def test_before_a_fault_begins_the_run_is_that_without_it(name: str) -> None:
    sound = [f for f in played(name, seconds=1.5) if f.t_end_ns < NS]
    for kind in possible(name):
        struck = played(name, f"{kind}:100%@1s", seconds=1.5)
        assert struck[: len(sound)] == sound, kind
        if kind != "refuse":  # nothing may be written so soon that is answered
            assert any(f.fault == kind for f in struck), kind


@EVERY_BUS
def test_a_fault_that_ends_leaves_the_servo_well(name: str) -> None:
    who = BUSES[name].servo_ids[1]
    for kind in possible(name, tuple(LASTING_FAULTS)):
        struck = played(name, f"{kind}:{who}@1s+300ms", seconds=3)
        assert {f.servo_id for f in struck if f.fault} == {who}
        assert max(f.t_end_ns for f in struck if f.fault) < 1.6 * NS, kind
        assert answered(struck, who)[-1] > 2.5, kind


@EVERY_BUS
def test_a_dead_servo_falls_silent_and_the_others_do_not(name: str) -> None:
    who, other = BUSES[name].servo_ids[:2]
    frames = played(name, f"dead:{who}@{BEGINS_S}s")
    assert BEGINS_S - 0.2 < answered(frames, who)[-1] < BEGINS_S + 0.1
    assert answered(frames, other)[-1] > 5.5
    asked = [f for f in frames if f.kind == "request" and f.servo_id == who]
    assert asked[-1].t_end_ns > 5.5 * NS


@EVERY_BUS
def test_an_absent_servo_never_answers(name: str) -> None:
    who = BUSES[name].servo_ids[-1]
    frames = played(name, f"absent:{who}", seconds=3)
    assert not answered(frames, who)
    assert answered(frames, BUSES[name].servo_ids[0])


@EVERY_BUS
def test_a_joint_that_is_held_stays_where_it_is_and_its_load_grows(name: str) -> None:
    for seed, who in itertools.product((1, 2), BUSES[name].servo_ids):
        frames = played(name, f"stall:{who}@{BEGINS_S}s+9s", seed=seed)
        places = {raw for t, raw in of(frames, who, POSITIONS) if t > BEGINS_S + 0.1}
        assert max(places) - min(places) <= 1
        if name == "lss":  # its current is asked for now and then only
            continue
        before = max(abs(raw) & 0x3FF for t, raw in of(frames, who, LOADS) if t < BEGINS_S)
        assert max(abs(raw) & 0x3FF for t, raw in of(frames, who, LOADS) if t > BEGINS_S) > before


@EVERY_BUS
def test_a_limp_joint_follows_no_goal_and_has_no_load(name: str) -> None:
    who = BUSES[name].servo_ids[0]
    frames = played(name, f"limp:{who}@{BEGINS_S}s", seconds=8)
    goals = [raw for t, raw in of(frames, who, GOALS) if t > 4]
    places = [raw for t, raw in of(frames, who, POSITIONS) if t > 4]
    assert max(places) - min(places) < (max(goals) - min(goals)) / 2
    if name == "mightyzap":
        assert {raw & 0x3FF for t, raw in of(frames, who, ("present_load",)) if t > 4} == {0}


def test_an_overload_switches_the_force_of_a_mightyzap_off_as_its_register_says() -> None:
    frames = played("mightyzap", "stall:2@2s+9s", seconds=10)
    errors = [
        (f.t_end_ns / NS, f.wire[5]) for f in frames if f.kind == "response" and f.servo_id == 2
    ]
    assert {error for t, error in errors if t < BEGINS_S} == {0}
    runs = [
        [t for t, _ in run] for bad, run in itertools.groupby(errors, lambda e: e[1] != 0) if bad
    ]
    assert {error for _, error in errors} == {0, 0x20}
    assert 0.9 < runs[-1][-1] - runs[-1][0] < 1.3
    loads = [raw & 0x3FF for t, raw in of(frames, 2, ("present_load",)) if t > runs[-1][-1] + 0.3]
    assert set(loads) == {0}


def test_a_hot_rs30x_warns_then_brakes_until_it_restarts() -> None:
    frames = played("rs30x", "overheat:2@2s", seconds=30)
    said = [f for f in frames if f.kind == "response" and f.servo_id == 2 and len(f.wire) > 8]
    flags = [f.wire[3] for f in said]
    assert list(dict.fromkeys(flags)) == [0, 0x20, 0xA0]
    at = {flag: flags.index(flag) for flag in (0x20, 0xA0)}
    hot = {
        flag: {n: raw for _, n, raw in said[i].values}["present_temperature"]
        for flag, i in at.items()
    }
    assert abs(hot[0x20] - 70) <= 1
    assert abs(hot[0xA0] - 80) <= 1


def test_a_hot_lss_goes_into_safe_mode_and_is_cool_again_later() -> None:
    frames = played("lss", "overheat:2@2s", seconds=40)
    states = [raw for _, raw in of(frames, 2, ("present_status",))]
    assert states[-1] == 10
    assert max(raw for _, raw in of(frames, 2, ("present_temperature",))) == pytest.approx(
        850, abs=60
    )


@EVERY_BUS
def test_a_slow_servo_is_slower_than_all_others_and_still_in_time(name: str) -> None:
    who = BUSES[name].servo_ids[1]
    got = Decoded(name, played(name, f"slow:{who}"))
    asked = {row[0]: row for row in got.frames}
    took: dict[bool, list[int]] = {True: [], False: []}
    for at, (time, window) in got.took.items():
        if window < 200 * NS // 1000:  # what writes an EEPROM first takes its time anyway
            took[asked[at][3] == who].append(time)
            assert time <= window
    assert min(took[True]) > max(took[False])


@EVERY_BUS
def test_a_servo_that_restarts_again_and_again_is_silent_each_time(name: str) -> None:
    who = BUSES[name].servo_ids[1]
    frames = played(name, f"reset-loop:{who}@{BEGINS_S}s", seconds=10)
    times = answered(frames, who)
    pauses = [b - a for a, b in itertools.pairwise(times) if b - a > 0.055]
    assert len(pauses) >= 3
    assert times[-1] > 7


def test_a_restart_is_seen_in_the_registers() -> None:
    frames = played("mightyzap", "reset-loop:2@2s", seconds=12)
    goals = list(of([f for f in frames if f.kind == "response"], 2, ("moving",)))
    assert goals
    enables = [f for f in frames if f.kind == "request" and (2, "force_on", 1) in f.values]
    assert len(enables) >= 3  # the controller sees that it was away, and switches it on again


@pytest.mark.parametrize("name", ["mightyzap", "rs30x"])
def test_a_servo_that_refuses_says_so_and_does_nothing(name: str) -> None:
    struck = [f for f in played(name, "refuse@1s", seconds=12) if f.fault == "refuse"]
    assert struck
    for f in struck:
        assert f.wire == b"\x08" if name == "rs30x" else f.wire[5] & 0x08


@EVERY_BUS
def test_a_chatty_servo_speaks_without_being_asked(name: str) -> None:
    frames = played(name, "chatty:20%", seconds=2)
    for before, f in itertools.pairwise(frames):
        if f.fault == "chatty":
            assert f.kind == "response"
            assert before.kind == "response" or before.servo_id != f.servo_id or not before.wire
    assert sum(f.fault == "chatty" for f in frames) > 5


@EVERY_BUS
def test_a_controller_that_hangs_stops_for_a_while(name: str) -> None:
    frames = played(name, "hang:30%@1s", seconds=6)
    pauses = [
        (b.t_start_ns - a.t_end_ns) / NS for a, b in itertools.pairwise(frames) if b.fault == "hang"
    ]
    assert pauses
    assert all(0.05 < pause < 0.55 for pause in pauses)


@EVERY_BUS
def test_an_impatient_controller_mixes_its_request_with_the_answer(name: str) -> None:
    frames = played(name, "impatient:10%", seconds=4)
    struck = [f for f in frames if f.fault == "impatient"]
    assert {f.kind for f in struck} == {"request", "response"}
    torn = [f for f in struck if f.wire != f.data]
    assert len(torn) > 5
    got = Decoded(name, frames)
    assert got.gaps


@EVERY_BUS
def test_a_controller_that_wears_memories_out_writes_what_is_kept(name: str) -> None:
    written = [
        f
        for f in played(name, "nv-wear", seconds=3)
        if f.fault == "nv-wear" and f.kind == "request"
    ]
    assert len(written) > 5
    ops = {"mightyzap": "store_data", "lss": "CLED", "wck": "pd_gain_set", "rs30x": "flash_write"}
    assert {f.op for f in written} == {ops[name]}


def test_a_servo_without_our_controller_dies_as_well() -> None:
    bus = Responder("lss", faults=[read_fault("dead:2@1s")])
    answered = {t_s: bus.hear(b"#2QD\r", t_s * NS) for t_s in (0, 2)}
    assert [u.frame.kind for u in answered[0] if u.frame.wire] == ["request", "response"]
    assert [u.frame.kind for u in answered[2] if u.frame.wire] == ["request"]


def test_a_fault_that_a_bus_cannot_show_is_refused() -> None:
    with pytest.raises(SnifferError, match="nothing on a wck bus would show that"):
        next(simulate("wck", faults=[Fault("overheat", 0.1)]))


def test_two_senders_pull_the_line_down_together() -> None:
    bit_ns = NS // 100_000
    assert [b.value for b in overheard([(0, b"\xf0\x0f")], 100_000)] == [0xF0, 0x0F]
    both = overheard([(0, b"\xf5\x0f"), (0, b"\x9f")], 100_000)
    assert [(b.value, b.has_stop) for b in both] == [(0xF5 & 0x9F, True), (0x0F, True)]
    # the start bit of the second stands where the first has its stop bit
    late = overheard([(0, b"\xff"), (9 * bit_ns, b"\xff")], 100_000)
    assert [(b.value, b.has_stop) for b in late] == [(0xFF, False)]
    assert overheard([], 9600) == []
