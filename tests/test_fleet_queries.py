"""The questions of docs/fleet-queries.md: DuckDB, polars and pandas give one answer to each."""

from __future__ import annotations

import contextlib
import datetime
import io
import math
import re
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import pytest

import sniffer
from sniffer.fleet import rows as fleet_rows
from sniffer.sources.stretches import Sizes
from tests.commands import talk
from tests.robots import make_captures, make_dataset
from tests.transcripts import ROOT, Fence, agrees, fences

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

duckdb = pytest.importorskip("duckdb")
polars = pytest.importorskip("polars")
pytest.importorskip("pandas")

PAGE: Final = (ROOT / "docs/fleet-queries.md").read_text(encoding="utf-8")


class Section(NamedTuple):
    """What stands under a heading of the page."""

    title: str
    blocks: list[Fence]

    @property
    def is_question(self) -> bool:
        return self.title.endswith("?")


def sections() -> list[Section]:
    parts = re.split(r"^#{2,3} (.+)$", PAGE, flags=re.MULTILINE)
    titles = ["", *parts[1::2]]
    return [Section(t, fences(text)) for t, text in zip(titles, parts[::2], strict=True)]


class Fleet:
    """A data set in a folder, and somebody who tries the page on it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.database = duckdb.connect()
        self.names: dict[str, Any] = {"__name__": "__page__"}
        self.sql(sections()[0].blocks[0].text)
        self.python(sections()[0].blocks[1].text)

    def sql(self, text: str) -> Any:
        with contextlib.chdir(self.folder):
            return self.database.execute(text)

    def python(self, code: str) -> str:
        out = io.StringIO()
        with contextlib.chdir(self.folder), contextlib.redirect_stdout(out):
            exec(compile(code, "<python block>", "exec"), self.names)
        return out.getvalue()


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fleet]:
    folder = tmp_path_factory.mktemp("fleet")
    make_captures(folder / "captures")
    done = make_dataset(folder / "captures", folder / "dataset")
    assert dict(done.statuses) == {"ok": 8, "damaged": 1, "failed": 1}
    made = Fleet(folder)
    yield made
    made.database.close()


def plain(value: Any) -> Any:
    """Return a value as all three have it."""
    if isinstance(value, datetime.date):
        return value.isoformat()[:10]
    value = value.item() if hasattr(value, "item") else value
    if isinstance(value, float):
        return None if math.isnan(value) else pytest.approx(value)
    return value


def rows_of(answer: Any) -> tuple[list[str], list[list[Any]]]:
    rows = answer.rows() if isinstance(answer, polars.DataFrame) else answer.to_numpy().tolist()
    return list(answer.columns), [[plain(value) for value in row] for row in rows]


def prints(blocks: Sequence[Fence], got: str) -> None:
    """Hold what was printed to the page."""
    told = [block.text for block in blocks if block.language == "text"]
    lines = [line.rstrip() for line in got.rstrip().splitlines()]
    assert agrees("".join(told).splitlines(), lines), got


@pytest.mark.parametrize("title", [s.title for s in sections() if s.is_question])
def test_three_libraries_give_one_answer_to_a_question(fleet: Fleet, title: str) -> None:
    (blocks,) = (section.blocks for section in sections() if section.title == title)
    sql, lazy, frame, _ = blocks
    found = fleet.sql(sql.text)
    columns = [column[0] for column in found.description]
    wanted = columns, [[plain(value) for value in row] for row in found.fetchall()]
    assert len(wanted[1]) > 0
    fleet.python(lazy.text)
    assert rows_of(fleet.names["answer"]) == wanted
    printed = fleet.python(frame.text)
    assert rows_of(fleet.names["answer"]) == wanted
    prints(blocks, printed)


def test_the_answers_are_what_was_made_to_happen(fleet: Fleet) -> None:
    """r02 became worse with its next firmware, and it alone."""
    sql = {section.title: section.blocks[0].text for section in sections() if section.is_question}
    told = fleet.sql(sql["Whose errors became more from one week to the next?"]).fetchall()
    assert [robot for robot, *_ in told] == ["r02"]
    told = fleet.sql(sql["Which firmware brought the retries?"]).fetchall()
    assert told[0][:2] == ("mightyzap", 15)
    failed = fleet.sql(sql["Which captures failed, and why?"]).fetchall()
    assert [row[2] for row in failed] == ["damaged", "failed"]


@pytest.mark.parametrize(
    "title", ["While captures are added", "Snapshots: Delta tables", "Fewer, larger files"]
)
def test_recipes_around_the_data_set_print_what_the_page_says(fleet: Fleet, title: str) -> None:
    if "Delta" in title:
        pytest.importorskip("deltalake")
    (blocks,) = (section.blocks for section in sections() if section.title == title)
    prints(blocks, "".join(fleet.python(b.text) for b in blocks if b.language == "python"))


def test_robots_that_are_called_by_numbers_keep_their_names(tmp_path: Path) -> None:
    for robot, name in (("01", "wck"), ("2", "lss")):
        (tmp_path / robot).mkdir()
        log = (
            (ROOT / f"sample_captures/{name}_damaged.log")
            .read_text("utf-8")
            .splitlines(keepends=True)
        )
        (tmp_path / robot / "a.log").write_text("".join(log[:400]), "utf-8")
    make_dataset(tmp_path, tmp_path / "dataset", robot="/([0-9]+)/a")
    made = Fleet(tmp_path)
    made.python(sections()[0].blocks[2].text)
    joined = "SELECT DISTINCT robot FROM anomalies JOIN captures USING (robot, capture)"
    assert sorted(made.sql(joined).fetchall()) == [("01",), ("2",)]
    with contextlib.chdir(tmp_path):
        assert set(made.names["lazy"]["frames"].collect()["robot"]) == {"01", "2"}
        frame = made.names["pd"].read_parquet(
            "dataset/frames", partitioning=made.names["by_robot"], filters=[("robot", "==", "01")]
        )
    assert set(frame.robot) == {"01"}
    made.database.close()


def test_compacted_tables_hold_the_same_rows(fleet: Fleet) -> None:
    sniffer.compact_fleet(fleet.folder / "dataset", fleet.folder / "compact")
    sql = "SELECT * FROM {} ORDER BY ALL"
    types = "{'robot': VARCHAR, 'date': DATE}"
    compacted = f"read_parquet('compact/samples/robot=*/date=*/*.parquet', hive_types = {types})"
    assert (
        fleet.sql(sql.format(compacted)).fetchall() == fleet.sql(sql.format("samples")).fetchall()
    )


def test_a_cluster_reads_captures_with_the_functions_of_the_page(fleet: Fleet) -> None:
    """Ray and Spark call them with tables and batches of paths; here nobody is between."""
    pa = pytest.importorskip("pyarrow")
    (section,) = (s for s in sections() if s.title == "Captures that nobody decoded yet")
    paths = sorted(str(p) for p in (fleet.folder / "captures").glob("robot=r02/2026-11-1*.log"))
    for block in section.blocks:
        if block.language == "python":
            fleet.python(block.text)
    asked = pa.table({"path": paths})
    sql = "SELECT count(*) FROM transactions WHERE robot = 'r02' AND date > '2026-11-09'"
    (wanted,) = fleet.sql(sql).fetchone()
    made = list(fleet.names["captures_to_rows"](asked))
    assert sum(len(rows) for rows in made) == wanted
    assert {path for rows in made for path in rows["path"].to_pylist()} == set(paths)
    batches = list(fleet.names["paths_to_rows"](iter(asked.to_batches(1))))
    assert sum(len(batch) for batch in batches) == wanted
    (spark,) = (b.text for b in section.blocks if "mapInArrow" in b.text)
    kinds = {"long": pa.int64(), "short": pa.int16(), "string": pa.string()}
    told = re.findall(r"(\w+) (long|short|string)", "".join(re.findall(r'"(t_ns.*|unc.*)"', spark)))
    schema = batches[0].schema
    assert [(name, kinds[kind]) for name, kind in told] == [(f.name, f.type) for f in schema]


def test_a_delta_table_follows_the_data_set(fleet: Fleet, tmp_path: Path) -> None:
    deltalake = pytest.importorskip("deltalake")
    captures, dataset = tmp_path / "captures", tmp_path / "dataset"
    odd = captures / "robot=left arm, 100%"
    odd.mkdir(parents=True)
    log = (fleet.folder / "captures/robot=r01/2026-11-09.log").read_text()
    (odd / "a.log").write_text(log)

    def state() -> tuple[int, int, set[str]]:
        version = sniffer.register_delta(dataset)["transactions"]
        table = deltalake.DeltaTable(dataset / "transactions").to_pyarrow_table()
        return version, len(table), set(table["robot"].to_pylist())

    make_dataset(captures, dataset)
    first = state()
    assert first[0] == 1
    assert first[2] == {"left arm, 100%"}
    assert state() == first, "nothing is new"
    (odd / "a.log").write_text("".join(log.splitlines(keepends=True)[:100]))
    make_dataset(captures, dataset)
    second = state()
    assert second[0] == 2
    assert 0 < second[1] < first[1], "what was replaced counts no more"
    before = deltalake.DeltaTable(dataset / "transactions", version=1)
    assert before.get_add_actions(flatten=True).column("num_records")[0].as_py() == first[1]


def test_a_delta_table_has_the_rows_of_a_huge_capture_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    deltalake = pytest.importorskip("deltalake")
    small = Sizes(head=300, least=400, most=400, warm=200, block=1, first=0)
    monkeypatch.setattr(fleet_rows, "HUGE", small)
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "x.bin").write_bytes(talk(40))
    make_dataset(tmp_path / "in", tmp_path / "dataset")
    sniffer.register_delta(tmp_path / "dataset")
    table = deltalake.DeltaTable(tmp_path / "dataset" / "frames")
    told = table.get_add_actions(flatten=True).column("num_records").to_pylist()
    assert len(told) > 5
    assert sum(told) == len(table.to_pyarrow_table())


def test_a_delta_table_of_the_copy_follows_it_in_few_files(fleet: Fleet, tmp_path: Path) -> None:
    deltalake = pytest.importorskip("deltalake")
    copy = tmp_path / "copy"
    sniffer.compact_fleet(fleet.folder / "dataset", copy)
    sniffer.register_delta(copy)
    table = deltalake.DeltaTable(copy / "samples")
    told = table.get_add_actions(flatten=True).column("num_records").to_pylist()
    (rows,) = fleet.sql("SELECT count(*) FROM samples").fetchone()
    assert sum(told) == len(table.to_pyarrow_table()) == rows
    before = sniffer.register_delta(copy)
    sniffer.compact_fleet(fleet.folder / "dataset", copy)
    assert sniffer.register_delta(copy) == before


def test_what_is_no_data_set_is_not_registered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("deltalake")
    with pytest.raises(sniffer.InputError, match="is no data set: `sniffer fleet` makes one"):
        sniffer.register_delta(tmp_path)
    assert not list(tmp_path.iterdir())
    monkeypatch.setitem(__import__("sys").modules, "deltalake", None)
    with pytest.raises(sniffer.OutputError, match=r"pip install 'servo-sniffer\[delta\]'"):
        sniffer.register_delta(tmp_path)
