"""``sniffer simulate --like FILE``: servos that answer as those of a recording did."""

from __future__ import annotations

import signal
from functools import cache
from typing import TYPE_CHECKING, Final

import pytest

from sniffer.ground.model import NS
from sniffer.jobs.like import scenario_like
from sniffer.jobs.telling import Teller
from sniffer.protocols import PROTOCOLS
from sniffer.simulation.respond import Responder
from tests.commands import within
from tests.playbacks import CLEAN, DAMAGED
from tests.simulations import ear, running, told
from tests.streams.mightyzap import packet as zap
from tests.streams.rs30x import packet, returned, write
from tests.test_playback_servos import exchanges_of

if TYPE_CHECKING:
    from pathlib import Path

    from sniffer.playback.exchanges import RecordedExchange
    from sniffer.simulation.play.scenario import Scenario

Capsys = pytest.CaptureFixture[str]
EVERY_PROTOCOL = pytest.mark.parametrize("name", PROTOCOLS)

SEEN: Final = {
    "mightyzap": (1, 2, 3),
    "lss": (1, 2, 5, 10),
    "wck": (0, 1, 2, 3),
    "rs30x": (1, 2, 5),
}
READS: Final = ("load_data", "status_read", "read", "QD", "QV", "QT", "QC", "pd_gain_read")
LAST: Final = 400
"""Exchanges at the end of a recording among which those are that tell what was so last."""


@cache
def like(name: str) -> Scenario:
    return scenario_like(CLEAN[name])


def responder(scenario: Scenario) -> Responder:
    return Responder(
        scenario.protocol,
        servo_ids=scenario.servo_ids,
        baud=scenario.baud,
        faults=scenario.faults,
        models=scenario.models,
        like=scenario.like,
    )


