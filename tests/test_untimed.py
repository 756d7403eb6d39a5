"""A capture without a clock: what its times are is said wherever times are asked for."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Final

import pytest

from tests.commands import within
from tests.golden import captures

if TYPE_CHECKING:
    from pathlib import Path

Capsys = pytest.CaptureFixture[str]

CAPTURES: Final = {path.name: path for path in captures()}
UNTIMED, TIMED = CAPTURES["rs30x_clean.hex"], CAPTURES["rs30x_damaged.log"]


@pytest.mark.parametrize("table", [[], ["--wide", "--every", "20ms"]], ids=["rows", "every"])
def test_a_table_of_times_that_no_clock_told_says_so(
    table: list[str], tmp_path: Path, capsys: Capsys
) -> None:
    ran = within(capsys, "convert", UNTIMED, tmp_path / "x.csv", *table)
    told = "no clock in the input: times count its bytes at 115200 baud, without the pauses"
    assert told in ran.err
    assert told not in within(capsys, "convert", TIMED, tmp_path / "y.csv", *table).err


def test_slices_of_time_are_told_to_be_none_where_no_clock_is(capsys: Capsys) -> None:
    ran = within(capsys, "stats", UNTIMED, "--every", "1s")
    assert "sniffer: no clock in the input: --every has no time to count by" in ran.err
    assert "--every" not in within(capsys, "stats", UNTIMED).err
    assert "--every" not in within(capsys, "stats", TIMED, "--every", "1s").err


def test_a_run_without_a_clock_has_no_length_to_compare(capsys: Capsys) -> None:
    ran = within(capsys, "diff", UNTIMED, TIMED)
    assert ran.out.splitlines()[0] == f"A: {UNTIMED}: no clock, 625 answers expected, 0 failed"
    assert f"B: {TIMED}: 5.0 s, " in ran.out
    told = json.loads(within(capsys, "diff", UNTIMED, TIMED, "--format", "json").out)
    assert told["a"]["seconds"] is None
    assert told["b"]["seconds"] == pytest.approx(5.0, abs=0.1)


def test_a_part_in_seconds_of_a_capture_without_a_clock_says_what_they_count(
    capsys: Capsys,
) -> None:
    ran = within(capsys, "decode", UNTIMED, "--summary", "--from", "1")
    told = "a part of it: from second 1 to its end; no clock in the input: seconds count its bytes"
    assert told in ran.err
    assert "no clock" not in within(capsys, "decode", TIMED, "--summary", "--from", "1").err


@pytest.mark.parametrize("capture", [UNTIMED, TIMED], ids=lambda path: path.suffix)
def test_a_capture_is_as_long_for_every_command(
    capture: Path, tmp_path: Path, capsys: Capsys
) -> None:
    commands: list[list[str | Path]] = [
        ["decode", capture],
        ["cut", capture, "-o", tmp_path / "cut.log"],
    ]
    where = "--from", "100"
    told = {
        within(capsys, *command, *where).err.splitlines()[-1].rpartition(" has ")[2]
        for command in commands
    }
    (length,) = told
    over = within(capsys, "decode", capture, "--summary").out
    assert f"over {length}" in over or "times are nominal" in over
    assert float(length.removesuffix(" s")) > 1
