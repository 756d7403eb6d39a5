"""The copy of a data set in few large files: rows, names and bytes, and what may come between."""

from __future__ import annotations

import errno
import hashlib
import os
import shutil
import subprocess
import sys
from typing import TYPE_CHECKING, Any, Final

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import sniffer
from sniffer.fleet import compact
from sniffer.fleet.dataset import CaptureList
from sniffer.fleet.store import Store
from sniffer.fleet.tables import TABLES
from tests.commands import within
from tests.fleets import captures, serial
from tests.golden import CAPTURES as SAMPLES

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

Capsys = pytest.CaptureFixture[str]

DAY: Final = "date=2026-11-20"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data set of four captures, two of them of one robot and day."""
    folder = tmp_path_factory.mktemp("made")
    inputs = captures(folder / "captures")
    shutil.copy(SAMPLES / "wck_damaged.log", inputs / "robot=r0")
    serial(inputs, folder / "dataset")
    return folder


@pytest.fixture
def dataset(made: Path, tmp_path: Path) -> Path:
    """The same, to be changed."""
    return shutil.copytree(made / "dataset", tmp_path / "dataset")


def rows(folder: Path, table: str) -> list[dict[str, Any]]:
    """Return the rows of a table, in an order that says nothing of files."""
    found = [pq.read_table(file) for file in sorted((folder / table).rglob("*.parquet"))]
    return sorted((row for part in found for row in part.to_pylist()), key=repr)


def copied(folder: Path) -> dict[str, str]:
    """Return what a copy holds."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_a_copy_has_the_rows_of_its_data_set_in_one_file_a_table_robot_and_day(
    dataset: Path, tmp_path: Path
) -> None:
    copy = tmp_path / "copy"
    done = sniffer.compact_fleet(dataset, copy)
    days = {path.parent for table in TABLES for path in (dataset / table).rglob("*.parquet")}
    assert (done.captures, done.files, done.written) == (4, len(days), len(days))
    assert done.sources > done.files
    for day in days:
        (file,) = (copy / day.relative_to(dataset)).iterdir()
        assert pq.read_schema(file).equals(pq.read_schema(next(day.iterdir())))
    for table in TABLES:
        assert rows(copy, table) == rows(dataset, table)
    listed = pq.read_table(copy / "captures.parquet")
    before = pq.read_table(dataset / "captures.parquet")
    assert listed.drop(["files"]).equals(before.drop(["files"]))
    named = {file for files in listed["files"].to_pylist() for file in files}
    assert named == set(copied(copy)) - {"captures.parquet"}
    assert not (copy / "_staging").exists()


def test_rows_of_a_day_are_in_the_order_of_time(dataset: Path, tmp_path: Path) -> None:
    sniffer.compact_fleet(dataset, tmp_path / "copy")
    (file,) = (tmp_path / "copy" / "frames" / "robot=r0" / DAY).iterdir()
    listed = pq.read_table(dataset / "captures.parquet").to_pylist()
    wanted = [
        row["capture"]
        for row in sorted(listed, key=lambda row: row["t_first_ns"] or 0)
        if row["robot"] == "r0" and row["date"] == DAY.removeprefix("date=")
    ]
    assert len(wanted) == 2
    assert list(dict.fromkeys(pq.read_table(file)["capture"].to_pylist())) == wanted


def test_what_has_not_changed_is_skipped_without_being_read(dataset: Path, tmp_path: Path) -> None:
    sniffer.compact_fleet(dataset, tmp_path / "copy")
    before = copied(tmp_path / "copy")
    for table in TABLES:
        for file in (dataset / table).rglob("*.parquet"):
            file.write_bytes(b"nobody looks")
    done = sniffer.compact_fleet(dataset, tmp_path / "copy")
    assert (done.written, done.bytes) == (0, 0)
    assert copied(tmp_path / "copy") == before