def answers(servos: Responder, *requests: bytes) -> list[bytes]:
    out = []
    for raw in requests:
        said = servos.hear(raw, servos.bus.now_ns + NS // 20)
        out.append(b"".join(s.frame.wire for s in said if s.ours))
    return out


def last_reads(name: str) -> dict[bytes, RecordedExchange]:
    """Return the last read that each servo answered, for each command, near the end."""
    every = exchanges_of(CLEAN[name], name).buses["bus0"][-LAST:]
    last = {(e.key.servo_id, e.op): e for e in every if e.op in READS and e.replies}
    return {e.raw: e for e in last.values()}


@EVERY_PROTOCOL
def test_ids_rate_models_and_losses_are_those_of_the_recording(name: str) -> None:
    told: list[str] = []
    scenario = scenario_like(DAMAGED[name], tell=Teller(told.append))
    assert not [line for line in told if "left out" in line]  # ids of everybody are no servos
    assert scenario.servo_ids == SEEN[name]
    assert scenario.baud == PROTOCOLS[name].baud
    assert {fault.servo_id for fault in scenario.faults} <= {*SEEN[name]}
    assert scenario.faults
    assert all(0 < fault.rate < 0.1 for fault in scenario.faults)
    assert not like(name).faults


@EVERY_PROTOCOL
def test_who_reads_is_told_what_was_told_last(name: str) -> None:
    recorded = last_reads(name)
    assert {e.key.servo_id for e in recorded.values()} == {*SEEN[name]}
    told = answers(responder(like(name)), *recorded)
    assert told == [e.replies[0].data for e in recorded.values()]


@pytest.mark.parametrize("name", ["mightyzap", "wck"])
def test_answers_take_as_long_as_one_that_was_recorded(name: str) -> None:
    scenario = like(name)
    servos = responder(scenario)
    for nth, one in enumerate(last_reads(name).values(), 1):
        said = [s.frame for s in servos.hear(one.raw, nth * NS)]
        known = scenario.like[one.key.servo_id].delays_ns[one.op]
        assert said[1].t_start_ns - said[0].t_end_ns in known


def test_a_write_changes_what_is_read_and_registers_that_were_not_seen_are_as_usual() -> None:
    scenario = like("mightyzap")
    servos, usual = responder(scenario), Responder("mightyzap")
    speed = next(r for r in servos.bus.table.registers if r.name == "moving_speed")
    read = zap(1, 0xF2, bytes([speed.address, 2]))
    stored = zap(1, 0xF3, bytes([speed.address]) + b"\x21\x01")
    assert answers(servos, stored, read) == [zap(1, 0), zap(1, 0, b"\x21\x01")]
    unseen = [r for r in servos.bus.table.registers if r.name not in scenario.like[1].values]
    assert unseen
    for register in unseen:
        request = zap(1, 0xF2, bytes([register.address, register.width]))
        assert answers(servos, request) == answers(usual, request), register.name


def test_a_joint_that_is_told_to_move_measures_again() -> None:
    servos = responder(like("rs30x"))
    before = servos.bus.servos[1].seen["present_position"]
    assert answers(servos, packet(1, 0x0F, 42, 2)) == [
        returned(1, 42, before.to_bytes(2, "little", signed=True))
    ]
    assert answers(servos, write(1, 30, (before + 600).to_bytes(2, "little", signed=True), 1))
    servos.idle(servos.bus.now_ns + 3 * NS)
    (after,) = answers(servos, packet(1, 0x0F, 42, 2))
    assert abs(int.from_bytes(after[7:9], "little", signed=True) - before - 600) < 30


def test_a_servo_that_left_requests_unanswered_leaves_as_many(tmp_path: Path) -> None:
    source, lines = tmp_path / "x.log", []
    for nth in range(40):
        who = 1 + nth % 2
        lines.append(f"(1700000000.{nth * 20:03d}000) bus0 #{zap(who, 0xF1).hex().upper()}\n")
        if who == 1 or nth % 4 == 1:
            answer = zap(who, 0).hex().upper()
            lines.append(f"(1700000000.{nth * 20 + 5:03d}000) bus0 #{answer}\n")
    source.write_text("".join(lines))
    servos = responder(scenario_like(source))
    told = answers(servos, *[zap(1, 0xF1), zap(2, 0xF1)] * 60)
    assert all(told[0::2])
    assert 15 < told[1::2].count(b"") < 45


def test_a_controller_talks_to_them_over_a_port(tmp_path: Path) -> None:
    recorded = list(last_reads("wck").values())[:6]
    arguments = ("--like", CLEAN["wck"], "--no-tap")
    with running(*arguments, "--link", tmp_path / "bus") as it:
        with ear(str(tmp_path / "bus")) as controller:
            for one in recorded:
                reply = one.replies[0].data
                assert controller.ask(one.raw, answer=len(reply)) == reply
        it.end(signal.SIGINT)
    assert it.process.returncode == 0


def test_it_is_said_which_answers_are_recorded_and_which_are_made_up(tmp_path: Path) -> None:
    table = {r.name: r for r in Responder("mightyzap").bus.table.registers}
    goal, speed, new = table["goal_position"], table["moving_speed"], b"\x21\x01"
    known, unseen = (zap(1, 0xF2, bytes([r.address, 2])) for r in (goal, speed))
    lines = [known, zap(1, 0, b"\x10\x02")] * 20
    text = (f"(1700000000.{nth * 5:03d}000) bus0 #{raw.hex()}" for nth, raw in enumerate(lines))
    (tmp_path / "x.log").write_text("\n".join(text) + "\n")
    stored = zap(1, 0xF3, bytes([speed.address]) + new)
    truth = tmp_path / "truth.jsonl"
    arguments = ("--like", tmp_path / "x.log", "--no-tap", "--truth", truth)
    with running(*arguments, "--link", tmp_path / "bus") as it:
        with ear(str(tmp_path / "bus")) as controller:
            for request, size in ((known, 9), (unseen, 9), (unseen, 9), (stored, 7)):
                assert len(controller.ask(request, answer=size)) == size
            assert controller.ask(unseen, answer=9) == zap(1, 0, new)
        said = it.end(signal.SIGINT)
    first, last = told(truth)[0], told(truth)[-1]
    assert "registers as recorded: servo 1: goal_position. The values of all others" in said
    assert (
        "values answered: 1 as recorded, 1 as written since, 0 that moved since, 2 made up "
        f"(servo 1 {speed.name} 2x)" in said
    )
    assert first["recorded_registers"] == {"1": ["goal_position"]}
    assert last["answered"] == {
        "recorded": 1,
        "told": 1,
        "moved": 0,
        "made_up": [{"servo_id": 1, "register": speed.name, "count": 2}],
    }


@EVERY_PROTOCOL
def test_answers_as_recorded_are_counted_as_such(name: str) -> None:
    servos = responder(like(name))
    answers(servos, *last_reads(name))
    answered = servos.tally.answered
    assert answered.recorded
    assert not answered.made_up


def test_what_has_moved_since_is_no_recorded_answer() -> None:
    servos = responder(like("rs30x"))
    before = servos.bus.servos[1].seen["present_position"]
    answers(servos, write(1, 30, (before + 600).to_bytes(2, "little", signed=True), 1))
    servos.idle(servos.bus.now_ns + 3 * NS)
    answers(servos, packet(1, 0x0F, 42, 2))
    answered = servos.tally.answered
    assert (answered.recorded, answered.moved) == (0, 1)
    assert not answered.made_up


def test_a_bus_without_a_recording_says_nothing_of_one(tmp_path: Path) -> None:
    truth = tmp_path / "truth.jsonl"
    arguments = ("mightyzap", "--respond", "--no-tap", "--truth", truth, "--duration", "100ms")
    with running(*arguments) as it:
        assert "recorded" not in it.end()
    assert "recorded_registers" not in told(truth)[0]
    assert "answered" not in told(truth)[-1]


REFUSED: Final = {
    "nothing": ((), "Missing argument 'PROTOCOL', or --like FILE"),
    "bus": (("wck", "--bus", "arm"), "--bus goes with --like"),
    "servos": (("--like", "x", "--servos", "2"), "leave --servos out"),
    "no such file": (("--like", "x"), "x"),
    "rate": (("--like", "{wck}", "--full"), "--respond plays no controller"),
    "protocol": (("lss", "--like", "{wck}"), ""),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_is_refused(
    tmp_path: Path, capsys: Capsys, monkeypatch: pytest.MonkeyPatch, case: str
) -> None:
    monkeypatch.chdir(tmp_path)
    options, complaint = REFUSED[case]
    ran = within(capsys, "simulate", *(o.replace("{wck}", str(CLEAN["wck"])) for o in options))
    assert ran.status == 2
    assert complaint in ran.err
    assert "Traceback" not in ran.err
