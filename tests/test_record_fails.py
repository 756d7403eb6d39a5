"""What goes wrong while recording: a full disk, a dead reader, a terminal that goes away."""

from __future__ import annotations

import os
import random
import re
import signal
import time
from typing import TYPE_CHECKING

import pytest

from sniffer.mcapfile.recover import recover
from tests.commands import conserved, sniffer
from tests.disks import disk
from tests.recorder import (
    Patient,
    Recorder,
    assert_true_to_itself,
    raw,
    say_slowly,
    so_far,
)
from tests.terminals import LINUX_ONLY, Terminal
from tests.test_record_ends import TALK, says_until_it_ends

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = LINUX_ONLY


@pytest.fixture
def line() -> Iterator[Patient]:
    with Patient() as terminal:
        yield terminal


def assert_usable(path: Path, said: bytes, tmp_path: Path) -> None:
    """What was written before the disk was full can be read, replayed and recovered."""
    kept = so_far(path)["bus0"]
    assert len(kept) > 10_000
    assert said.startswith(kept)
    decoded = sniffer("decode", path, "--format", "jsonl")
    assert decoded.status == 0
    assert conserved(decoded.out) == kept
    again = sniffer("replay", path, "--redecode")  # of the last bytes no frame was recorded
    assert re.search(r"[1-9]\d* frames,? the same", again.out)  # all of them, or all but a few
    assert again.status == 0 or " 0 read otherwise, 0 only in the recording, " in again.out
    whole = tmp_path / "whole.mcap"
    recover(path, whole)
    assert raw(whole)["bus0"] == kept


def test_a_file_that_may_not_grow_ends_the_recording_with_one_line(
    tmp_path: Path, line: Patient
) -> None:
    def limit() -> None:
        import resource

        resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))

    with Recorder(tmp_path, "{}=mightyzap", "--quiet", lines=[line], preexec_fn=limit) as run:
        said = says_until_it_ends(line, run)
        ran = run.ended()
    assert ran.status == 2
    assert ran.complaint == (
        f"{run.path}: cannot be written (File too large); what was recorded before is kept"
    )
    assert_usable(run.path, said, tmp_path)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    with disk(tmp_path / "disk", "320k") as folder:
        yield folder


def test_a_full_disk_ends_the_recording_with_one_line(
    tmp_path: Path, line: Patient, small_disk: Path
) -> None:
    path = small_disk / "run.mcap"
    with Recorder(tmp_path, "{}=mightyzap", "--quiet", "-o", path, lines=[line]) as run:
        said = says_until_it_ends(line, run)
        ran = run.ended()
    assert ran.status == 2
    assert ran.complaint == (
        f"{path}: cannot be written (No space left on device); what was recorded before is kept"
    )
    assert_usable(path, said, tmp_path)


@pytest.mark.parametrize("quiet", [True, False])
def test_another_output_that_fails_is_told_and_the_recording_goes_on(
    tmp_path: Path, line: Patient, quiet: bool
) -> None:
    full = tmp_path / "run.jsonl"
    full.symlink_to("/dev/full")
    told = ["-o", str(tmp_path / "run.mcap"), "-o", str(full), *(["--quiet"] if quiet else [])]
    with Recorder(tmp_path, "{}=mightyzap", *told, lines=[line]) as run:
        complaint = f"sniffer: {full}: cannot be written (No space left on device)"
        said = 0
        while not (told_of := complaint in run.said) or said < 9:
            if line.takes_more():
                line.say(TALK)
                said += 1
            time.sleep(0.15)
            assert told_of or run.process.poll() is None
        ran = run.stop()
    assert ran.status == 2
    assert ran.err.count(complaint) == 1
    if quiet:
        assert ran.complaint
    assert raw(run.path) == {"bus0": TALK * said}
    assert_true_to_itself(run.path)


def test_where_no_output_is_left_the_recording_ends(tmp_path: Path, line: Patient) -> None:
    full = tmp_path / "run.jsonl"
    full.symlink_to("/dev/full")
    with Recorder(tmp_path, "{}=mightyzap", "-o", full, lines=[line]) as run:
        says_until_it_ends(line, run)
        ran = run.ended()
    assert ran.status == 2
    assert "cannot be written (No space left on device)" in ran.err.splitlines()[-1]


# --- what nobody understands ---------------------------------------------------------------------


def test_what_speaks_no_known_protocol_is_recorded_and_told_in_one_line(
    tmp_path: Path, line: Patient
) -> None:
    said = random.Random(3).randbytes(6000)
    with Recorder(tmp_path, "arm={}", "--quiet", lines=[line]) as run:
        say_slowly(line, said, 100)
        ran = run.stop()
    assert ran.status == 0
    assert ran.complaint == (
        "arm: its protocol could not be told from 6000 bytes: they are recorded; "
        "decode them with --protocol, or see `sniffer doctor`"
    )
    assert raw(run.path) == {"arm": said}


def test_what_speaks_another_protocol_than_was_said_is_told_in_one_line(
    tmp_path: Path, line: Patient
) -> None:
    with Recorder(tmp_path, "{}=rs30x", "--quiet", lines=[line]) as run:
        say_slowly(line, TALK, 100)
        ran = run.stop()
    assert ran.status == 0
    assert ran.complaint.startswith(
        "bus0: no frame of rs30x so far, it looks like mightyzap (sure: "
    )
    assert raw(run.path) == {"bus0": TALK}


@pytest.mark.parametrize("quiet", [True, False])
def test_where_nothing_is_heard_the_doctor_is_recommended(
    tmp_path: Path, line: Patient, quiet: bool
) -> None:
    told = ["--duration", "0.3", *(["--quiet"] if quiet else [])]
    with Recorder(tmp_path, "{}=wck", *told, lines=[line]) as run:
        ran = run.ended()
    assert ran.status == 0
    advice = f"sniffer: no byte was heard; `sniffer doctor {line.path}` tells more"
    stopped = [] if quiet else ["sniffer: stopped: 0.3 s are over"]
    lines = [told for told in ran.err.splitlines() if not told.startswith("elapsed=")]
    assert lines == [*stopped, advice]


# --- who looks on --------------------------------------------------------------------------------


@pytest.mark.parametrize("quiet", [True, False])
def test_a_terminal_that_goes_away_ends_nothing_and_spoils_nothing(
    tmp_path: Path, line: Patient, quiet: bool
) -> None:
    with Terminal() as window:
        slave = os.open(window.path, os.O_RDWR | os.O_NOCTTY)
        told = ["--quiet"] if quiet else []
        with Recorder(tmp_path, "{}", *told, lines=[line], into=slave) as run:
            os.close(slave)
            say_slowly(line, TALK[:2700], 90)
            window.hang_up()
            say_slowly(line, TALK[2700:], 90)
            run.tell(signal.SIGUSR1)
            assert run.stop().status == 0
    assert raw(run.path) == {"bus0": TALK}
    assert_true_to_itself(run.path)


def test_a_terminal_that_stands_still_stops_nothing(tmp_path: Path, line: Patient) -> None:
    import termios

    with Terminal() as window:
        slave = os.open(window.path, os.O_RDWR | os.O_NOCTTY)
        with Recorder(tmp_path, "{}=mightyzap", lines=[line], into=slave) as run:
            termios.tcflow(slave, termios.TCOOFF)  # what Ctrl-S does
            for _ in range(3):
                line.say(TALK)
                time.sleep(0.2)
            run.wait_for(3 * len(TALK))
            assert run.stop().status == 0
        os.close(slave)
    assert raw(run.path) == {"bus0": TALK * 3}
