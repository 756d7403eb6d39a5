"""How a recording ends, and begins a new file: conditions, signals, a full disk, a dead reader."""

from __future__ import annotations

import re
import signal
import time
from functools import partial
from typing import TYPE_CHECKING, Final

import pytest

from sniffer.mcapfile.source import chunks
from tests.commands import Ran, damaged, talk
from tests.recorder import (
    Patient,
    Recorder,
    assert_true_to_itself,
    codes,
    facts,
    frames_again,
    raw,
    say_slowly,
    so_far,
)
from tests.recordings import messages
from tests.streams.mightyzap import packet
from tests.terminals import LINUX_ONLY, wait

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


pytestmark = LINUX_ONLY

TALK: Final = talk(60)
LITTLE: Final = talk(10)


@pytest.fixture
def line() -> Iterator[Patient]:
    with Patient() as terminal:
        yield terminal


def frames(path: Path) -> int:
    return len(messages(path).get("/bus0/frames", []))


def says_until_it_ends(line: Patient, run: Recorder, size: int | None = None) -> bytes:
    """Speak until the recorder has ended by itself, or its file has the size."""
    said = b""
    while run.process.poll() is None and not (size and run.path.stat().st_size >= size):
        if line.takes_more():
            line.say(LITTLE)
            said += LITTLE
        time.sleep(0.03)
    return said


# --- conditions ----------------------------------------------------------------------------------


def test_a_recording_ends_when_its_time_is_over(tmp_path: Path, line: Patient) -> None:
    began = time.monotonic()
    with Recorder(tmp_path, "{}=mightyzap", "--duration", "4s", lines=[line]) as run:
        line.say(TALK)
        ran = run.ended()
    assert time.monotonic() - began > 4
    assert ran.status == 0
    assert "sniffer: stopped: 4 s are over\n" in ran.err
    assert raw(run.path) == {"bus0": TALK}
    assert_true_to_itself(run.path)


def test_a_recording_ends_when_it_has_the_size_that_was_asked_for(
    tmp_path: Path, line: Patient
) -> None:
    with Recorder(tmp_path, "{}=mightyzap", "--max-size", "100kB", lines=[line]) as run:
        said = says_until_it_ends(line, run, size=100_000)  # and then it ends by itself
        ran = run.ended()
    assert ran.status == 0
    assert "bytes are written" in ran.err
    assert run.path.stat().st_size >= 100_000
    assert said.startswith(raw(run.path)["bus0"])
    assert_true_to_itself(run.path)


def test_a_recording_ends_when_it_has_enough_frames(tmp_path: Path, line: Patient) -> None:
    with Recorder(tmp_path, "{}=mightyzap", "--frames", "420", "--quiet", lines=[line]) as run:
        half = talk(30)
        line.say(half)
        run.wait_for(len(half))
        time.sleep(0.3)
        assert run.process.poll() is None
        line.say(TALK.removeprefix(half))
        assert run.ended() == Ran(0, "", "")
    assert raw(run.path) == {"bus0": TALK}
    assert frames(run.path) == 420


def test_a_recording_ends_when_nothing_is_said_any_more(tmp_path: Path, line: Patient) -> None:
    with Recorder(tmp_path, "{}=mightyzap", "--idle", "4s", lines=[line]) as run:
        for _ in range(4):
            if run.process.poll() is None:  # else this machine said nothing for so long
                line.say(TALK)
            time.sleep(0.2)
        ran = run.ended()
    assert ran.status == 0
    told = re.search(r"sniffer: stopped: no byte for (\d+\.\d) s", ran.err)
    assert told is not None
    assert float(told[1]) >= 4  # it says how long it was, which is what this machine made of it
    assert (TALK * 4).startswith(raw(run.path).get("bus0", b""))
    times = [chunk.t_ns or 0 for chunk in chunks(run.path)]
    last = max(t for t, chunk in zip(times, chunks(run.path), strict=True) if chunk.data)
    assert times[-1] - last >= 4e9  # the mark of the end is as long behind the last byte


def test_a_recording_ends_at_an_anomaly_that_was_waited_for(tmp_path: Path, line: Patient) -> None:
    said = damaged(TALK)
    told = ("--until", "bad-checksum", "--until", "port-lost")
    with Recorder(tmp_path, "{}=mightyzap", *told, lines=[line]) as run:
        line.say(TALK)
        run.wait_for(len(TALK))
        time.sleep(0.3)
        assert run.process.poll() is None
        line.say(said)
        ran = run.ended()
    assert ran.status == 0
    assert "sniffer: stopped: bad-checksum on bus0: " in ran.err
    assert raw(run.path) == {"bus0": TALK + said}
    assert "bad-checksum" in codes(run.path)


# --- signals -------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_what_was_said_before_the_signal_is_in_the_recording(
    tmp_path: Path, line: Patient, number: signal.Signals
) -> None:
    with Recorder(tmp_path, "{}=mightyzap", "--quiet", lines=[line]) as run:
        for _ in range(20):
            line.say(TALK)
        assert run.stop(number) == Ran(0, "", "")
    assert raw(run.path) == {"bus0": TALK * 20}
    assert frames(run.path) == 420 * 20
    assert_true_to_itself(run.path)


