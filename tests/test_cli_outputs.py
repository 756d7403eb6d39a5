"""What a command writes to: nothing that somebody may want to keep is replaced or emptied."""

from __future__ import annotations

import csv
import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from sniffer.mcapfile.recover import recover
from sniffer.mcapfile.source import chunks
from sniffer.sinks import SINKS
from tests.commands import COMMAND, Ran, sniffer, talk, within
from tests.lists import each_in_turn
from tests.recordings import keep
from tests.recordings import talk as simulated

if TYPE_CHECKING:
    from collections.abc import Callable

    Capsys = pytest.CaptureFixture[str]

DEAR = b"dear to somebody"

posix = pytest.mark.skipif(sys.platform == "win32", reason="needs pipes and links of POSIX")


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "from.mcap"
    keep(path, [simulated("mightyzap", 0.2)])
    return path


@pytest.mark.parametrize("suffix", SINKS)
def test_a_file_that_is_there_is_replaced_only_where_that_is_asked_for(
    suffix: str, good: Path, tmp_path: Path, capsys: Capsys
) -> None:
    kept = tmp_path / f"x{suffix}"
    kept.write_bytes(DEAR)
    command = ("decode", good, "--quiet", "-o", kept)
    ran = within(capsys, *command)
    assert (ran.status, ran.out) == (2, "")
    assert ran.complaint == f"{kept} is there already: choose another name, or --force"
    assert kept.read_bytes() == DEAR
    assert sorted(tmp_path.iterdir()) == sorted([good, kept])
    assert within(capsys, *command, "--force").status == 0
    assert kept.read_bytes() != DEAR


def test_the_second_file_of_a_table_counts_too(good: Path, tmp_path: Path, capsys: Capsys) -> None:
    kept = tmp_path / "x.frames.csv"
    kept.write_bytes(DEAR)
    ran = within(capsys, "decode", good, "-o", tmp_path / "x.csv")
    assert ran.complaint == f"{kept} is there already: choose another name, or --force"
    assert sorted(tmp_path.iterdir()) == sorted([good, kept])


def test_a_link_is_as_dear_as_what_it_leads_to(good: Path, tmp_path: Path, capsys: Capsys) -> None:
    kept, link = tmp_path / "kept.mcap", tmp_path / "link.mcap"
    kept.write_bytes(DEAR)
    link.symlink_to(kept)
    ran = within(capsys, "decode", good, "--quiet", "-o", link)
    assert ran.complaint == f"{link} is there already: choose another name, or --force"
    assert within(capsys, "decode", good, "--quiet", "-o", link, "--force").status == 0
    assert link.is_symlink()
    assert list(chunks(kept))


@pytest.mark.parametrize("suffix", SINKS)
def test_an_empty_file_is_nobodys(suffix: str, good: Path, tmp_path: Path, capsys: Capsys) -> None:
    empty = tmp_path / f"x{suffix}"
    empty.touch()
    assert within(capsys, "decode", good, "--quiet", "-o", empty).status == 0
    assert empty.stat().st_size


@posix
@pytest.mark.parametrize("suffix", SINKS)
def test_a_device_is_written_to_and_stays_what_it_is(
    suffix: str, good: Path, tmp_path: Path, capsys: Capsys
) -> None:
    null = tmp_path / f"null{suffix}"
    null.symlink_to(os.devnull)
    assert within(capsys, "decode", good, "--quiet", "-o", null).status == 0
    assert Path(os.devnull).is_char_device()


@posix
def test_a_pipe_is_written_to_and_a_plot_on_one_is_refused_at_once(
    good: Path, tmp_path: Path, capsys: Capsys
) -> None:
    plot, pipe = tmp_path / "fifo.rrd", tmp_path / "fifo.mcap"
    os.mkfifo(plot)
    os.mkfifo(pipe)
    ran = within(capsys, "decode", good, "-o", plot)
    assert ran.complaint == f"{plot} is no file: the Rerun SDK writes to files only"
    got: list[bytes] = []
    reader = threading.Thread(target=lambda: got.append(pipe.read_bytes()))
    reader.start()
    assert within(capsys, "decode", good, "--quiet", "-o", pipe).status == 0
    reader.join()
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(got[0])
    assert b"".join(chunk.data for chunk in chunks(copy)) == good.read_bytes()


def test_an_output_that_cannot_be_opened_empties_none_before_it(
    good: Path, tmp_path: Path, capsys: Capsys
) -> None:
    kept, folder, new = tmp_path / "kept.jsonl", tmp_path / "folder.mcap", tmp_path / "new.csv"
    kept.write_bytes(DEAR)
    folder.mkdir()
    command = ("decode", good, "--force", "-o", kept, "-o", new, "-o", folder)
    assert within(capsys, *command).status == 2
    assert kept.read_bytes() == DEAR
    assert not new.exists()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_an_output_that_is_full_at_once_empties_none_before_it(
    good: Path, tmp_path: Path, capsys: Capsys
) -> None:
    kept, full = tmp_path / "kept.jsonl", tmp_path / "full.mcap"
    kept.write_bytes(DEAR)
    full.symlink_to("/dev/full")
    ran = within(capsys, "decode", good, "--force", "-o", kept, "-o", full)
    assert ran.status == 2
    assert "No space left" in ran.complaint
    assert kept.read_bytes() == DEAR


