"""A recording again: in its own time, from where to where one likes, as often as one likes."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from typing import TYPE_CHECKING

import pytest

from sniffer.decoding.partends import BusEnds, PartEnds
from sniffer.ground.model import NS, Chunk, Clock, DamagedInputError
from sniffer.ground.timing import byte_time_ns
from sniffer.jobs.replay import NAP_S, STEP_NS, nap, paced, peek, steps, timed
from tests.commands import COMMAND, Ran, environment, log, sniffer, talk, within
from tests.terminals import PATIENCE_S

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

Capsys = pytest.CaptureFixture[str]

MS = NS // 1000
T0 = 1_700_000_000 * NS


class Clockwork:
    """A clock that stands still but while somebody sleeps, or works."""

    def __init__(self) -> None:
        self.now_ns = 5 * NS
        self.slept: list[float] = []

    def now(self) -> int:
        return self.now_ns

    def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)
        self.now_ns += round(seconds * NS)


def groups(*at_ms: int) -> list[list[Chunk]]:
    return [[Chunk(b"x", T0 + at * MS, Clock.FILE)] for at in at_ms]


def moments(clock: Clockwork, played: Iterator[list[Chunk]], work_ms: int = 0) -> list[int]:
    """Return when each group was handed out, in ms from the first; each costs some work."""
    out = []
    for _ in played:
        out.append(clock.now_ns)
        clock.now_ns += work_ms * MS
    return [round((t - out[0]) / MS) for t in out]


# --- the pace ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("speed", "expected"),
    [(1, [0, 100, 250, 1000]), (2, [0, 50, 125, 500]), (0.5, [0, 200, 500, 2000])],
)
def test_groups_come_when_they_came(speed: float, expected: list[int]) -> None:
    clock = Clockwork()
    played = paced(groups(0, 100, 250, 1000), speed, now=clock.now, sleep=clock.sleep)
    assert moments(clock, played) == expected


def test_what_one_step_is_late_does_not_delay_the_next() -> None:
    clock = Clockwork()
    played = paced(groups(*range(0, 10_000, 100)), 1, now=clock.now, sleep=clock.sleep)
    assert moments(clock, played, work_ms=70) == list(range(0, 10_000, 100))
    assert len(clock.slept) == 99


def test_after_a_stall_the_replay_catches_up() -> None:
    clock = Clockwork()
    out = []
    for group in paced(groups(0, 100, 200, 300, 400), 1, now=clock.now, sleep=clock.sleep):
        out.append(round((clock.now_ns - 5 * NS) / MS))
        if group[0].t_ns == T0 + 100 * MS:
            clock.now_ns += 250 * MS
    assert out == [0, 100, 350, 350, 400]


def test_speed_0_does_not_wait() -> None:
    clock = Clockwork()
    assert moments(clock, paced(groups(0, 5000), 0, now=clock.now, sleep=clock.sleep)) == [0, 0]
    assert clock.slept == []


def test_a_clock_that_goes_back_is_not_waited_for() -> None:
    clock = Clockwork()
    played = paced(groups(0, 500, 200, 600), 1, now=clock.now, sleep=clock.sleep)
    assert moments(clock, played) == [0, 500, 500, 600]


@pytest.mark.parametrize("set_to", [-3_600_000, 57 * 365 * 86_400_000])
def test_where_the_clock_was_set_the_replay_goes_on_as_it_began(set_to: int) -> None:
    clock = Clockwork()
    later = (set_to + t for t in (300, 400, 900))
    played = paced(groups(0, 250, *later), 1, now=clock.now, sleep=clock.sleep)
    assert moments(clock, played) == [0, 250, 250, 350, 850]


def test_a_step_holds_50_ms_of_the_recording() -> None:
    chunks = [Chunk(b"x", T0 + at * MS) for at in range(0, 1000, 10)]
    played = list(steps(chunks))
    assert [c for group in played for c in group] == chunks
    assert {len(group) for group in played} == {5}


def test_an_input_without_a_clock_has_the_pace_of_its_baud_rate() -> None:
    data = talk(100)
    chunks = list(timed([Chunk(data)], 57600))
    assert b"".join(c.data for c in chunks) == data
    assert chunks[-1].t_ns == len(data) * byte_time_ns(57600)
    assert all(len(c.data) * byte_time_ns(57600) <= STEP_NS for c in chunks)
    clock = Clockwork()
    last = moments(clock, paced(steps(chunks), 1, now=clock.now, sleep=clock.sleep))[-1]
    assert last == pytest.approx(len(data) * 10_000 / 57600, abs=101)  # two steps and their ends


def test_chunks_with_a_time_keep_it() -> None:
    chunks = [Chunk(b"ab", T0, Clock.FILE), Chunk(b"cd", T0 + 7, Clock.FILE)]
    assert list(timed(chunks, 9600)) == chunks


# --- the window --------------------------------------------------------------------------------


def test_what_lies_outside_of_a_window_is_not_waited_for() -> None:
    clock = Clockwork()
    ends = BusEnds(lambda told_ns: PartEnds(T0 + 1000 * MS, T0 + 2000 * MS))
    told = groups(0, 900, 1000, 1500, 2000, 9000)
    played = paced(iter(told), 1.0, ends=ends, now=clock.now, sleep=clock.sleep)
    assert moments(clock, played) == [0, 0, 0, 500, 1000, 1000]


def test_a_peek_gives_everything_again_and_the_damage_in_its_place() -> None:
    def broken() -> Iterator[Chunk]:
        yield from (Chunk(b"abc"), Chunk(b"def"))
        raise DamagedInputError("line 3")

    head, again = peek(broken(), 2)
    assert [c.data for c in head] == [b"abc"]
    assert next(again).data == b"abc"
    head, again = peek(broken(), 100)
    assert [c.data for c in head] == [b"abc", b"def"]
    assert [next(again).data, next(again).data] == [b"abc", b"def"]
    with pytest.raises(DamagedInputError, match="line 3"):
        next(again)


# --- the command -------------------------------------------------------------------------------


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "talk.log"
    path.write_text(log(talk(20)))  # 0.42 s
    return path


def test_a_replay_shows_what_decoding_shows(recording: Path, capsys: Capsys) -> None:
    ran = within(capsys, "replay", recording, "--speed", "0")
    assert (ran.status, ran.content) == (0, True)
    assert ran.out == within(capsys, "decode", recording).out


@pytest.mark.parametrize("data", [talk(3), talk(1)[:20]])
def test_a_replay_of_raw_bytes_shows_what_decoding_shows(
    data: bytes, tmp_path: Path, capsys: Capsys
) -> None:
    path = tmp_path / "raw.bin"
    path.write_bytes(data)
    options = ["--protocol", "mightyzap"]
    ran = within(capsys, "replay", path, "--speed", "0", *options)
    assert ran.out == within(capsys, "decode", path, *options).out


def test_a_replay_of_several_buses_shows_all(recording: Path, capsys: Capsys) -> None:
    lines = recording.read_text().splitlines()
    lines = [x for line in lines for x in (line, line.replace("bus0", "elbow"))]
    recording.write_text("\n".join(lines))
    ran = within(capsys, "replay", recording, "--speed", "0")
    assert ran.status == 0
    assert ran.content
    assert ran.out.count("1800 bytes = 1800 in 140 frames") == 2


def test_a_replay_takes_as_long_as_the_recording(recording: Path, capsys: Capsys) -> None:
    began = time.monotonic()
    assert within(capsys, "replay", recording).status == 0
    assert time.monotonic() - began > 0.42 - 2 * STEP_NS / NS


@pytest.mark.parametrize(
    ("options", "frames"),
    [(["--to", "0.1"], 35), (["--from", "0.1", "--to", "0.2"], 34), (["--from", "0.3"], 41)],
)
def test_a_window_is_played(
    options: list[str], frames: int, recording: Path, capsys: Capsys
) -> None:
    ran = within(capsys, "replay", recording, "--speed", "0", *options)
    assert ran.status == 0
    found = re.search(r"in (\d+) frames", ran.out)
    assert found
    assert abs(int(found[1]) - frames) <= 2


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--from", "9"], "nothing was said from second 9 to its end: "),
        (["--from", "2", "--to", "1"], "--to must lie behind --from"),
        (["--speed", "-1"], "-1.0 is not in the range"),
        (["--speed", "nan"], "'nan' is no number"),
        (["--speed", "inf"], "'inf' is no number"),
        (["--model", "nix"], "no model 'nix'"),
    ],
)
def test_a_wrong_replay_says_what_is_right(
    options: list[str], told: str, recording: Path, capsys: Capsys
) -> None:
    ran = within(capsys, "replay", recording, *options)
    assert (ran.status, ran.out) == (2, "")
    assert told in ran.err.splitlines()[-1]


def test_a_replay_of_nothing_is_a_mistake(tmp_path: Path, capsys: Capsys) -> None:
    path = tmp_path / "empty"
    path.write_bytes(b"")
    assert within(capsys, "replay", path).complaint == f"{path} is empty: nothing to decode"
    assert "no such file" in within(capsys, "replay", tmp_path / "nix").complaint
    ran = sniffer("replay", "-", "--loop", data=b"")
    assert (ran.status, "--loop needs a file" in ran.complaint) == (2, True)


def test_a_replay_of_a_log_that_breaks_off_ends_as_decoding_does(
    recording: Path, capsys: Capsys
) -> None:
    lines = recording.read_text().splitlines()
    recording.write_text("\n".join([*lines[:100], "garbage", *lines[100:]]))
    ran = within(capsys, "replay", recording, "--speed", "0")
    assert ran.status == 3
    assert "line 101" in ran.complaint
    assert ran.out == within(capsys, "decode", recording).out


# --- live --------------------------------------------------------------------------------------

Posix = pytest.mark.skipif(sys.platform == "win32", reason="sends SIGINT to a child")


def playing(path: Path, *options: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*COMMAND, "replay", str(path), *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment(),
    )


@Posix
def test_a_loop_goes_on_until_ctrl_c(recording: Path) -> None:
    with playing(recording, "--loop", "--speed", "20") as process:
        assert process.stdout is not None
        assert process.stderr is not None
        begun = 0
        for line in process.stdout:
            begun += line.startswith("time")
            if begun == 3:
                break
        process.send_signal(signal.SIGINT)
        printed, said = process.stdout.read(), process.stderr.read()
    ran = Ran(process.returncode, printed, said)
    assert ran.status == 130
    assert ran.complaint.startswith("interrupted")
    assert "bytes = " in ran.out
    assert said.count("explains") == 1  # not again in every round


@Posix
def test_a_loop_ends_when_nobody_listens(recording: Path) -> None:
    with playing(recording, "--loop", "--speed", "0") as process:
        assert process.stdout is not None
        assert process.stdout.readline().startswith("time")
        process.stdout.close()
        assert process.wait(PATIENCE_S) == 0


def test_a_long_pause_is_slept_in_pieces_so_that_no_key_is_missed_for_all_of_it() -> None:
    slept: list[float] = []

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        time.sleep(seconds / 10)  # what wakes up too soon sleeps on

    began = time.monotonic()
    nap(0.6, sleep)
    assert time.monotonic() - began >= 0.6
    assert max(slept) <= NAP_S


@Posix
def test_lines_come_while_the_replay_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "slow.log"
    chunks = log(talk(2)).splitlines(keepends=True)
    late = log(talk(1), start_ns=1_700_000_900 * NS)
    path.write_text("".join(chunks) + late)  # a quarter of an hour later
    with playing(path) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdout.readline().startswith("time")
        shown = [process.stdout.readline() for _ in range(14)]
        assert "symmetric_store" in shown[0]
        process.send_signal(signal.SIGINT)
        printed, said = process.stdout.read(), process.stderr.read()
    ran = Ran(process.returncode, printed, said)
    assert ran.status == 130
    assert ran.complaint == "interrupted: what was decoded is kept"
    assert "  180 bytes = 180 in 14 frames (100.00 %) + 0 in 0 gaps\n" in ran.out