def test_the_second_ctrl_c_leaves_a_whole_recording_too(tmp_path: Path, line: Patient) -> None:
    with Recorder(tmp_path, "{}=mightyzap", "--quiet", lines=[line]) as run:
        line.say(TALK)
        run.wait_for(len(TALK))
        run.tell(signal.SIGTERM)
        run.tell(signal.SIGINT)
        assert run.ended().status in (0, 130)  # 0 where it had ended by then
    assert raw(run.path) == {"bus0": TALK}


def test_a_signal_while_it_begins_ends_it_in_order(tmp_path: Path, line: Patient) -> None:
    import termios

    run = Recorder(tmp_path, f"{line.path}=mightyzap", "--quiet")
    wait(lambda: bool(line.settings()[0] & termios.PARMRK), "nobody listens")
    ran = run.stop()
    assert ran.status == 0
    assert ran.complaint == f"no byte was heard; `sniffer doctor {line.path}` tells more"
    assert raw(run.path) == {}


def _has(folder: Path, size: int) -> bool:
    """Tell whether the recording's files hold so many bytes."""
    return sum(len(so_far(path).get("bus0", b"")) for path in folder.glob("*.mcap")) >= size


def _says(run: Recorder, words: str) -> bool:
    return words in run.said


@pytest.mark.parametrize("rotates", [False, True])
def test_a_hangup_signal_begins_a_new_file(tmp_path: Path, line: Patient, rotates: bool) -> None:
    told = ["--rotate", "1GB"] if rotates else []
    first = "run-0001.mcap" if rotates else "run.mcap"
    names = [first, "run-0002.mcap", "run-0003.mcap"]
    paths = [tmp_path / name for name in names]
    with Recorder(tmp_path, "{}=mightyzap", *told, lines=[line]) as run:
        for nth, path in enumerate(paths):
            line.say(TALK)
            run.wait_for(len(TALK), path=path)
            # what was asked last may still be answered: until it is, it is not counted
            counted = f" frames={420 * (nth + 1)} "
            run.wait_until(partial(_says, run, counted), "not decoded")
            if nth < 2:
                run.tell(signal.SIGHUP)
                run.wait_until(paths[nth + 1].exists, "no new file")
        ran = run.stop()
    assert ran.status == 0
    assert ran.err.splitlines()[-1].endswith(", ".join(map(str, paths)))
    assert sorted(path.name for path in tmp_path.glob("*.mcap")) == sorted(names)
    assert [raw(path)["bus0"] for path in paths] == [TALK] * 3
    for nth, path in enumerate(paths):
        assert_true_to_itself(path, alone=not nth)
        assert facts(path)["part"] == str(nth + 1)


def test_files_of_a_size_joined_are_all_that_was_said(tmp_path: Path, line: Patient) -> None:
    with Recorder(tmp_path, "{}=mightyzap", "--rotate", "40kB", "--quiet", lines=[line]) as run:
        said = 0
        while not (tmp_path / "run-0003.mcap").exists():
            say_slowly(line, TALK, 45)
            said += 1
            run.wait_until(partial(_has, tmp_path, said * len(TALK)), "not recorded")
        assert run.stop() == Ran(0, "", "")
    paths = sorted(tmp_path.glob("*.mcap"))
    assert raw(*paths) == {"bus0": TALK * said}  # nothing is missing, nothing stands in two files
    assert sum(map(frames, paths)) == len(frames_again(*paths)["bus0"]) > 400 * said
    for path in filter(frames, paths):
        assert_true_to_itself(path, alone=path == paths[0])


def test_of_a_row_of_files_the_last_ones_are_kept(tmp_path: Path, line: Patient) -> None:
    told = ("--rotate", "60kB", "--rotate", "1h", "--keep", "2")
    with Recorder(tmp_path, "{}=mightyzap", *told, lines=[line]) as run:
        said = 0
        while not (tmp_path / "run-0004.mcap").exists():
            say_slowly(line, TALK, 90)
            said += 1
        ran = run.stop()
    paths = sorted(tmp_path.glob("*.mcap"))
    assert len(paths) == 2
    assert ran.err.splitlines()[-1].endswith(", ".join(map(str, paths)))
    kept = raw(*paths)["bus0"]
    assert len(kept) > 500
    assert (TALK * said).endswith(kept)


def test_a_recorder_that_was_stopped_for_a_while_says_how_old_its_bytes_may_be_and_goes_on(
    tmp_path: Path, line: Patient
) -> None:
    """Ctrl-Z and fg, or a laptop that sleeps: the bus spoke all the time."""
    frame = packet(1, 0xF2, b"\x8c\x02")
    written: list[int] = []

    def speak(seconds: float) -> None:
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            written.append(time.time_ns())
            line.say(frame)
            time.sleep(0.004)

    with Recorder(tmp_path, "{}=mightyzap@115200", "--idle", "2s", lines=[line]) as run:
        speak(0.5)
        run.tell(signal.SIGSTOP)
        speak(3)
        run.tell(signal.SIGCONT)
        speak(1)
        ran = run.ended()
    assert "stopped: no byte for 2." in ran.err
    rows = frames_again(run.path)["bus0"]
    assert len(rows) == len(written)
    late = [
        t_ns - unsure - said for (_, _, t_ns, unsure, _), said in zip(rows, written, strict=True)
    ]
    assert max(late) < 200_000_000
    assert "late-read" in codes(run.path)
