"""Recording live: what is said on a line is what stands in the recording, and where it stands."""

from __future__ import annotations

import os
import random
import re
import signal
import threading
from collections import Counter
from contextlib import ExitStack
from typing import TYPE_CHECKING, Final

import pytest

from sniffer.ground.model import Clock, MarkKind
from sniffer.mcapfile.source import chunks
from tests.commands import Ran, conserved, sniffer, talk, within
from tests.lists import each_in_turn
from tests.recorder import (
    Recorder,
    assert_true_to_itself,
    facts,
    frames_recorded,
    marks,
    raw,
    said_by,
    say_slowly,
)
from tests.recordings import messages
from tests.terminals import EVERY_BYTE, LINUX_ONLY, Terminal

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = LINUX_ONLY

TALK: Final = talk(60)
PROTOCOLS: Final = ("mightyzap", "lss", "rs30x", "wck")


@pytest.fixture
def line() -> Iterator[Terminal]:
    with Terminal() as terminal:
        yield terminal


# --- every byte ----------------------------------------------------------------------------------


@each_in_turn(4, "protocol", PROTOCOLS)
def test_what_is_said_is_recorded_and_decoded_as_it_will_be_again(
    tmp_path: Path, line: Terminal, protocol: str
) -> None:
    said = said_by(protocol)
    with Recorder(tmp_path, f"{{}}={protocol}", "--quiet", lines=[line]) as run:
        say_slowly(line, said, 1, 20, 3, 7, 120, 64)
        assert run.stop() == Ran(0, "", "")
    assert raw(run.path) == {"bus0": said}
    assert_true_to_itself(run.path)
    assert facts(run.path)["protocol.bus0"] == protocol
    assert {(c.clock, c.bus) for c in chunks(run.path)} == {(Clock.READ, "bus0")}


def test_the_raw_bytes_alone_are_recorded_where_nothing_else_is_asked_for(
    tmp_path: Path, line: Terminal
) -> None:
    told = ("{}=mightyzap@57600", "--topics", "raw")
    with Recorder(tmp_path, *told, lines=[line]) as run:
        say_slowly(line, TALK, 40)
        ran = run.stop()
    assert ran.status == 0
    assert "bytes recorded, 420 frames" in ran.err, "it is told what was heard all the same"
    assert raw(run.path) == {"bus0": TALK}
    assert set(messages(run.path)) == {"/bus0/raw"}


def test_the_protocol_is_told_from_the_bytes(tmp_path: Path, line: Terminal) -> None:
    with Recorder(tmp_path, "{}@57600", lines=[line]) as run:
        say_slowly(line, TALK, 40)
        ran = run.stop()
    assert ran.status == 0
    assert "sniffer: bus0: mightyzap (sure: explains" in ran.err
    assert "bytes recorded, 420 frames" in ran.err
    assert raw(run.path) == {"bus0": TALK}
    assert_true_to_itself(run.path)
    told = facts(run.path)
    assert (told["baud.bus0"], told["protocol.bus0"]) == ("57600", "mightyzap")


def test_every_byte_and_any_run_of_ff_is_recorded_however_reads_are_cut(
    tmp_path: Path, line: Terminal
) -> None:
    rng = random.Random(5)
    said = TALK + EVERY_BYTE + b"\xff" * 9001 + b"\xff\x00" * 300 + rng.randbytes(20_000) + TALK
    with Recorder(tmp_path, "{}=mightyzap", "--quiet", lines=[line]) as run:
        say_slowly(line, said, 1, 2, 3, 4095, 4096, 1, 500, pause_s=0.0)
        assert run.stop().status == 0
    assert raw(run.path) == {"bus0": said}
    assert marks(run.path) == []
    assert_true_to_itself(run.path)