def test_a_capture_that_is_replaced_or_gone_changes_the_files_of_its_day_alone(
    made: Path, tmp_path: Path
) -> None:
    inputs = shutil.copytree(made / "captures", tmp_path / "captures")
    dataset, copy = tmp_path / "dataset", tmp_path / "copy"
    serial(inputs, dataset)
    sniffer.compact_fleet(dataset, copy)
    before = copied(copy)
    log = inputs / "robot=r0" / "wck_damaged.log"
    log.write_text("".join(log.read_text().splitlines(keepends=True)[:200]))
    serial(inputs, dataset)
    done = sniffer.compact_fleet(dataset, copy)
    after = copied(copy)
    changed = {name.rpartition("/")[0] for name in before.keys() - after.keys()}
    assert changed
    assert all(f"robot=r0/{DAY}" in folder for folder in changed)
    assert done.written == len(changed)
    for table in TABLES:
        assert rows(copy, table) == rows(dataset, table)
    listed = pq.read_table(dataset / "captures.parquet").to_pylist()
    (row,) = (row for row in listed if row["robot"] == "r1")
    for file in (*row["files"], f"_done/{row['fingerprint']}.json"):
        (dataset / file).unlink()
    CaptureList(Store.of(dataset)).write()
    sniffer.compact_fleet(dataset, copy)
    assert not [name for name in copied(copy) if "robot=r1" in name]


def test_a_file_is_cut_where_it_would_be_too_large_and_later_captures_leave_full_ones(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compact, "LARGE", 1)
    copy = tmp_path / "copy"
    done = sniffer.compact_fleet(dataset, copy)
    assert done.files == done.sources
    assert [s.path for part in compact._parts([compact._Source(n, str(n), 1) for n in range(3)])
            for s in part] == ["0", "1", "2"]  # fmt: skip
    monkeypatch.setattr(compact, "LARGE", 30)
    few = [compact._Source(n, str(n), 10) for n in range(8)]
    parts = [compact._name(part) for part in compact._parts(few)]
    more = [compact._name(part) for part in compact._parts([*few, compact._Source(9, "9", 25)])]
    assert len(parts) == 3
    assert more[:3] == parts
    assert len(more) == 4


@pytest.mark.parametrize("nth", [0, 1, 4])
def test_a_copy_that_is_killed_is_gone_on_with_and_is_that_of_one_go(
    nth: int, dataset: Path, tmp_path: Path
) -> None:
    copy, whole = tmp_path / "copy", tmp_path / "whole"
    sniffer.compact_fleet(dataset, whole)
    code = (
        "import os, signal, sniffer\n"
        "from sniffer.fleet.store import Store\n"
        "put, left = Store.put, [int(os.environ['NTH'])]\n"
        "def until(self, path, file):\n"
        "    if not left[0]:\n"
        "        os.kill(os.getpid(), signal.SIGKILL)\n"
        "    left[0] -= 1\n"
        "    put(self, path, file)\n"
        "Store.put = until\n"
        "sniffer.compact_fleet(os.environ['DATASET'], os.environ['COPY'])\n"
    )
    told = {**os.environ, "NTH": str(nth), "DATASET": str(dataset), "COPY": str(copy)}
    assert subprocess.run([sys.executable, "-c", code], env=told, check=False).returncode == -9
    assert list((copy / "_staging").iterdir())
    done = sniffer.compact_fleet(dataset, copy)
    assert done.written == done.files - nth
    assert copied(copy) == copied(whole)


def test_two_copies_at_once_are_one(dataset: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "sniffer", "compact", str(dataset), "-q", "-o"]
    both = [subprocess.Popen([*command, str(tmp_path / "copy")]) for _ in range(2)]
    assert [process.wait() for process in both] == [0, 0]
    sniffer.compact_fleet(dataset, tmp_path / "whole")
    assert copied(tmp_path / "copy") == copied(tmp_path / "whole")


