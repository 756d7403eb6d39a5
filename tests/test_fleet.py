"""``sniffer fleet``: many captures become one data set, and what stands in it."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import sniffer
from sniffer.anomalies.alarms import alarm_in
from sniffer.cli.fleet import Progress
from sniffer.decoding.options import Options
from sniffer.fleet import tables as fleet_tables
from sniffer.fleet import task as fleet_task
from sniffer.fleet.dataset import CAPTURES
from sniffer.fleet.recipe import decoder_name, read_recipe, write_recipe
from sniffer.fleet.rows import CaptureRow, CaptureTask
from sniffer.fleet.run import batches_of
from sniffer.fleet.tables import TABLES, CaptureTables
from sniffer.ground.registers import RegisterMap
from sniffer.ground.wiring import Wiring
from sniffer.selection.selection import Selection
from sniffer.sinks.relations import ANOMALIES, RELATIONS, TRANSACTIONS
from tests.commands import environment, log, talk, within
from tests.fleets import captures, content, serial
from tests.golden import CAPTURES as SAMPLES
from tests.golden import ROOT
from tests.plugin import table

Capsys = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def robots(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with captures of two robots."""
    return captures(tmp_path_factory.mktemp("captures"))


@pytest.fixture(scope="module")
def made(robots: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the data set of these, made one capture after the other."""
    dataset = tmp_path_factory.mktemp("serial") / "data"
    assert serial(robots, dataset).is_whole
    return dataset


def rows(dataset: Path) -> list[dict[str, Any]]:
    """Return what a data set tells of its captures."""
    listed: list[dict[str, Any]] = pq.read_table(dataset / "captures.parquet").to_pylist()
    return listed


def by_name(dataset: Path) -> dict[str, dict[str, Any]]:
    """Return the same by the names of their files."""
    return {Path(row["path"]).name: row for row in rows(dataset)}


def row_files(dataset: Path, row: dict[str, Any], table: str) -> list[Path]:
    """Return a capture's files of a table."""
    return [dataset / file for file in row["files"] if file.startswith(f"{table}/")]


def test_the_tables_of_a_data_set_hold_the_records_of_its_captures(made: Path) -> None:
    assert [row["robot"] for row in rows(made)] == ["r0", "r0", "r1"]
    for row in rows(made):
        whole = sniffer.decode(row["path"])
        records = whole.summary.as_dict()
        for name in TABLES:
            mine = [f for f in row["files"] if f.startswith(f"{name}/robot={row['robot']}/")]
            assert len(mine) == (row[name] > 0)
            assert row[name] == records[name]
            for file in mine:
                found = pq.ParquetFile(made / file).read()
                assert len(found) == row[name]
                assert set(found["capture"].to_pylist()) == {row["capture"]}
                parts = [RELATIONS[name].build(*told) for told in whole.batches]
                passes = pa.concat_tables(parts)  # the fleet has fewer of them
                assert found.drop_columns(["capture"]).to_pydict() == passes.to_pydict()
        assert row["bytes_in_gaps"] == records["bytes_in_gaps"]


def test_processes_make_the_same_data_set_as_one_and_shards_make_it_together(
    robots: Path, made: Path, tmp_path: Path, capsys: Capsys
) -> None:
    for shard, out in (
        ("1/1", "3 captures: 3 ok (3 decoded, 0 there already)\n"),
        ("1/1", "3 captures: 3 ok (0 decoded, 3 there already)\n"),
    ):
        done = within(capsys, "fleet", robots, "-o", tmp_path / "a", "--shard", shard)
        assert (done.status, done.out, done.err) == (0, out, "")
    assert content(tmp_path / "a") == content(made)
    parts = [serial(robots, tmp_path / "b", shard=(nth, 2)).captures for nth in (1, 2)]
    assert sum(parts) == 3
    assert content(tmp_path / "b") == content(made)
    assert [row["path"] for row in rows(tmp_path / "b")] == [row["path"] for row in rows(made)]


def test_the_list_of_captures_has_what_a_commit_has() -> None:
    assert set(CAPTURES.names) == set(CaptureRow.__slots__)


def test_every_column_of_the_list_and_of_the_tables_is_documented() -> None:
    page = (ROOT / "docs" / "fleet.md").read_text(encoding="utf-8")
    for schema in (CAPTURES, TRANSACTIONS, ANOMALIES):
        assert [name for name in schema.names if f"`{name}`" not in page] == []


def test_what_cannot_be_read_has_a_row_that_says_why_and_is_tried_again_when_that_is_asked(
    tmp_path: Path, capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    inputs, data = tmp_path / "in", tmp_path / "data"
    inputs.mkdir()
    (inputs / "good.log").write_text(log(talk(5)), encoding="ascii")
    (inputs / "empty.bin").touch()
    (inputs / "prose.txt").write_text("hello world, this is no capture\n", encoding="ascii")
    (inputs / "broken.log").write_text(log(talk(5)) + "(1700000000.9) what is this\n" * 9)
    os.utime(inputs / "empty.bin", ns=(0, 1 << 62))
    monkeypatch.setattr("sniffer.cli.fleet.LOG_S", 0.0)
    done = within(capsys, "fleet", inputs, "-o", data, "--workers", "1")
    assert done.status == 1
    *_, told, broken, empty, prose = done.err.splitlines()
    assert re.fullmatch(r"sniffer: 4 of 4 captures, (\d+ a second|\d+ s each), 0 s left", told)
    assert broken.startswith(f"sniffer: damaged: {inputs / 'broken.log'}, line ")
    assert empty.startswith(f"sniffer: failed: {inputs / 'empty.bin'}")
    assert prose.startswith(f"sniffer: failed: {inputs / 'prose.txt'}: this is text, but no")
    assert done.out == "4 captures: 1 ok, 1 damaged, 2 failed (4 decoded, 0 there already)\n"
    found = by_name(data)
    assert {name: row["status"] for name, row in found.items()} == {
        "good.log": "ok",
        "empty.bin": "failed",
        "prose.txt": "failed",
        "broken.log": "damaged",
    }
    assert found["prose.txt"]["error"].startswith(f"{inputs / 'prose.txt'}: this is text, but no")
    assert found["prose.txt"]["error"].endswith("is the traffic, say --input-format bin")
    assert f"line {log(talk(5)).count(chr(10)) + 1}" in found["broken.log"]["error"]
    assert found["broken.log"]["frames"] == found["good.log"]["frames"] > 0
    assert found["empty.bin"]["date"] > "2100"
    assert (found["good.log"]["date"], found["good.log"]["date_from"]) == ("2023-11-14", "stamp")
    again = serial(inputs, data, retry_failed=True)
    assert (again.decoded, again.skipped, again.failures) == (2, 2, 2)
    last = serial(inputs, data)
    assert (last.decoded, last.skipped, last.failures) == (0, 4, 2)


def test_a_capture_that_changes_or_is_decoded_otherwise_replaces_what_was_of_it(
    tmp_path: Path,
) -> None:
    inputs, data = tmp_path / "in", tmp_path / "data"
    inputs.mkdir()
    for name in ("a.bin", "b.bin", "same.bin"):
        (inputs / name).write_bytes(talk(5, seed=len(name)))
        os.utime(inputs / name, ns=(0, 0))
    serial(inputs, data)
    assert len({row["capture"] for row in rows(data)}) == 2  # two files hold the same
    (inputs / "a.bin").write_bytes(talk(6, seed=3))
    assert serial(inputs, data).decoded == 1
    assert len(rows(data)) == 3
    assert len(list(data.glob("frames/*/*/*"))) == 3
    before = content(data)
    os.utime(inputs / "b.bin", ns=(1, 1))  # what it holds is as it was
    assert serial(inputs, data).decoded == 1
    assert [name for name in content(data) if "_done" not in name] == [
        name for name in before if "_done" not in name
    ]
    assert len(rows(data)) == 3
    assert serial(inputs, data, options=Options(protocol="mightyzap")).decoded == 3
    serial(inputs, tmp_path / "fresh", options=Options(protocol="mightyzap"))
    assert content(data) == content(tmp_path / "fresh")


def test_what_breaks_off_before_anything_of_it_was_read_failed(tmp_path: Path) -> None:
    (tmp_path / "cut.sr").write_bytes(b"PK\x03\x04" + bytes(50))
    assert serial(tmp_path, tmp_path / "data").statuses == {"failed": 1}


def test_equal_captures_are_one_in_the_tables_of_a_robot_and_a_day(tmp_path: Path) -> None:
    for name, day in (("r=a/1.bin", 5), ("r=a/copy.bin", 5), ("r=a/late.bin", 6), ("r=b/1.bin", 5)):
        path = tmp_path / "in" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(talk(5))  # without times: the day is that of the file
        os.utime(path, (day * 86_400, day * 86_400))
    data = tmp_path / "data"
    assert serial(tmp_path / "in", data, robot="r=([^/]+)").is_whole
    assert len({row["capture"] for row in rows(data)}) == 1 < len(rows(data)) == 4
    frames = (
        pq.read_table(data / "frames").group_by(["robot", "date"]).aggregate([([], "count_all")])
    )
    held = {(r["robot"], str(r["date"])): r["count_all"] for r in frames.to_pylist()}
    assert held == dict.fromkeys(
        [("a", "1970-01-06"), ("a", "1970-01-07"), ("b", "1970-01-06")], rows(data)[0]["frames"]
    )
    (tmp_path / "in/r=a/1.bin").write_bytes(talk(6))
    assert serial(tmp_path / "in", data, robot="r=([^/]+)").decoded == 1
    (copy,) = (row for row in rows(data) if row["path"].endswith("copy.bin"))
    assert (data / copy["files"][0]).exists(), "the other one still needs it"


def test_a_capture_that_grows_while_it_is_decoded_has_the_tables_of_its_id(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    capture, data = tmp_path / "a.bin", tmp_path / "data"
    capture.write_bytes(talk(5))
    heard = fleet_task._heard
    seen: list[Path] = []

    def growing(task: CaptureTask, file: Path, *others: Any) -> Any:
        if not seen:  # it is hashed by now
            with capture.open("ab") as more:
                more.write(talk(6, seed=1))
        seen.append(file)
        return heard(task, file, *others)

    monkeypatch.setattr(fleet_task, "_heard", growing)
    assert serial(capture, data).is_whole
    (row,) = rows(data)
    whole = capture.read_bytes()
    assert (row["bytes"], row["sha256"]) == (len(whole), hashlib.sha256(whole).hexdigest())
    assert row["frames"] == len(pq.read_table(row_files(data, row, "frames")))
    assert row["frames"] == sniffer.decode(whole).summary.as_dict()["frames"]
    assert seen[0] == capture != seen[1]
    assert serial(capture, data).decoded == 1  # it is another file than the first run found
    assert len(rows(data)) == 1
    assert content(data) == (serial(capture, tmp_path / "fresh") and content(tmp_path / "fresh"))


def test_a_selection_is_what_the_tables_have_and_a_pattern_says_whose_they_are(
    robots: Path, tmp_path: Path
) -> None:
    where = Selection.parse("severity = 'error'")
    found = robots / "**" / "*.log"
    serial(found, tmp_path / "data", selection=where, robot=r"([a-z]+)_\w+\.log")
    assert [path.name for path in sorted((tmp_path / "data").iterdir())] == [
        "_done",
        "anomalies",
        "captures.parquet",
    ]
    assert {row["robot"]: row["anomalies"] for row in rows(tmp_path / "data")} == {
        "lss": by_name(tmp_path / "data")["lss_damaged.log"]["errors"],
        "wck": 0,
    }


def test_a_recipe_says_all_that_options_say(tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text(table("toy-b", "mightyzap"), encoding="utf-8")
    options = Options(
        protocol="mightyzap",
        protocols={"a": "lss"},
        baud=57600,
        bauds={"a": 9600},
        models={3: "toy-b", None: "mightyzap-12lf"},
        latency_ns=5,
        latencies={"a": 7},
        tables=(RegisterMap.from_toml(tmp_path / "own.toml"),),
        alarms=(alarm_in("temperature > 70 for 2s"),),
        begins={"a": 12},
        names={3: "knee"},
        wiring=Wiring({"D0": "a"}, invert=True, glitch_us=0.5),
    )
    text = write_recipe(options, Selection.parse("servo_id = 3"), "hex")
    told, selection, input_format = read_recipe(text)
    assert write_recipe(told, selection, input_format) == text
    plain = write_recipe(Options(), None, "auto")
    for name in Options.__slots__:
        if name not in ("tables", "alarms"):
            assert getattr(told, name) == getattr(options, name)
        # what is said anywhere makes another decoder
        one = write_recipe(Options(**{name: getattr(options, name)}), None, "auto")
        assert decoder_name(one) != decoder_name(plain)


def test_the_file_of_a_protocol_counts_by_what_it_holds_not_by_where_it_lies(
    tmp_path: Path,
) -> None:
    def name(path: Path, text: str) -> str:
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return decoder_name(write_recipe(Options(protocol=str(path)), None, "auto"))

    assert name(tmp_path / "a" / "p.py", "1") == name(tmp_path / "b" / "q.py", "1")
    assert name(tmp_path / "a" / "p.py", "1") != name(tmp_path / "b" / "q.py", "2")
    with pytest.raises(sniffer.SnifferError, match=r"gone\.py: cannot be read"):
        decoder_name(write_recipe(Options(protocol=str(tmp_path / "gone.py")), None, "auto"))


def test_a_decoder_has_the_same_name_wherever_the_program_lies(tmp_path: Path) -> None:
    package = Path(sniffer.__file__).parent
    shutil.copytree(package, tmp_path / "sniffer", copy_function=shutil.copy2)
    shutil.copytree(package.parent / "schemas", tmp_path / "sniffer" / "schemas")
    code = (
        "from sniffer.fleet.recipe import *; import sniffer;"
        "print(sniffer.__file__, decoder_name(write_recipe(Options(), None, 'auto')))"
    )
    env = environment(PYTHONPATH=str(tmp_path), PYTHONDONTWRITEBYTECODE="1")
    told = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, check=True, env=env, cwd=tmp_path
    )
    name = decoder_name(write_recipe(Options(), None, "auto"))
    assert told.stdout.decode().split() == [str(tmp_path / "sniffer" / "__init__.py"), name]


def test_the_bytes_of_a_table_do_not_depend_on_how_its_records_come(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fleet_tables, "MOST", 100)
    whole = sniffer.decode(SAMPLES / "wck_damaged.log").batches
    files = []
    for every in (1, 7):
        folder = tmp_path / str(every)
        folder.mkdir()
        tables = CaptureTables(folder, "c")
        for bus, protocol, batch in whole:
            tables.write(bus, protocol, batch)
        tables.close()
        files.append({file.table: file.path.read_bytes() for file in tables.files})
    assert files[0] == files[1]
    assert pq.ParquetFile(tmp_path / "1" / "frames.parquet").num_row_groups > 5


def test_a_terminal_shows_on_one_line_how_far_it_is_and_how_long_it_will_take(
    capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    shown = Progress(quiet=False)
    for done, seconds in ((1, 0.1), (2, 10.0), (3, 10.1), (30, 100.0)):
        shown.progress(sniffer.FleetProgress(done, 4000, done * 1_000_000, 4 * 10**9, seconds))
    shown.end()
    assert capsys.readouterr().err.split("\r") == [
        "",
        "2 of 4000 captures, 0.2 MB/s, 5 h 33 min left\x1b[K",
        "30 of 4000 captures, 0.3 MB/s, 3 h 40 min left\x1b[K",
        "\x1b[K",
    ]


def test_small_captures_are_reckoned_by_their_number(
    capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    big_ones_done = sniffer.FleetProgress(40, 10_040, 200_000_000, 201_000_000, 20.0)
    assert 50 < (big_ones_done.seconds_left or 0) < 70
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    Progress(quiet=False).progress(sniffer.FleetProgress(680, 6000, 136_000, 1_200_000, 10.0))
    assert "680 of 6000 captures, 68 a second, 1 min 18 s left" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("captures", "seconds", "told"),
    [(2, 25.0, "12 s each"), (1, 90.0, "1 min 30 s each"), (30, 30.0, "1 a second")],
)
def test_captures_that_take_longer_than_a_second_are_told_by_what_each_takes(
    captures: int, seconds: float, told: str, capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    so_far = sniffer.FleetProgress(captures, 600, captures * 2000, 1_200_000, seconds)
    Progress(quiet=False).progress(so_far)
    assert f"{captures} of 600 captures, {told}, " in capsys.readouterr().err


def test_batches_are_small_enough_for_every_worker_to_have_some() -> None:
    def sizes(workers: int, *given: int) -> list[list[int]]:
        tasks = [CaptureTask("", size, 0, "", "", "", "", "") for size in given]
        return [[task.size for task in batch] for batch in batches_of(tasks, workers)]

    assert sizes(2) == []
    assert sizes(2, 5) == [[5]]
    assert sizes(1, *[10] * 8) == [[10, 10]] * 4
    assert sizes(2, 9_000_000, 7_000_000, 10, 5) == [[9_000_000], [7_000_000], [10], [5]]
    many = sizes(2, 20_000_000, *[7_000_000] * 9, *[10_000] * 200)
    assert [len(batch) for batch in many] == [1] * 9 + [27] * 7 + [12]