def test_two_buses_with_names_and_protocols_of_their_own(tmp_path: Path, line: Terminal) -> None:
    left, right = said_by("wck"), said_by("rs30x")
    with Terminal() as other:
        told = ("left={}=wck@115200", "right={}=rs30x@460800", "--quiet")
        with Recorder(tmp_path, *told, lines=[line, other]) as run:
            speaker = threading.Thread(target=say_slowly, args=(line, left, 30))
            speaker.start()
            say_slowly(other, right, 50)
            speaker.join()
            assert run.stop() == Ran(0, "", "")
    assert raw(run.path) == {"left": left, "right": right}
    assert_true_to_itself(run.path)
    told_of = facts(run.path)
    assert told_of["port.left"] == line.path
    assert (told_of["baud.left"], told_of["baud.right"]) == ("115200", "460800")
    assert (told_of["protocol.left"], told_of["protocol.right"]) == ("wck", "rs30x")


def test_eight_buses_at_once_are_all_recorded_each_under_its_own_name(tmp_path: Path) -> None:
    said = {f"bus{n}": said_by(PROTOCOLS[n % 4], seed=n) for n in range(8)}
    with ExitStack() as stack:
        lines = [stack.enter_context(Terminal()) for _ in said]
        told = [f"{{}}={PROTOCOLS[n % 4]}" for n in range(8)]
        run = stack.enter_context(Recorder(tmp_path, *told, "--quiet", lines=lines))
        speakers = [
            threading.Thread(target=say_slowly, args=(at, data, 60))
            for at, data in zip(lines, said.values(), strict=True)
        ]
        for speaker in speakers:
            speaker.start()
        for speaker in speakers:
            speaker.join()
        assert run.stop() == Ran(0, "", "")
    assert raw(run.path) == said
    assert_true_to_itself(run.path)
    assert frames_recorded(run.path).keys() == said.keys()


def test_the_recording_says_what_it_was_made_with(tmp_path: Path, line: Terminal) -> None:
    with Recorder(tmp_path, "arm={}=mightyzap@57600", "--latency", "4", lines=[line]) as run:
        line.say(TALK)
        run.wait_for(len(TALK), "arm")
        assert run.stop().status == 0
    told = facts(run.path)
    assert told["source"] == told["port.arm"] == told["port.arm.device"] == line.path
    assert told["latency_ns.arm"] == "4000000"
    assert told["baud.arm"] == told["port.arm.baud_got"] == "57600"
    assert told["port.arm.locked"] == "yes"
    stamps = [c.t_ns or 0 for c in chunks(run.path)]
    assert told["clock"].startswith("monotonic")
    assert 0 <= stamps[0] - int(told["clock_wall_ns"]) < 3600e9
    assert int(told["clock_monotonic_ns"]) > 0
    assert stamps == sorted(stamps)
    # the same latency, and so the same uncertainty, without a word from anybody
    # (a busy reader says how late it comes, and some frames are read in two)
    marks = [m for c in chunks(run.path) for m in c.marks if m.kind == MarkKind.HELD]
    held_ns = max((m.count for m in marks), default=0)
    found = Counter(f[3] for f in frames_recorded(run.path)["arm"])
    assert 4_000_000 <= found.most_common(1)[0][0] <= 4_000_000 + held_ns
    assert_true_to_itself(run.path)


# --- what is shown beside it ---------------------------------------------------------------------


def test_without_a_terminal_there_is_a_line_a_second_and_the_result(
    tmp_path: Path, line: Terminal
) -> None:
    with Recorder(tmp_path, "{}=mightyzap", lines=[line]) as run:
        line.say(TALK)
        run.wait_until(lambda: f"bytes={len(TALK)} frames=420 " in run.said, "no line")
        ran = run.stop()
    assert ran.out == ""
    *_, stopped, result = ran.err.splitlines()
    assert stopped == "sniffer: stopped: SIGTERM"
    assert re.fullmatch(
        rf"sniffer: {len(TALK)} bytes recorded, 420 frames, 0 bytes in no frame, \d+ anomalies: "
        + re.escape(str(run.path)),
        result,
    )