def test_a_run_that_goes_by_an_older_list_takes_nothing_away_for_good(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The other one had read the list before a capture was added, and ends in the midst of ours."""
    older = shutil.copytree(dataset, tmp_path / "older")
    row = pq.read_table(older / "captures.parquet").to_pylist()[0]
    (older / f"_done/{row['fingerprint']}.json").unlink()
    CaptureList(Store.of(older)).write()
    copy = tmp_path / "copy"
    delete: Callable[[Store, str], None] = Store.delete
    put: Callable[..., None] = Store.put_bytes
    met: list[str] = []

    def then(self: Store, path: str, data: bytes, folder: Path | None = None) -> None:
        put(self, path, data, folder)
        if not met:
            met.append(path)
            sniffer.compact_fleet(older, copy)

    monkeypatch.setattr(Store, "put_bytes", then)
    sniffer.compact_fleet(dataset, copy)
    monkeypatch.setattr(Store, "put_bytes", put)
    monkeypatch.setattr(Store, "delete", delete)
    assert met == ["captures.parquet"]
    sniffer.compact_fleet(dataset, tmp_path / "whole")
    assert copied(copy) == copied(tmp_path / "whole")


def test_a_capture_that_is_replaced_while_it_is_copied_is_copied_as_it_is_then(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    inputs = shutil.copytree(made / "captures", tmp_path / "captures")
    dataset, copy = tmp_path / "dataset", tmp_path / "copy"
    serial(inputs, dataset)
    row_groups = compact._row_groups
    met: list[str] = []

    def then(store: Store, path: str) -> Iterator[Any]:
        yield from row_groups(store, path)
        if not met:  # all of it is replaced by a run of another decoder
            met.append(path)
            serial(inputs, dataset, options=sniffer.Options(baud=115_200))

    monkeypatch.setattr(compact, "_row_groups", then)
    sniffer.compact_fleet(dataset, copy)
    monkeypatch.setattr(compact, "_row_groups", row_groups)
    assert not (dataset / met[0]).exists()
    sniffer.compact_fleet(dataset, tmp_path / "whole")
    assert copied(copy) == copied(tmp_path / "whole")


def test_captures_that_are_being_replaced_are_waited_for_by_whoever_tries_again(
    made: Path, tmp_path: Path, capsys: Capsys
) -> None:
    inputs = shutil.copytree(made / "captures", tmp_path / "captures")
    dataset = shutil.copytree(made / "dataset", tmp_path / "dataset")
    row = pq.read_table(dataset / "captures.parquet").to_pylist()[0]
    for file in (*row["files"], f"_done/{row['fingerprint']}.json"):
        (dataset / file).unlink()
    told = within(capsys, "compact", dataset, "-o", tmp_path / "copy")
    assert told.status == 3
    assert "a run is replacing them, or was ended there" in told.complaint
    assert f"{len(row['files'])} files of captures are not there" in told.complaint
    serial(inputs, dataset)
    told = within(capsys, "compact", dataset, "-o", tmp_path / "copy")
    assert told.status == 0, told.err


def test_a_full_disk_is_told_in_a_line_and_with_room_the_copy_goes_on(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capsys
) -> None:
    put = Store.put

    def full(self: Store, path: str, file: Path) -> None:
        if path.startswith("samples/"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        put(self, path, file)

    monkeypatch.setattr(Store, "put", full)
    told = within(capsys, "compact", dataset, "-o", tmp_path / "copy")
    assert told.status == 3
    assert told.err == f"sniffer: {tmp_path}/copy: cannot be written (No space left on device)\n"
    assert not (tmp_path / "copy" / "_staging").exists()
    assert "samples" not in {name.partition("/")[0] for name in copied(tmp_path / "copy")}
    monkeypatch.setattr(Store, "put", put)
    told = within(capsys, "compact", dataset, "-o", tmp_path / "copy")
    assert (told.status, told.err) == (0, "")
    assert "there already)" in told.out


@pytest.mark.parametrize(
    ("into", "why"),
    [
        ("dataset", "lies in the data set"),
        ("dataset/samples/copy", "lies in the data set"),
        ("other", "is a data set"),
        ("robot=r1/copy", "readers of tables would take its path for a column"),
    ],
)
def test_a_copy_has_a_folder_of_its_own(
    into: str, why: str, made: Path, dataset: Path, tmp_path: Path, capsys: Capsys
) -> None:
    other = shutil.copytree(made / "dataset", tmp_path / "other")
    before = copied(dataset) | copied(other)
    told = within(capsys, "compact", dataset, "-o", tmp_path / into)
    assert told.status == 2
    assert why in told.err
    assert copied(dataset) | copied(other) == before


def test_of_what_is_no_data_set_no_copy_is_begun(tmp_path: Path, capsys: Capsys) -> None:
    (tmp_path / "empty").mkdir()
    told = within(capsys, "compact", tmp_path / "empty", "-o", tmp_path / "copy")
    assert told.status == 2
    assert told.complaint == f"{tmp_path}/empty is no data set: `sniffer fleet` makes one"
    assert [path.name for path in tmp_path.iterdir()] == ["empty"]


def test_what_others_put_beside_a_copy_stays(dataset: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    sniffer.compact_fleet(dataset, copy)
    mine = copy / "samples" / "robot=r0" / "mine.parquet"
    pq.write_table(pa.table({"a": [1]}), mine)
    sniffer.compact_fleet(dataset, copy)
    assert mine.exists()
