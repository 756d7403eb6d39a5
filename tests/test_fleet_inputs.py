"""Which captures ``sniffer fleet`` takes, what each is called, and what it does not begin."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING
from unittest.mock import Mock

import pyarrow.parquet as pq
import pytest

from sniffer.fleet.inputs import find_captures
from sniffer.fleet.store import Store
from tests.commands import log, talk, within
from tests.fleets import serial

if TYPE_CHECKING:
    from collections.abc import Iterable

Capsys = pytest.CaptureFixture[str]


def test_a_folder_has_the_files_that_are_called_like_captures(tmp_path: Path) -> None:
    data = Store.of(tmp_path / "in" / "data")
    for name in ("a.MCAP", "b.log.gz", "deep/c.bin", "README.md", "x.json.gz", "data/d.log"):
        (tmp_path / "in" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "in" / name).touch()
    (tmp_path / "in" / ".hidden.log").touch()

    def names(*inputs: str) -> list[str]:
        found = find_captures([str(tmp_path / "in" / name) for name in inputs], data)
        return [Path(c.uri).relative_to(tmp_path / "in").as_posix() for c in found.captures]

    assert names("") == ["a.MCAP", "b.log.gz", "deep/c.bin"]
    assert names("", "README.md", "*.MCAP") == ["README.md", "a.MCAP", "b.log.gz", "deep/c.bin"]
    assert names("**/*.bin") == ["deep/c.bin"]
    assert names("d*") == ["deep/c.bin"]  # folders, of which one is the data set
    assert names("*") == ["README.md", "a.MCAP", "b.log.gz", "deep/c.bin", "x.json.gz"]
    assert find_captures([tmp_path / "in"], data).left_out == 2


def test_a_capture_has_one_name_however_it_is_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "in" / "deep").mkdir(parents=True)
    (tmp_path / "in" / "a b.log").touch()
    (tmp_path / "other" / "place").mkdir(parents=True)
    (tmp_path / "other" / "b.log").touch()
    (tmp_path / "link").symlink_to("in")
    (tmp_path / "in" / "away").symlink_to(tmp_path / "other" / "place")
    monkeypatch.chdir(tmp_path / "in")
    there = (tmp_path / "in").as_posix()
    named = [".", "../in", "deep/../../in", "./a b.log", "../in/*.log", f"/{there}"]
    found = find_captures([*named, (tmp_path / "in" / "a b.log").as_uri()], Store.of("data"))
    assert [capture.uri for capture in found.captures] == [f"{there}/a b.log"]
    assert Store.of("deep/../data").root == Store.of("data").root == f"{there}/data"
    # links keep their names; behind one, .. is where it leads, as for the system
    found = find_captures(["../link", "away/../b.log"], Store.of("data"))
    assert [capture.uri for capture in found.captures] == [
        f"{tmp_path.as_posix()}/link/a b.log",
        f"{tmp_path.as_posix()}/other/b.log",
    ]


def test_a_data_set_is_never_read_as_captures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capsys
) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    Path("a.bin").write_bytes(talk(2))
    Path("link").symlink_to("data")
    assert within(capsys, "fleet", "a.bin", "-o", "data", "--workers", "1").status == 0
    # named by a path of its own, by a pattern, as a shell's * does, and by a link
    for dataset, *inputs in (
        ["../here/data", "**/*"],
        ["link", "../here/**/*"],
        ["data", "a.bin", "data", "link"],
        ["data", "."],
    ):
        done = within(capsys, "fleet", *inputs, "-o", dataset)
        assert done.out == "1 capture: 1 ok (0 decoded, 1 there already)\n"
        said = [line for line in done.err.splitlines() if "of the data set itself" in line]
        assert (done.status, len(said)) == (0, any("*" in name for name in inputs))
    for wrong, dataset in (("data/frames", "link"), ("link/*", "data"), ("a.bin", ".")):
        done = within(capsys, "fleet", "a.bin", wrong, "-o", dataset)
        assert done.status == 2
        assert "lies in the data set" in done.complaint


def test_of_another_data_set_nothing_is_a_capture_but_what_lies_beside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a.bin").write_bytes(talk(2))
    assert serial("a.bin", "old").is_whole
    Path("old/_staging/left").mkdir(parents=True)
    Path("old/_staging/left/bytes").touch()
    Path("old/b.bin").write_bytes(talk(3))
    made = sum(f.is_file() for f in Path("old").rglob("*")) - 1
    for inputs in (["**/*"], ["old/**/*", "a.bin"]):
        done = within(capsys, "fleet", *inputs, "-o", "new", "--workers", "1")
        assert done.out.startswith("2 captures: 2 ok")
        told = (
            f"sniffer: left out {made} files of another data set, {tmp_path}/old: what it is made"
        )
        assert told in done.err
        assert done.err.count("of another data set") == 1
    Path("old/b.bin").unlink()
    done = within(capsys, "fleet", "old/**/*", "-o", "none")
    assert (done.status, done.complaint) == (
        2,
        "old/**/*: there are no captures, only what a data set is made of",
    )
    assert within(capsys, "fleet", "old/*/*/*/*.parquet", "-o", "none").status == 2


def test_what_nobody_may_look_into_stops_nobody_and_is_told(
    tmp_path: Path, capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    inputs, data = tmp_path / "in", tmp_path / "data"
    for robot in ("r1", "closed"):
        (inputs / robot).mkdir(parents=True)
        (inputs / robot / "a.bin").write_bytes(talk(2))
    (inputs / "self.bin").symlink_to("self.bin")
    (inputs / "nowhere.bin").symlink_to("gone.bin")
    (inputs / "nowhere.md").symlink_to("gone.md")
    scandir = os.scandir

    def refusing(path: str) -> os._ScandirIterator[str]:  # root may look into all folders
        if str(path).endswith("closed"):
            raise PermissionError(13, "Permission denied", path)
        return scandir(path)

    monkeypatch.setattr(os, "scandir", refusing)
    done = within(capsys, "fleet", inputs, "-o", data, "--workers", "1")
    assert done.out == "1 capture: 1 ok (1 decoded, 0 there already)\n"
    assert done.err.splitlines() == [
        "sniffer: left out 2 links called like captures: where they lead nothing can be read",
        f"sniffer: {inputs}/closed: cannot be looked into (Permission denied)",
        f"sniffer: not all done: what is in {data} stays; run it again to go on",
    ]
    assert done.status == 3
    done = within(capsys, "fleet", inputs / "closed", "-o", data)
    assert (done.status, done.complaint) == (
        2,
        f"{inputs}/closed: cannot be read (Permission denied)",
    )


def test_a_capture_that_may_not_be_read_is_tried_again_by_every_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.bin").write_bytes(talk(2))
    with monkeypatch.context() as patch:
        refused = PermissionError(13, "Permission denied")
        patch.setattr("sniffer.fleet.task._content", Mock(side_effect=refused))
        done = serial(tmp_path / "a.bin", tmp_path / "data")
    told = f"failed: {tmp_path}/a.bin: cannot be read (Permission denied)"
    assert (done.is_whole, done.failures, done.troubles) == (True, 1, (told,))
    done = serial(tmp_path / "a.bin", tmp_path / "data")
    assert (done.decoded, done.statuses) == (1, {"ok": 1})


def test_a_file_may_have_a_name_that_is_no_text(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    try:
        name = os.fsdecode(b"caf\xe9.bin")
        (tmp_path / "in" / name).write_bytes(talk(5))
    except OSError:
        pytest.skip("file names are text here")
    for skipped in (0, 1):
        assert serial(tmp_path / "in", tmp_path / "data").skipped == skipped
    listed = pq.read_table(tmp_path / "data" / "captures.parquet")["path"].to_pylist()
    assert [Path(path).name for path in listed] == [r"caf\xe9.bin"]


MISTAKES: list[tuple[Iterable[str], str]] = [
    (["x.bin"], "x.bin: there is no such file"),
    (["*.nothing"], "*.nothing: there are no captures: name files, folders or patterns"),
    (["/dev/null"], "/dev/null is no file: a data set is made of captures that stay"),
    (["."], ".: there are no captures: name files, folders or patterns"),
    (["--shard", "0/2"], "Invalid value for '--shard': '0/2': parts are counted from 1, as 1/4"),
    (["--shard", "half"], "Invalid value for '--shard': 'half': parts are counted from 1, as 1/4"),
    (["--robot", "r[0"], "--robot: no regular expression (unterminated character set"),
    (["--robot", "r0"], "--robot: the robot is what a group in parentheses matches"),
    (["--scheduler", "a"], "--scheduler is for an engine of many machines: --engine"),
    (["--where", "xx = 1"], "--where, at 'xx = 1' (character 1): there is no such column"),
    (["-o", "a.log/x"], "a.log/x: cannot be written (Not a directory): give -o a folder that can"),
    (
        ["-o", "robot=r7/ds"],
        "robot=r7/ds: readers of tables would take robot=r7 for that",
    ),
    (["-o", ""], "'' names no data set: give -o a folder of its own"),
    ([""], "'' names no captures: name files, patterns or folders (`.` is this one); a variable"),
    (["data"], "data: this is the data set itself: give -o a folder of its own"),
    (["-o", "nowhere://x"], "nowhere://x: no place for files"),
]


@pytest.mark.parametrize(("arguments", "said"), MISTAKES, ids=lambda v: " ".join(v)[:20])
def test_what_cannot_be_meant_is_told_before_anything_is_decoded(
    arguments: list[str],
    said: str,
    tmp_path: Path,
    capsys: Capsys,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.log").write_text(log(talk(2)), encoding="ascii")
    given = [] if not arguments[0].startswith("-") else ["a.log"]
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty" if arguments == ["."] else tmp_path)
    done = within(capsys, "fleet", "-o", "data", *given, *arguments)
    assert (done.status, done.out) == (2, "")
    assert done.complaint.startswith(said)
    assert not list(tmp_path.rglob("_done"))