@posix
def test_two_names_of_one_file_are_not_written_both(
    good: Path, tmp_path: Path, capsys: Capsys
) -> None:
    one, other = tmp_path / "one.jsonl", tmp_path / "other.jsonl"
    one.write_bytes(DEAR)
    other.hardlink_to(one)
    ran = within(capsys, "decode", good, "--force", "-o", one, "-o", other)
    assert ran.complaint == f"{other} would be written twice: choose another output"
    assert one.read_bytes() == DEAR


def test_a_plot_is_not_replaced_by_view_either(good: Path, tmp_path: Path, capsys: Capsys) -> None:
    kept = tmp_path / "x.rrd"
    kept.write_bytes(DEAR)
    ran = within(capsys, "view", good, "-o", kept)
    assert ran.complaint == f"{kept} is there already: choose another name, or --force"
    assert within(capsys, "view", good, "-o", kept, "--force").status == 0


def test_a_picture_of_a_selection_is_told_to_be_one(
    good: Path, tmp_path: Path, capsys: Capsys
) -> None:
    ran = within(capsys, "view", good, "--bus", "leg", "-o", tmp_path / "leg.rrd")
    assert "selection, bus = 'leg': 0 of " in ran.err
    assert "bus 'leg' is not in it: one of bus0" in ran.err


def test_the_truth_of_a_simulation_is_not_replaced_either(tmp_path: Path, capsys: Capsys) -> None:
    kept = tmp_path / "truth.jsonl"
    kept.write_bytes(DEAR)
    command = ("simulate", "lss", "--truth", kept, "--duration", "0.1")
    ran = within(capsys, *command)
    assert ran.complaint == f"{kept} is there already: choose another name, or --force"
    assert kept.read_bytes() == DEAR
    assert within(capsys, *command, "--force").status == 0


def test_a_recording_is_recovered_in_its_place_or_where_nothing_is(
    recording: Path, tmp_path: Path, capsys: Capsys
) -> None:
    kept = tmp_path / "kept.mcap"
    kept.write_bytes(DEAR)
    ran = within(capsys, "recover", recording, "-o", kept)
    assert ran.complaint == f"{kept} is there already: choose another name, or --force"
    assert kept.read_bytes() == DEAR
    assert within(capsys, "recover", recording, "-o", kept, "--force").status == 0
    assert within(capsys, "recover", recording).status == 0
    assert within(capsys, "recover", recording, "-o", recording).status == 0
    assert list(chunks(kept)) == list(chunks(recording))


@posix
def test_what_is_recovered_through_a_link_leaves_the_link_and_the_files_rights(
    recording: Path, tmp_path: Path
) -> None:
    link = tmp_path / "link.mcap"
    link.symlink_to(recording)
    recording.chmod(0o600)
    before = list(chunks(recording))
    recover(link, link)
    assert link.is_symlink()
    assert list(chunks(recording)) == before
    assert recording.stat().st_mode & 0o777 == 0o600


@posix
@pytest.mark.parametrize(
    "make", [os.mkfifo, lambda path: path.symlink_to(os.devnull)], ids=["pipe", "device"]
)
def test_a_device_or_a_pipe_is_not_replaced_by_a_recording(
    make: Callable[[Path], None], recording: Path, tmp_path: Path, capsys: Capsys
) -> None:
    out = tmp_path / "out.mcap"
    make(out)
    ran = within(capsys, "recover", recording, "-o", out)
    assert ran.status == 2
    assert ran.complaint == f"{out} is a device or a pipe: give a file name"
    assert not out.is_file()
    assert Path(os.devnull).is_char_device()


@pytest.mark.skipif(sys.platform != "linux", reason="names are text elsewhere")
@each_in_turn(2, "suffix", SINKS)
def test_a_name_that_is_no_text_is_as_good_as_any_other_or_refused(
    suffix: str, good: Path, tmp_path: Path
) -> None:
    name = os.fsdecode(os.fsencode(tmp_path) + b"/\xff" + suffix.encode())
    ran = sniffer("decode", good, "--quiet", "-o", name)
    if suffix == ".rrd":
        assert ran.status == 2
        assert ran.complaint.endswith("the Rerun SDK takes names in UTF-8 only")
        assert list(tmp_path.iterdir()) == [good]
    else:
        assert (ran.status, ran.err) == (0, "")
        assert Path(name).stat().st_size


