"""``sniffer query``: the tables are the records, and a query sees nothing else."""

from __future__ import annotations

import csv
import io
import json
import os
import sys
from typing import TYPE_CHECKING, Any

import pytest

import sniffer
from sniffer.decoding.fields import tidy
from sniffer.decoding.rows import FrameRow, GapRow
from sniffer.sinks.relations import RELATIONS
from tests.commands import Ran, within
from tests.golden import CAPTURES
from tests.lists import each_in_turn, in_turn
from tests.terminals import LINUX_ONLY

if TYPE_CHECKING:
    from pathlib import Path

    from sniffer.ground.model import Batch
    from sniffer.protocols.base import BusProtocol
    from sniffer.sinks.tables import Builder

pytest.importorskip("duckdb")

DAMAGED = [CAPTURES / "mightyzap_damaged.log", CAPTURES / "wck_damaged.log"]
ONE = CAPTURES / "mightyzap_damaged.log"


class Asking:
    """The command, within this process."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys

    def says(self, sql: str, *arguments: str | Path) -> Ran:
        return within(self._capsys, "query", sql, *(arguments or (ONE,)))

    def rows(self, sql: str, *arguments: str | Path) -> list[dict[str, Any]]:
        done = self.says(sql, *(arguments or (ONE,)), "--format", "json")
        assert done.status == 0, done.err
        return [json.loads(line) for line in done.out.splitlines()]


@pytest.fixture
def query(capsys: pytest.CaptureFixture[str]) -> Asking:
    return Asking(capsys)


def as_row(record: Any, table: str) -> dict[str, Any]:
    """Return a record as a row of its table."""
    told = {name: getattr(record, name, None) for name in RELATIONS[table].schema.names}
    if table == "anomalies":
        told["offset"], told["length"] = record.evidence[0]
    if table == "gaps":
        told["servo_id"] = record.detail.get("fields", {}).get("servo_id")
    return told


@each_in_turn(2, "capture", DAMAGED, ids=lambda p: p.name)
def test_the_tables_hold_the_records_of_the_json_lines(query: Asking, capture: Path) -> None:
    kinds = {"anomaly": "anomalies"}
    records: dict[str, list[Any]] = {name: [] for name in RELATIONS}
    for record in sniffer.decode(capture):
        table = kinds.get(record.type, f"{record.type}s")
        records[table].append(as_row(record, table))
    for table, mine in records.items():
        assert mine
        rows = query.rows(f"SELECT * FROM {table}", capture)
        ours = set(RELATIONS[table].schema.names)
        # these are told in other words: bits by name, the protocol where there are two
        left_out = {"flags", "protocol", "part", "address", "data_length", "status"}
        if table == "transactions":
            left_out |= {"t_ns"}
        shared = sorted(ours - left_out)
        pick = [tuple(_plain(row[name]) for name in shared) for row in rows]
        assert sorted(pick, key=repr) == sorted(
            (tuple(_plain(row[name]) for name in shared) for row in mine), key=repr
        )
        assert {row["protocol"] for row in rows} == {capture.name.split("_")[0]}


def _plain(value: Any) -> Any:
    return tidy(value) if isinstance(value, float) else value


def test_a_question_is_answered_as_a_table_for_people(query: Asking) -> None:
    done = query.says("SELECT op, count(*) AS n FROM frames GROUP BY op ORDER BY n DESC LIMIT 2")
    assert done.out.splitlines()[0].split() == ["op", "n"]
    assert done.out.splitlines()[1].split()[0] == "load_data"
    assert query.says("SELECT NULL AS a, 0.5 AS b").out == "a    b\n   0.5\n"
    assert query.says("SELECT 1 AS a WHERE false").out == "a\n"
    assert query.says("show tables").out.split() == ["name", *sorted(RELATIONS)]


def test_a_table_is_csv_where_that_is_asked_for(query: Asking) -> None:
    done = query.says("SELECT code, detail FROM anomalies", ONE, "--format", "csv")
    rows = list(csv.DictReader(io.StringIO(done.out)))
    assert [row["code"] for row in rows] == [
        row["code"] for row in query.rows("SELECT code FROM anomalies")
    ]


def test_what_should_be_sql_may_be_a_file_by_mistake(query: Asking) -> None:
    done = query.says(str(ONE), "SELECT 1")
    assert (done.status, done.complaint) == (
        2,
        f"'{ONE}' is a file: the SQL comes first, then the files",
    )


@LINUX_ONLY
def test_a_file_may_be_called_anything(query: Asking, tmp_path: Path) -> None:
    odd = tmp_path / os.fsdecode(b"a\xff\n.hex")
    odd.write_text("FFFFFF0002F10C", encoding="ascii")
    other = tmp_path / "b.hex"
    other.write_text("FFFFFF0002F10C", encoding="ascii")
    rows = query.rows("SELECT DISTINCT file FROM frames ORDER BY file DESC", odd, other)
    assert rows[1] == {"file": str(tmp_path / "a\\xff\n.hex")}


def test_several_files_are_one_table_that_tells_them_apart(query: Asking) -> None:
    two = CAPTURES / "mightyzap_clean.log", ONE
    rows = query.rows("SELECT file, count(*) AS n FROM frames GROUP BY file ORDER BY file", *two)
    assert [row["file"] for row in rows] == sorted(map(str, two))
    assert [row["n"] for row in rows] == [
        query.rows("SELECT count(*) AS n FROM frames", path)[0]["n"] for path in sorted(two)
    ]


def test_together_several_files_are_one_capture(query: Asking, tmp_path: Path) -> None:
    lines = ONE.read_text().splitlines(keepends=True)
    halves = tmp_path / "1.log", tmp_path / "2.log"
    cut = next(n for n, line in enumerate(lines) if n > 1000 and "FFFFFF" in line)
    for half, told in zip(halves, (lines[:cut], lines[cut:]), strict=True):
        half.write_text("".join(told))
    sql = "SELECT op, outcome, response_time_ns, request_offset FROM transactions"
    assert query.rows(sql, *halves, "--together") == query.rows(sql, ONE)
    one_by_one = "SELECT count(DISTINCT file) AS n FROM transactions"
    assert query.rows(one_by_one, *halves)[0]["n"] == 2
    assert "file" in query.says(one_by_one, *halves, "--together").complaint


@pytest.mark.parametrize(
    "sql",
    [
        "SELECT * FROM read_text('/etc/hostname')",
        "SELECT * FROM read_csv('https://example.org/x.csv')",
        "SELECT * FROM '{here}/there.csv'",
        "COPY frames TO '{here}/out.csv'",
        "ATTACH '{here}/out.db'",
        "INSTALL httpfs",
        "SET enable_external_access = true",
        "CREATE TABLE x AS SELECT 1",
        "SELECT 1; DROP TABLE frames",
        "SELECT * FROM sql",
        "SELECT * FROM sources",
        "",
    ],
)
def test_a_query_reaches_nothing_but_the_tables(query: Asking, sql: str, tmp_path: Path) -> None:
    (tmp_path / "there.csv").write_text("a\n1\n", encoding="ascii")
    done = query.says(sql.format(here=tmp_path))
    assert done.status == 2
    assert done.complaint
    assert not done.out
    assert [path.name for path in tmp_path.iterdir()] == ["there.csv"]


@pytest.mark.parametrize(
    ("sql", "said"),
    [
        ("SELECT * FROM frame", "there is no table 'frame': did you mean frames?"),
        ("SELECT * FROM x", "one of frames, transactions, samples, anomalies, gaps"),
        ("SELECT xx FROM frames", 'column "xx" not found'),
        ("SELCT 1", 'syntax error at or near "SELCT"'),
        ("SELECT cast('x' AS INT)", "Could not convert"),
        ("SELECT op, offset FROM frames", 'the column is written "offset"'),
        ("SELECT group, count(*) FROM anomalies GROUP BY 1", 'the column is written "group"'),
    ],
)
def test_a_mistake_in_a_query_is_a_line(query: Asking, sql: str, said: str) -> None:
    done = query.says(sql)
    assert done.status == 2
    assert said in done.complaint


def test_tables_are_joined_by_what_they_have_in_common(query: Asking) -> None:
    # DuckDB looks for such columns before there are tables
    using = "SELECT count(*) AS n FROM samples AS a JOIN frames AS b USING (t_ns, servo_id)"
    plain = "SELECT count(*) AS n FROM samples AS a, frames AS b "
    plain += "WHERE a.t_ns = b.t_ns AND a.servo_id = b.servo_id"
    assert query.rows(using) == query.rows(plain) != [{"n": 0}]
    assert query.rows("SELECT count(*) AS n FROM frames NATURAL JOIN gaps") == [{"n": 0}]
    wrong = query.says("SELECT 1 FROM gaps JOIN frames USING (nothing)")
    assert (wrong.status, wrong.out) == (2, "")
    assert wrong.err.splitlines()[-1].endswith('"nothing" does not exist on left side of join!')


def test_times_with_a_zone_are_told_in_utc_and_need_no_library(query: Asking) -> None:
    told = 'to_timestamp(t_ns / 1e9) AS "a ""b", code AS t, 1 AS t'
    done = query.says(f"SELECT {told} FROM anomalies LIMIT 1; -- ;", ONE, "--format", "csv")
    head, row = csv.reader(io.StringIO(done.out))
    assert head == ['a "b', "t", "t"]
    assert row == ["2026-11-20 22:55:06.365183", "no-response", "1"]


def test_what_explains_a_query_is_drawn_as_it_is(query: Asking) -> None:
    drawn = query.says("EXPLAIN SELECT code FROM anomalies").out
    assert "\\" not in drawn
    assert len(drawn.splitlines()) > 3


def test_only_the_tables_that_are_named_are_built(
    query: Asking, monkeypatch: pytest.MonkeyPatch
) -> None:
    built: list[str] = []

    def watched(name: str, build: Builder) -> Builder:
        def watch(bus: str, protocol: BusProtocol, batch: Batch) -> Any:
            built.append(name)
            return build(bus, protocol, batch)

        return watch

    told = {n: r._replace(build=watched(n, r.build)) for n, r in RELATIONS.items()}
    monkeypatch.setattr("sniffer.sinks.relations.RELATIONS", told)
    query.rows("WITH f AS (SELECT * FROM Gaps) SELECT count(*) FROM f")
    assert set(built) == {"gaps"}


def test_without_duckdb_a_line_says_what_to_install(
    query: Asking, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "duckdb", None)
    done = query.says("SELECT 1")
    assert done.status == 2
    assert "pip install 'servo-sniffer[query]'" in done.complaint


def test_only_a_part_is_asked_where_one_is_meant(query: Asking) -> None:
    sql = "SELECT (max(t_ns) - min(t_ns)) / 1e9 AS s FROM frames"
    assert query.rows(sql, ONE, "--from", "1", "--to", "2")[0]["s"] == pytest.approx(1, abs=0.1)


def test_the_library_call_gives_rows() -> None:
    answer = sniffer.query("SELECT kind, count(*) FROM frames GROUP BY kind ORDER BY kind", [ONE])
    assert answer.columns == ("kind", "count_star()")
    assert [kind for kind, _ in answer] == ["request", "response"]


@in_turn(2)
@pytest.mark.parametrize("capture", DAMAGED, ids=lambda p: p.name)
@pytest.mark.parametrize("table", ["frames", "gaps"])
def test_bytes_are_those_of_the_json_lines_where_a_query_names_them(
    query: Asking, capture: Path, table: str
) -> None:
    kind = FrameRow if table == "frames" else GapRow
    told = [r for r in sniffer.decode(capture) if isinstance(r, kind)]
    rows = query.rows(f'SELECT "offset", hex FROM {table} ORDER BY ALL', capture)
    assert [(row["offset"], row["hex"]) for row in rows] == sorted((r.offset, r.hex) for r in told)
    assert "hex" not in query.rows(f"SELECT * FROM {table} LIMIT 1", capture)[0]
    assert "hex" not in query.rows(f"SELECT *, hex(1) AS one FROM {table} LIMIT 1", capture)[0]


def test_bytes_of_selected_frames_are_theirs(query: Asking) -> None:
    rows = query.rows("SELECT hex FROM frames", ONE, "--servo", "2")
    assert rows
    assert all(row["hex"].startswith("ffffff02") for row in rows)


@pytest.mark.parametrize(
    ("test", "is_told"),
    [("severity >= 'warn'", True), ("\"severity\" < 'warn'", True), ("severity <> 'note'", False)],
)
def test_severities_that_are_compared_by_the_alphabet_are_told_to_be(
    query: Asking, test: str, is_told: bool
) -> None:
    ran = query.says(f"SELECT count(*) FROM anomalies WHERE {test}")
    assert ran.status == 0
    assert ("write severity IN ('warn', 'error')" in ran.err) == is_told