def test_the_log_has_a_line_for_each_frame_on_standard_output(
    tmp_path: Path, line: Terminal
) -> None:
    with Recorder(tmp_path, "{}=mightyzap", "--log", lines=[line]) as run:
        line.say(TALK)
        run.wait_for(len(TALK))
        ran = run.stop()
    assert len(re.findall(r"(?m)^\d\d:\S+ +(?:\S+ +)?\d+ [<>] ", ran.out)) == 420
    assert "elapsed=" not in ran.err
    assert raw(run.path) == {"bus0": TALK}


def test_a_log_shows_what_is_selected_and_all_of_it_is_recorded(
    tmp_path: Path, line: Terminal
) -> None:
    asked = ("--log", "--kind", "request")
    with Recorder(tmp_path, "{}=mightyzap", *asked, lines=[line]) as run:
        line.say(TALK)
        run.wait_for(len(TALK))
        ran = run.stop()
    requests = len(re.findall(r"(?m)^\d\d:\S+ +(?:\S+ +)?\d+ > ", ran.out))
    assert f"\nselection, kind = 'request': {requests} of 420 frames\n" in ran.out
    assert 0 < requests < 420
    assert not re.search(r"(?m)^\d\d:\S+ +(?:\S+ +)?\d+ < ", ran.out)
    assert raw(run.path) == {"bus0": TALK}


@pytest.mark.parametrize("mode", ["--quiet", "--log", None])
def test_statistics_are_printed_when_a_signal_asks_and_the_recording_goes_on(
    tmp_path: Path, line: Terminal, mode: str | None
) -> None:
    told = [mode] if mode is not None else []
    with Recorder(tmp_path, "arm={}=mightyzap", *told, lines=[line]) as run:
        line.say(TALK)
        run.wait_for(len(TALK), "arm")
        before = run.said
        run.tell(signal.SIGUSR1)
        # of the lines a second only statistics name the port
        name = f"{len(TALK)} bytes" if mode == "--quiet" else line.path
        run.wait_until(lambda: name in run.said.removeprefix(before), "no statistics")
        assert "arm" in run.said
        assert mode != "--quiet" or f"arm ({line.path}): {len(TALK)} bytes" in run.said
        line.say(TALK)
        assert run.stop().status == 0
    assert raw(run.path) == {"arm": TALK * 2}


# --- files ---------------------------------------------------------------------------------------


def test_without_a_name_the_recording_is_called_by_date_and_time(
    tmp_path: Path, line: Terminal
) -> None:
    command = ("record", f"{line.path}=wck", "--duration", "0.2", "--quiet")
    done = sniffer(*command, before=("env", "-C", str(tmp_path)))
    assert done.status == 0
    names = [path.name for path in tmp_path.glob("*.mcap")]
    assert len(names) == 1
    assert re.fullmatch(r"sniffer-\d{8}-\d{6}\.mcap", names[0])


def test_several_outputs_hold_the_same(tmp_path: Path, line: Terminal) -> None:
    outputs = [tmp_path / name for name in ("run.mcap", "run.jsonl", "run.parquet", "run.csv")]
    told = [word for path in outputs for word in ("-o", str(path))]
    with Recorder(tmp_path, "{}=mightyzap", "--quiet", *told, lines=[line]) as run:
        say_slowly(line, TALK, 33)
        assert run.stop() == Ran(0, "", "")
    assert raw(run.path) == {"bus0": TALK}
    assert conserved((tmp_path / "run.jsonl").read_text(encoding="utf-8")) == TALK
    rows = (tmp_path / "run.frames.csv").read_text(encoding="utf-8").splitlines()
    assert len(rows) == 421
    assert (tmp_path / "run.frames.parquet").stat().st_size > 1000