@posix
def test_an_output_that_is_deleted_while_it_is_written_is_told(tmp_path: Path) -> None:
    out = tmp_path / "x.jsonl"
    with subprocess.Popen(
        [*COMMAND, "decode", "-", "--quiet", "-o", str(out)],
        stdin=subprocess.PIPE, stderr=subprocess.PIPE, text=False,
    ) as process:  # fmt: skip
        assert process.stdin is not None
        assert process.stderr is not None
        process.stdin.write(talk(20))
        process.stdin.flush()
        while not out.exists():
            assert process.poll() is None
        out.unlink()
        process.stdin.close()
        said = process.stderr.read().decode()
    ran = Ran(process.returncode, "", said)
    assert ran.status == 2
    assert ran.complaint == f"{out} is gone: it was deleted or renamed while it was written"


@pytest.mark.parametrize("sign", ["=cmd|'/C calc'!A0", "+1", "-1", "@SUM(A1)"])
def test_a_name_is_no_formula_in_a_table_for_spreadsheets(
    sign: str, tmp_path: Path, capsys: Capsys
) -> None:
    name = sign.replace(" ", "_").replace("(", "[").replace(")", "]")
    log, out = tmp_path / "in.log", tmp_path / "x.csv"
    text = talk(1).hex()
    log.write_text(f"(1.5) {name} #{text}\n", encoding="utf-8")
    assert within(capsys, "decode", log, "--quiet", "-o", out).status == 0
    for path in (out, out.with_suffix(".frames.csv")):
        with path.open(encoding="utf-8") as file:
            assert {row["bus"] for row in csv.DictReader(file)} == {f"'{name}"}


def test_a_name_of_100_kB_is_shown_by_its_ends(tmp_path: Path, capsys: Capsys) -> None:
    log = tmp_path / "in.log"
    lines = [f"(1.{n}) {name} #{talk(9).hex()}\n" for n, name in enumerate(["a", "b" * 100_000])]
    log.write_text("".join(lines), encoding="utf-8")
    for arguments in ((), ("--summary",)):
        ran = within(capsys, "decode", log, *arguments)
        assert ran.status == 0
        assert max(map(len, (ran.out + ran.err).splitlines())) < 500
    ran = within(capsys, "decode", "c" * 100_000)
    assert ran.status == 2
    assert len(ran.complaint) < 500


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_standard_error_ends_nothing(good: Path, tmp_path: Path) -> None:
    out = tmp_path / "x.jsonl"
    with Path("/dev/full").open("wb") as full:
        done = subprocess.run(
            [*COMMAND, "decode", str(good), "-o", str(out)],
            stdout=subprocess.PIPE, stderr=full, check=False,
        )  # fmt: skip
        assert done.returncode == 0
        assert b"mightyzap" in done.stdout
        assert out.stat().st_size
        wrong = subprocess.run([*COMMAND, "decode", "nothing"], stderr=full, check=False)
        assert wrong.returncode == 2


UNFORESEEN = """
import sys
from sniffer.sinks.jsonl import JsonlSink
from sniffer.sources import binary
from sniffer.cli import run

def broken(opened):
    yield from real(opened)
    raise {error}

real = binary.read_binary
import sniffer.sources
sniffer.sources.SOURCES = {{**sniffer.sources.SOURCES, "bin": broken}}
sys.exit(run(sys.argv[1:]))
"""


@pytest.mark.parametrize(
    ("error", "told", "status"),
    [
        ("ZeroDivisionError('by\\nnought')", "a fault of this program (ZeroDivisionError: by", 3),
        ("EOFError('unexpected')", "a fault of this program (EOFError: unexpected)", 3),
        ("MemoryError()", "there is not enough memory for it; what was decoded is kept", 3),
        ("OverflowError() from KeyboardInterrupt()", "interrupted", 130),
    ],
)
def test_what_nobody_has_foreseen_is_one_line_and_what_was_decoded_is_kept(
    error: str, told: str, status: int, good: Path, tmp_path: Path
) -> None:
    program, out = UNFORESEEN.format(error=error), tmp_path / "x.mcap"
    command = [sys.executable, "-c", program, "decode", str(good), "--input-format", "bin"]
    command += ["--protocol", "mightyzap", "--quiet", "-o", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    ran = Ran(done.returncode, done.stdout, done.stderr)
    assert ran.status == status
    assert ran.complaint.startswith(told)
    data = b"".join(chunk.data for chunk in chunks(out))
    assert good.read_bytes().startswith(data)
    if status == 3 and "fault" in told:
        shown = subprocess.run(
            [*command, "--force"], capture_output=True, text=True, check=False,
            env={**os.environ, "SNIFFER_DEBUG": "1"},
        )  # fmt: skip
        assert "Traceback" in shown.stderr
        assert shown.returncode == 3
