"""The bars of response times stand under each other, whatever the servos are called."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from rich.cells import cell_len

from tests.commands import within
from tests.test_stats import exchange

SAMPLES = Path(__file__).parents[1] / "sample_captures"
BEFORE_BARS = re.compile(r"^  (?:servo .*)? (?:took at least|at most)  ")


@pytest.mark.parametrize(
    "names",
    [
        (),
        ("--name", "12=left_shoulder_pitch"),
        ("--name", "3=hip", "--name", "112=toe"),
        ("--name", "12=左膝関節"),
    ],
)
@pytest.mark.parametrize("columns", ["80", "140"])
def test_bars_of_all_servos_begin_in_one_column(
    names: tuple[str, ...],
    columns: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    log = tmp_path / "run.log"
    chunks = [
        c
        for k in range(30)
        for n, servo in enumerate((3, 12, 112))
        for c in exchange(30.0 * k + 10 * n, servo=servo, took_ms=0.5 + k / 10)
    ]
    lines = (f"({(c.t_ns or 0) / 1e9:.6f}) arm #{c.data.hex()}\n" for c in chunks)
    log.write_text("".join(lines), encoding="ascii")
    ran = within(capsys, "stats", log, "--protocol", "mightyzap", "--baud", "57600", *names)
    assert ran.status == 0, ran.err
    found = filter(None, map(BEFORE_BARS.match, ran.out.splitlines()))
    begins = {cell_len(before[0]) for before in found}
    assert len(begins) == 1
    (axis,) = (line for line in ran.out.splitlines() if re.match(r" +\|\d", line))
    assert axis.index("|") >= min(begins)
    assert all(len(line) <= int(columns) for line in ran.out.splitlines())