def test_without_a_recording_among_them_the_outputs_are_written_all_the_same(
    tmp_path: Path, line: Terminal
) -> None:
    out = tmp_path / "run.jsonl"
    with Recorder(tmp_path, "{}=mightyzap", "-o", out, lines=[line]) as run:
        line.say(TALK)
        run.wait_until(lambda: "frames=420" in run.said, "not decoded")
        run.tell(signal.SIGHUP)  # there is no file to be begun anew
        run.tell(signal.SIGUSR1)
        ran = run.stop()
    assert ran.status == 0
    assert conserved(out.read_text(encoding="utf-8")) == TALK
    assert list(tmp_path.glob("*.mcap")) == []


@each_in_turn(
    2,
    ("there", "output"),
    [
        ("x.mcap", "x.mcap"),
        ("x.jsonl", "x.jsonl"),
        ("x.parquet", "x.parquet"),
        ("x.frames.parquet", "x.parquet"),
        ("x.frames.csv", "x.csv"),
    ],
)
def test_a_file_that_is_there_is_not_replaced_unless_that_is_asked_for(
    tmp_path: Path,
    line: Terminal,
    capsys: pytest.CaptureFixture[str],
    there: str,
    output: str,
) -> None:
    kept = tmp_path / there
    kept.write_bytes(b"dear to somebody")
    told = ("--duration", "0.1", "--quiet")
    command = ("record", f"{line.path}=wck", "-o", tmp_path / output, *told)
    ran = within(capsys, *command)
    assert ran.status == 2
    assert ran.complaint == f"{kept} is there already: choose another name, or --force"
    assert kept.read_bytes() == b"dear to somebody"
    assert list(tmp_path.iterdir()) == [kept]
    assert within(capsys, *command, "--force").status == 0
    assert kept.read_bytes() != b"dear to somebody"


def test_the_files_of_a_row_do_not_mix_with_another_one(
    tmp_path: Path, line: Terminal, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = tmp_path / "x-0003.mcap"
    kept.write_bytes(b"dear to somebody")
    command = ("record", f"{line.path}=wck", "-o", tmp_path / "x.mcap", "--rotate", "1MB")
    ran = within(capsys, *command, "--duration", "0.1", "--quiet")
    assert ran.status == 2
    assert ran.complaint.startswith(f"{kept} is there already")
    assert list(tmp_path.iterdir()) == [kept]


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("-o", "x.mcap", "-o", "y.mcap"), "one .mcap is enough: give -o only one of them"),
        (("-o", "x.mcap", "-o", "y.txt"), "y.txt: the suffix must be one of "),
        (("-o", "x.mcap", "-o", "no/y.jsonl"), "there is no folder "),
        (("-o", "no/x.mcap"), "there is no folder "),
        (("-o", "x.jsonl", "-o", "x.jsonl"), "x.jsonl would be written twice"),
        (("-o", "x.mcap", "--keep", "3"), "--keep goes with --rotate"),
        (("-o", "x.mcap", "--topics", "raw,sate"), "'sate' is no topic: one of raw, frames,"),
        (("-o", "x.jsonl", "--topics", "raw"), "--topics is about a recording"),
        (("-o", "x.jsonl", "--rotate", "1MB"), "--rotate and --keep are about a recording"),
        (("-o", "x.mcap", "--log", "--quiet"), "--log prints, --quiet does not: choose one"),
        (("-o", "x.mcap", "--rerun", "--web"), "choose one of --rerun, --web"),
        (("-o", "x.mcap", "--rotate", "1"), "'1' is no size or time"),
        (("-o", "x.mcap", "--until", "nonsense"), "no code or cause 'nonsense'"),
        (("-o", "x.mcap", "--pair"), "--pair takes two ports"),
    ],
)
def test_a_mistake_is_told_in_one_line_and_leaves_no_file(
    tmp_path: Path,
    line: Terminal,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[str, ...],
    complaint: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    ran = within(capsys, "record", line.path, *arguments)
    assert ran.status == 2
    assert complaint in ran.complaint
    assert ran.out == ""
    assert os.listdir(tmp_path) == []  # noqa: PTH208
    assert line.answers() == b""
