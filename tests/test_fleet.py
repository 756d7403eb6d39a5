"""``sniffer fleet``: many captures become one data set, whatever happens meanwhile."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import pyarrow.parquet as pq
import pytest

import sniffer
from sniffer.fleet.dataset import CAPTURES
from sniffer.fleet.rows import CaptureRow
from sniffer.fleet.tables import TABLES
from tests.commands import within
from tests.golden import CAPTURES as SAMPLES

if TYPE_CHECKING:
    from pathlib import Path

FEW = ("lss_damaged.log", "wck_clean.log", "mightyzap_damaged.log")


@pytest.fixture(scope="module")
def robots(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with captures of two robots."""
    folder = tmp_path_factory.mktemp("captures")
    for nth, name in enumerate(FEW):
        robot = folder / f"robot=r{nth % 2}"
        robot.mkdir(exist_ok=True)
        shutil.copy(SAMPLES / name, robot)
    return folder


def test_the_tables_of_a_data_set_hold_the_records_of_its_captures(
    robots: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    done = within(capsys, "fleet", robots, "-o", tmp_path / "data")
    assert done.status == 0
    assert done.out == "3 captures: 3 ok (3 decoded, 0 there already)\n"
    captures = pq.read_table(tmp_path / "data" / "captures.parquet").to_pylist()
    assert [row["robot"] for row in captures] == ["r0", "r0", "r1"]
    for row in captures:
        whole = sniffer.decode(row["path"])
        assert row["samples"] == len(whole.samples())
        assert row["frames"] == len(whole.frames())
        for table in TABLES:
            mine = [f for f in row["files"] if f.startswith(f"{table}/robot={row['robot']}/")]
            assert len(mine) == (row[table] > 0)
            for file in mine:
                rows = pq.ParquetFile(tmp_path / "data" / file).read()
                assert len(rows) == row[table]
                assert set(rows["capture"].to_pylist()) == {row["capture"]}
    again = within(capsys, "fleet", robots, "-o", tmp_path / "data")
    assert again.out == "3 captures: 3 ok (0 decoded, 3 there already)\n"


def test_the_list_of_captures_has_what_a_commit_has() -> None:
    assert set(CAPTURES.names) == set(CaptureRow.__dataclass_fields__)
