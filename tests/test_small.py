"""A tap without the Rerun SDK, pyarrow and Textual: all but plots, tables and a look inside."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace
from typing import Final

import pytest

from sniffer.ground import needs
from sniffer.ground.model import OutputError
from tests.commands import Ran

ROOT: Final = Path(__file__).parents[1]
LOG: Final = ROOT / "sample_captures" / "mightyzap_clean.log"
HEAVY: Final = ("rerun", "rerun_sdk", "rerun_bindings", "rerun_cli", "pyarrow", "textual")

WITHOUT: Final = f"""
import sys

class Without:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {HEAVY!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Without())
from sniffer.__main__ import main
main()
"""
"""The command line where nobody has installed what a tap does not need."""


def small(folder: Path, *arguments: str | Path) -> Ran:
    command = [sys.executable, "-c", WITHOUT, *map(str, arguments)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    return Ran(done.returncode, done.stdout, done.stderr)


def test_a_tap_decodes_records_replays_and_mends_without_plots_and_tables(tmp_path: Path) -> None:
    for arguments in (
        ["--help"],
        ["record", "--help"],
        ["simulate", "--help"],
        ["ports"],
        ["protocols"],
        ["registers"],
        ["explain", "FF FF FF 01 02 F1 0B"],
        ["decode", LOG, "-o", "x.mcap", "-o", "x.jsonl", "--summary"],
        ["replay", "x.mcap", "--speed", "0"],
        ["replay", "x.mcap", "--redecode"],
        ["recover", "x.mcap"],
    ):
        ran = small(tmp_path, *arguments)
        assert ran.status == 0, (arguments, ran.err)
    assert (tmp_path / "x.mcap").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["decode", LOG, "-o", "x.parquet"], "tables (.parquet, .csv) need pyarrow"),
        (["decode", LOG, "-o", "x.csv"], "`pip install pyarrow`"),
        (["decode", LOG, "-o", "x.rrd"], "plots need the Rerun SDK"),
        (["view", LOG], "`pip install rerun-sdk`"),
        (["view", LOG, "-o", "x.rrd"], "`pip install rerun-sdk`"),
        (["replay", LOG, "--rerun"], "`pip install rerun-sdk`"),
        (["record", "nowhere", "-o", "x.csv"], "`pip install pyarrow`"),
        (["open", LOG], "`pip install textual`"),
    ],
)
def test_what_needs_them_says_so_in_a_line_and_leaves_nothing(
    arguments: list[str | Path], told: str, tmp_path: Path
) -> None:
    ran = small(tmp_path, *arguments)
    assert ran.status == 2
    assert told in ran.err
    assert ran.err.count("\n") == 1, ran.err
    assert not list(tmp_path.iterdir())


def test_what_a_tap_needs_is_everything_but_plots_and_tables() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    lines = (ROOT / "requirements-tap.txt").read_text(encoding="utf-8").splitlines()
    told = {line for line in lines if not line.startswith("#")}
    plots = {d for d in project["dependencies"] if re.match(r"(rerun-sdk|pyarrow|textual)\b", d)}
    assert len(plots) == 3
    assert told == {*project["dependencies"]} - plots


def test_a_rerun_that_has_changed_is_told_with_the_one_that_is_known(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pin = f"rerun-sdk=={needs.KNOWN_RERUN}.*"
    fake = SimpleNamespace(__version__="0.99.0", RecordingStream=object)
    monkeypatch.setattr("sniffer.ground.needs.importlib.import_module", lambda name: fake)
    with pytest.raises(
        OutputError, match=r"the Rerun SDK 0\.99\.0 has no rerun\.SeriesLines"
    ) as told:
        needs.need_rerun()
    assert pin in str(told.value)


def test_the_generated_messages_ask_for_no_version_of_protobuf() -> None:
    for path in (ROOT / "sniffer" / "messages").glob("*_pb2.py"):
        text = path.read_text(encoding="utf-8")
        assert "# Protobuf Python Version: 5.26" in text, "run `make schemas`"
        assert "ValidateProtobufRuntimeVersion" not in text
