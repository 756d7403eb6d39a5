"""Incidents while they happen: in lines, in the recording, and to who waits for them."""

from __future__ import annotations

import json
import time
from typing import TYPE_CHECKING, Any, Final

import pytest

from sniffer.messages.recording_pb2 import Incident
from tests.commands import sniffer
from tests.recorder import Recorder, facts
from tests.recordings import messages
from tests.streams.mightyzap import packet
from tests.terminals import LINUX_ONLY, Terminal, wait

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = LINUX_ONLY

OPENED, OVER, ENDED = Incident.Stage.OPENED, Incident.Stage.OVER, Incident.Stage.ENDED


def asked(servo: int) -> bytes:
    return packet(servo, 0xF2, b"\x8c\x02")


def answered(servo: int) -> bytes:
    return asked(servo) + packet(servo, 0, b"\xff\x07")


BOTH: Final = answered(1) + answered(3)
ONE: Final = answered(1) + asked(3)
"""Servo 3 does not answer."""


@pytest.fixture
def line() -> Iterator[Terminal]:
    with Terminal() as terminal:
        yield terminal


def go_on(line: Terminal, data: bytes, seconds: float) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        line.say(data)
        time.sleep(0.02)


def until(line: Terminal, data: bytes, run: Recorder, said: str) -> None:
    """Say the same time and again until the recorder has said something."""

    def look() -> bool:
        go_on(line, data, 0.1)
        return said in run.said

    wait(look, f"{said!r} is not said: {run.said}")


def recorder(folder: Path, line: Terminal, *told: str) -> Recorder:
    return Recorder(folder, "arm={}=mightyzap@57600", *told, lines=[line])


def incidents(path: Path) -> list[Any]:
    return messages(path).get("/incidents", [])


def test_a_servo_that_falls_silent_is_told_recorded_and_reacted_to(
    tmp_path: Path, line: Terminal
) -> None:
    told = ("--on", "servo-dead", "echo $SNIFFER_CAUSE $SNIFFER_SERVOS >> told.txt")
    with recorder(tmp_path, line, *told) as run:
        go_on(line, BOTH, 1.5)
        assert "incident" not in run.said.replace("incidents=0", "")
        until(line, ONE, run, "sniffer: incident 1 on arm: servo-dead (")
        until(line, ONE, run, "incidents=1")
        ran = run.stop()
    assert ran.status == 0
    assert ran.err.count("incident 1 on arm: ") == 1, "one line when it opens"
    assert ran.err.count("sniffer: incident 1 on arm goes on at the end: servo-dead (") == 1
    assert (tmp_path / "told.txt").read_text(encoding="utf-8") == "servo-dead 3\n"
    first, *_, last = found = incidents(run.path)
    assert {m.id for m in found} == {"1"}
    assert [m.stage for m in (first, last)] == [OPENED, ENDED]
    assert (last.bus, list(last.servo_ids), last.causes[0].cause) == ("arm", [3], "servo-dead")
    (offline,) = json.loads(sniffer("diagnose", run.path, "--format", "json").out)["incidents"]
    assert [c.cause for c in last.causes] == [c["cause"] for c in offline["causes"]]
    assert (last.count, last.first_t_ns, last.last_t_ns, last.story, last.next) == tuple(
        offline[key] for key in ("count", "first_t_ns", "last_t_ns", "story", "next")
    ), "what is said at the end is what is said of the file"
    assert [(e.offset, e.length) for e in last.evidence] == [
        (e["offset"], e["length"]) for e in offline["evidence"]
    ]


def test_an_incident_that_does_not_go_on_is_over(tmp_path: Path, line: Terminal) -> None:
    with recorder(tmp_path, line) as run:
        go_on(line, BOTH, 1.0)
        until(line, ONE, run, "sniffer: incident 1 on arm: ")
        until(line, BOTH, run, "sniffer: incident 1 on arm is over: ")
        assert run.stop().status == 0
    stages = [m.stage for m in incidents(run.path) if m.id == "1"]
    assert (stages[0], stages[-1]) == (OPENED, OVER)


def test_sound_traffic_has_no_incident(tmp_path: Path, line: Terminal) -> None:
    with recorder(tmp_path, line) as run:
        go_on(line, BOTH, 3.0)
        ran = run.stop()
    assert "incident " not in ran.err
    assert "/incidents" not in messages(run.path)


def test_a_recording_ends_by_a_cause(tmp_path: Path, line: Terminal) -> None:
    with recorder(tmp_path, line, "--quiet", "--until", "servo-dead") as run:
        go_on(line, BOTH, 1.0)

        def is_over() -> bool:
            if run.process.poll() is None:
                line.say(ONE)
                time.sleep(0.02)
            return run.process.poll() is not None

        wait(is_over, "it goes on")
        assert run.ended().status == 0
    assert incidents(run.path)[0].causes[0].cause == "servo-dead"


def test_a_flight_recorder_writes_a_file_by_a_cause_and_says_so_in_it(
    tmp_path: Path, line: Terminal
) -> None:
    told = ("--ring", "5s", "--trigger", "any", "--post", "500ms", "-o", str(tmp_path))
    with recorder(tmp_path, line, *told) as run:
        go_on(line, BOTH, 1.0)
        until(line, ONE, run, " bytes\n")
        assert run.stop().status == 0
    path = tmp_path / "incident-0001.mcap"
    about = facts(path)
    assert (about["trigger"], about["trigger.servo_ids"]) == ("any", "3")
    assert about["trigger.what"].startswith("servo-dead on arm: a servo that stopped answering")
    assert incidents(path)[0].causes[0].cause == "servo-dead"


@pytest.mark.parametrize(("topics", "there"), [("raw,incidents", True), ("raw,state", False)])
def test_incidents_are_a_topic_that_may_be_left_out(
    tmp_path: Path, line: Terminal, topics: str, there: bool
) -> None:
    with recorder(tmp_path, line, "--topics", topics) as run:
        go_on(line, BOTH, 1.0)
        until(line, ONE, run, "sniffer: incident 1 on arm: ")
        assert run.stop().status == 0
    assert ("/incidents" in messages(run.path)) == there


def test_killed_and_recovered_a_recording_keeps_its_incidents(
    tmp_path: Path, line: Terminal
) -> None:
    whole = tmp_path / "whole.mcap"
    with recorder(tmp_path, line) as run:
        go_on(line, BOTH, 1.0)
        until(line, ONE, run, "sniffer: incident 1 on arm: ")
        go_on(line, ONE, 3.0)
        run.process.kill()
        run.process.wait()
    assert sniffer("recover", run.path, "-o", whole).status == 0
    assert incidents(whole)[0].causes[0].cause == "servo-dead"
    assert sniffer("replay", whole, "--redecode").status == 0


def test_a_file_that_begins_while_an_incident_is_open_says_so(
    tmp_path: Path, line: Terminal
) -> None:
    with recorder(tmp_path, line, "--rotate", "60kB") as run:
        go_on(line, BOTH, 1.0)
        until(line, ONE, run, "sniffer: incident 1 on arm: ")

        def is_there() -> bool:
            line.say(ONE)
            return (tmp_path / "run-0003.mcap").exists()

        wait(is_there, "no third file")
        assert run.stop().status == 0
    first = incidents(tmp_path / "run-0003.mcap")[0]
    assert (first.id, first.causes[0].cause) == ("1", "servo-dead")
