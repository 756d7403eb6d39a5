"""pyarrow looks for pandas in programs of others, and not in ours."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING, Final

import pytest

from tests.commands import sniffer
from tests.golden import CAPTURES
from tests.lists import each_in_turn

if TYPE_CHECKING:
    from pathlib import Path

CAPTURE: Final = CAPTURES / "wck_damaged.log"

NOTEBOOK: Final = f"""
import sys
import sniffer
samples = sniffer.decode({str(CAPTURE)!r}).samples()
assert samples.num_rows > 100
import pandas as pd, pyarrow as pa
assert pa.array(pd.Series([1.0, float("nan")])).null_count == 1
"""

PLUGIN: Final = """
from sniffer.ground.arrow import leave_pandas_out, process_is_ours
process_is_ours()
leave_pandas_out()
import sys
assert "pandas" not in sys.modules
import pandas as pd
import pyarrow as pa
assert pa.table({"a": [1, 2]}).to_pandas()["a"].sum() == 3
"""


@each_in_turn(
    2,
    "command",
    [
        ("decode", CAPTURE, "-q", "-o", "x.parquet"),
        ("convert", CAPTURE, "x.csv"),
        ("convert", CAPTURE, "x.rrd"),
        ("query", "SELECT count(*) FROM frames", CAPTURE),
        ("fleet", CAPTURE, "-o", "x"),
    ],
    ids=lambda command: " ".join([command[0], str(command[-1])]),
)
def test_no_command_loads_pandas_nor_do_its_workers(
    command: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    ran = sniffer(*command, env={"PYTHONPROFILEIMPORTTIME": "1"})
    assert ran.status == 0, ran.err
    loaded = {line.rpartition("|")[2].strip() for line in ran.err.splitlines()}
    assert "pyarrow.lib" in loaded
    assert {name for name in loaded if name.startswith("pandas.")} == set()


@pytest.mark.parametrize("code", [NOTEBOOK, PLUGIN], ids=["their program", "our plug-in"])
def test_who_has_pandas_uses_it(code: str) -> None:
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
