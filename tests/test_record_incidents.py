"""Incidents while they happen: in lines, in the recording, and to who waits for them."""

from __future__ import annotations

import json
import re
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
    """Say the same time and again until the recorder has said something: a regular expression."""

    def look() -> bool:
        go_on(line, data, 0.1)
        return re.search(said, run.said) is not None

    wait(look, f"{said!r} is not said")


def recorder(folder: Path, line: Terminal, *told: str) -> Recorder:
    return Recorder(folder, "arm={}=mightyzap@57600", *told, lines=[line])


def incidents(path: Path) -> list[Any]:
    """Return what a recording has of servos' incidents.

    That the loop of this test is uneven on a busy machine, and says so, is another matter.
    """
    return [m for m in messages(path).get("/incidents", []) if m.servo_ids]


def test_a_servo_that_falls_silent_is_told_recorded_and_reacted_to(
    tmp_path: Path, line: Terminal
) -> None:
    told = ("--on", "servo-dead", "echo $SNIFFER_CAUSE $SNIFFER_SERVOS >> told.txt")
    with recorder(tmp_path, line, *told) as run:
        go_on(line, BOTH, 1.5)
        assert "servo-dead" not in run.said
        until(line, ONE, run, r"sniffer: incident \d+ on arm: servo-dead \(")
        until(line, ONE, run, "incidents=[1-9]")
        ran = run.stop()
    assert ran.status == 0
    assert len(re.findall(r"on arm: servo-dead \(", ran.err)) == 1, "one line when it opens"
    assert len(re.findall(r"on arm goes on at the end: servo-dead \(", ran.err)) == 1
    assert (tmp_path / "told.txt").read_text(encoding="utf-8") == "servo-dead 3\n"
    first, *_, last = found = incidents(run.path)
    assert len({m.id for m in found}) == 1
    assert [m.stage for m in (first, last)] == [OPENED, ENDED]
    assert (last.bus, list(last.servo_ids), last.causes[0].cause) == ("arm", [3], "servo-dead")
    every = json.loads(sniffer("diagnose", run.path, "--format", "json").out)["incidents"]
    (offline,) = (i for i in every if i["servo_ids"])
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
        until(line, ONE, run, r"on arm: servo-dead \(")
        (number,) = re.findall(r"incident (\d+) on arm: servo-dead", run.said)
        until(line, BOTH, run, f"incident {number} on arm is over: ")  # it may have another cause
        assert run.stop().status == 0
    stages = [m.stage for m in incidents(run.path)]
    assert (stages[0], stages[-1]) == (OPENED, OVER)


def test_sound_traffic_has_no_incident_of_a_servo(tmp_path: Path, line: Terminal) -> None:
    with recorder(tmp_path, line) as run:
        go_on(line, BOTH, 3.0)
        assert run.stop().status == 0
    assert incidents(run.path) == []


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
    told = ("--ring", "5s", "--trigger", "servo-dead", "--post", "500ms", "-o", str(tmp_path))
    with recorder(tmp_path, line, *told) as run:
        go_on(line, BOTH, 1.0)
        until(line, ONE, run, r"\d bytes\n")
        assert run.stop().status == 0
    path = tmp_path / "incident-0001.mcap"
    about = facts(path)
    assert (about["trigger"], about["trigger.servo_ids"]) == ("servo-dead", "3")
    assert about["trigger.what"].startswith("servo-dead on arm: a servo that stopped answering")
    assert incidents(path)[0].causes[0].cause == "servo-dead"


@pytest.mark.parametrize(("topics", "there"), [("raw,incidents", True), ("raw,state", False)])
def test_incidents_are_a_topic_that_may_be_left_out(
    tmp_path: Path, line: Terminal, topics: str, there: bool
) -> None:
    with recorder(tmp_path, line, "--topics", topics) as run:
        go_on(line, BOTH, 1.0)
        until(line, ONE, run, r"on arm: servo-dead \(")
        assert run.stop().status == 0
    assert bool(incidents(run.path)) == there


def test_killed_and_recovered_a_recording_keeps_its_incidents(
    tmp_path: Path, line: Terminal
) -> None:
    whole = tmp_path / "whole.mcap"
    with recorder(tmp_path, line) as run:
        go_on(line, BOTH, 1.0)
        until(line, ONE, run, r"on arm: servo-dead \(")
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
        until(line, ONE, run, r"on arm: servo-dead \(")

        def is_there() -> bool:
            line.say(ONE)
            return (tmp_path / "run-0003.mcap").exists()

        wait(is_there, "no third file")
        assert run.stop().status == 0
    first = incidents(tmp_path / "run-0003.mcap")[0]
    assert first.causes[0].cause == "servo-dead"
