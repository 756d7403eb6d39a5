"""Several inputs as one capture: the files of a rotation, captures one after the other."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import pytest

from tests.commands import within

if TYPE_CHECKING:
    from collections.abc import Iterable

Capsys = pytest.CaptureFixture[str]

CAPTURE: Final = Path(__file__).parents[1] / "sample_captures" / "mightyzap_damaged.log"


def told(capsys: Capsys, *files: Path) -> list[dict[str, Any]]:
    ran = within(capsys, "decode", *files, "--format", "jsonl")
    assert ran.status == 0, ran.err
    return [json.loads(line) for line in ran.out.splitlines()]


def parts(folder: Path, cuts: Iterable[int]) -> list[Path]:
    """Write the lines of a capture into several files."""
    lines = CAPTURE.read_text().splitlines(keepends=True)
    edges = [0, *cuts, len(lines)]
    out = []
    for n, (begin, end) in enumerate(itertools.pairwise(edges)):
        out.append(folder / f"part{n}.log")
        out[-1].write_text("".join(lines[begin:end]))
    return out


def test_the_parts_of_a_capture_are_the_capture_in_whatever_order_they_are_named(
    tmp_path: Path, capsys: Capsys
) -> None:
    whole = told(capsys, CAPTURE)
    first, second, third = parts(tmp_path, (333, 900))
    assert told(capsys, first, second, third) == whole
    assert told(capsys, third, first, second) == whole


def test_the_recordings_of_parts_are_one_recording(tmp_path: Path, capsys: Capsys) -> None:
    recordings = []
    for part in parts(tmp_path, (700,)):
        recordings.append(part.with_suffix(".mcap"))
        assert within(capsys, "decode", part, "-o", recordings[-1], "--quiet").status == 0
    *_, summary = told(capsys, *recordings)
    assert summary["bytes"] == told(capsys, CAPTURE)[-1]["bytes"]


@pytest.mark.parametrize(
    ("name", "complaint"),
    [
        ("copy.log", "begins before the one in front of it has ended: decode them one by one"),
        ("part0.log", "part0.log is named twice"),
        ("nix.log", "nix.log: there is no such file"),
    ],
)
def test_what_is_no_row_of_inputs_is_told_in_one_line(
    name: str, complaint: str, tmp_path: Path, capsys: Capsys
) -> None:
    first, _ = parts(tmp_path, (700,))
    (tmp_path / "copy.log").write_text(first.read_text())
    ran = within(capsys, "decode", first, tmp_path / name, "--quiet")
    assert ran.status == 2
    assert ran.err.splitlines()[-1].endswith(complaint)


def test_no_input_is_replaced_by_an_output(tmp_path: Path, capsys: Capsys) -> None:
    first, second = parts(tmp_path, (700,))
    output = second.rename(tmp_path / "second.jsonl")
    ran = within(capsys, "decode", first, output, "--force", "-o", output)
    assert ran.status == 2
    assert "second.jsonl is the input: choose another output" in ran.complaint


@pytest.mark.parametrize(("before_s", "is_told"), [(-1.0, False), (0.5, False), (5.0, True)])
def test_what_was_recorded_beside_another_is_told_to_be_merged(
    before_s: float, is_told: bool, tmp_path: Path, capsys: Capsys
) -> None:
    exchange = "FFFFFF0104F28C0775", "FFFFFF010900E50700004B047743"
    for name, start, end in (("a", 0.0, 20.0), ("b", 20.0 - before_s, 40.0)):
        lines = [
            f"({start + n / 10 + m / 100:.6f}) {name}  #{data}"
            for n in range(int((end - start) * 10))
            for m, data in enumerate(exchange)
        ]
        (tmp_path / f"{name}.log").write_text("\n".join(lines) + "\n")
    files = tmp_path / "a.log", tmp_path / "b.log"
    ran = within(capsys, "decode", *files, "--protocol", "mightyzap", "--baud", "57600")
    assert ran.status == 0
    assert ("sniffer merge" in ran.err) == is_told
    assert ran.err.count("b.log begins before") == is_told
