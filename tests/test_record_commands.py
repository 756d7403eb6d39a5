"""Commands that a recording runs, by a real shell: once an incident, and never in its way."""

from __future__ import annotations

import contextlib
import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

import pytest

from tests.commands import sniffer
from tests.recorder import Recorder, raw
from tests.streams.mightyzap import packet
from tests.terminals import LINUX_ONLY, Terminal, wait

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = LINUX_ONLY

SOUND: Final = packet(1, 0xF2, b"\x8c\x02") + packet(1, 0, b"\xff\x07")


def unanswered(servo: int) -> bytes:
    return packet(servo, 0xF2, b"\x8c\x02") + SOUND


@pytest.fixture
def line() -> Iterator[Terminal]:
    with Terminal() as terminal:
        yield terminal


def recorder(folder: Path, line: Terminal, *told: str) -> Recorder:
    return Recorder(folder, "arm={}=mightyzap@57600", *told, lines=[line])


def lines_of(path: Path) -> list[str]:
    with contextlib.suppress(FileNotFoundError):
        return path.read_text(encoding="utf-8").splitlines()
    return []


def zombies(parent: int) -> list[str]:
    """Return the dead children of a process that nobody has asked for."""
    found = []
    for place in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            fields = place.read_text().rpartition(")")[2].split()
            if fields[0] == "Z" and int(fields[1]) == parent:
                found.append(place.parent.name)
    return found


def test_a_command_is_run_once_an_incident_and_knows_what_happened(
    tmp_path: Path, line: Terminal
) -> None:
    out = tmp_path / "told.txt"
    command = (
        'echo "$SNIFFER_CAUSE|$SNIFFER_SERVOS|$SNIFFER_BUS|$SNIFFER_WHAT" >> told.txt;'
        ' test "$SNIFFER_T_NS" -gt 1700000000000000000 && echo seen'
    )
    before_ns = time.time_ns()
    with recorder(tmp_path, line, "--on", "no-response", command) as run:
        for _ in range(20):
            line.say(unanswered(2) + SOUND)
        line.say(unanswered(3))
        wait(lambda: len(lines_of(out)) >= 2, "it is not run")
        run.wait_until(lambda: "on no-response: seen" in run.said, "what it says is not told")
        for _ in range(20):
            line.say(unanswered(2) + SOUND)
        time.sleep(0.5)
        assert zombies(run.process.pid) == []
        ran = run.stop()
    assert ran.status == 0
    assert sorted(lines_of(out)) == [
        f"no-response|{n}|arm|servo {n} did not answer load_data" for n in (2, 3)
    ]
    assert before_ns > 0
    assert b"".join(raw(run.path).values()).count(unanswered(2)) == 40


def test_a_command_that_fails_is_told_once_and_the_recording_goes_on(
    tmp_path: Path, line: Terminal
) -> None:
    told = ("--on", "no-response", "no-such-command; exit 3", "--quiet")
    with recorder(tmp_path, line, *told) as run:
        for servo in (2, 3, 4):
            line.say(unanswered(servo) * 3)
        run.wait_until(lambda: "exit 3" in run.said, "the failure is not told")
        time.sleep(0.5)
        ran = run.stop()
    assert ran.status == 0
    (said,) = ran.err.splitlines()
    assert said.startswith(
        "sniffer: on no-response: `no-such-command; exit 3` ended with status 3: "
    )
    assert said.endswith("not found; the recording goes on")
    assert len(raw(run.path)["arm"]) == 3 * len(unanswered(2) * 3)


def test_commands_that_take_long_hold_nothing_up_and_are_four_at_once(
    tmp_path: Path, line: Terminal
) -> None:
    command = "echo $$ >> begun.txt; exec sleep 600"
    begun = tmp_path / "begun.txt"
    with recorder(tmp_path, line, "--on", "no-response", command) as run:
        for servo in range(2, 40):
            line.say(unanswered(servo))
        wait(lambda: len(lines_of(begun)) == 4, "they are not run")
        line.say(SOUND)
        size = sum(len(unanswered(n)) for n in range(2, 40)) + len(SOUND)
        run.wait_for(size, "arm")
        time.sleep(0.5)
        assert len(lines_of(begun)) == 4
        ran = run.stop()
    pids = [int(pid) for pid in lines_of(begun)]
    assert ran.status == 0
    assert ran.err.count("a command that was started still runs, as process ") == 4
    assert "18 commands were left out: too many were due" in ran.err
    for pid in pids:
        os.kill(pid, 9)


def test_a_command_that_says_a_lot_or_leaves_something_behind_is_not_waited_for(
    tmp_path: Path, line: Terminal
) -> None:
    command = "yes loud | head -c 3000000; sleep 100 & echo $! > left.txt"
    with recorder(tmp_path, line, "--on", "no-response", command) as run:
        line.say(unanswered(2))
        run.wait_until(lambda: "on no-response: loud loud" in run.said, "it is not over")
        assert run.stop().status == 0
    os.kill(int(lines_of(tmp_path / "left.txt")[0]), 9)


def test_what_ends_a_recording_is_reacted_to_as_well(tmp_path: Path, line: Terminal) -> None:
    told = ("--until", "no-response", "--on", "no-response", "echo over > over.txt")
    with recorder(tmp_path, line, *told) as run:
        line.say(unanswered(2))
        ran = run.ended()
    assert "stopped: no-response on arm: servo 2 did not answer load_data" in ran.err
    assert lines_of(tmp_path / "over.txt") == ["over"]


def test_a_mistake_in_what_a_command_is_run_on_is_told(tmp_path: Path) -> None:
    ran = sniffer("record", "/dev/null", "--on", "no-reponse", "true")
    assert ran.status == 2
    assert ran.complaint.endswith("no code or cause 'no-reponse': did you mean no-response?")
