"""Several inputs as one capture: the files of a rotation, captures one after the other."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import pytest

from sniffer.messages import ANCHOR
from sniffer.simulation.captures import SampleCapture
from sniffer.sources import open_source
from sniffer.sources.several import ONE_BY_ONE, open_sources
from tests.commands import within
from tests.inputs import chunks

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
        ("copy.log", "begins before the one in front of it has ended: " + ONE_BY_ONE),
        ("part0.log", "part0.log is named twice"),
        ("./../{folder}/part0.log", "/part0.log are one file"),
        ("nix.log", "nix.log: there is no such file"),
    ],
)
def test_what_is_no_row_of_inputs_is_told_in_one_line(
    name: str, complaint: str, tmp_path: Path, capsys: Capsys
) -> None:
    first, _ = parts(tmp_path, (700,))
    (tmp_path / "copy.log").write_text(first.read_text())
    named = f"{tmp_path}/{name.format(folder=tmp_path.name)}"
    ran = within(capsys, "decode", first, named, "--quiet")
    assert ran.status == 2
    assert ran.err.splitlines()[-1].endswith(complaint)


def test_inputs_of_several_buses_that_overlap_in_time_are_told_in_the_order_of_time(
    tmp_path: Path, capsys: Capsys
) -> None:
    """Two recorders of one run: the same as the capture that ``merge`` makes of them."""
    files = []
    for bus, protocol, seconds in (("arm", "mightyzap", 2.0), ("leg", "lss", 1.0)):
        capture = SampleCapture("", protocol, 1, seconds, "frames")
        files.append(tmp_path / f"{bus}.log")
        files[-1].write_bytes(
            capture.render(capture.frames()).replace(b" bus0 ", f" {bus} ".encode())
        )
    own = [list(open_source(file)) for file in files]
    merged = list(open_sources(files))
    times = [chunk.t_ns or 0 for group in merged for chunk in group]
    assert times == sorted(chunk.t_ns or 0 for group in itertools.chain(*own) for chunk in group)
    # a pass costs the same whatever it holds: not one for each change of the bus
    assert len(merged) <= sum(map(len, own)) < len(times) / 100
    both = tmp_path / "both.log"
    assert within(capsys, "merge", *files, "-o", both).status == 0
    shown = [within(capsys, "decode", *named).out for named in (files, files[::-1], [both])]
    assert shown[0].count("arm") > 100 < shown[0].count("leg")
    assert shown[0] == shown[1] == shown[2]


def test_no_input_is_replaced_by_an_output(tmp_path: Path, capsys: Capsys) -> None:
    first, second = parts(tmp_path, (700,))
    output = second.rename(tmp_path / "second.jsonl")
    ran = within(capsys, "decode", first, output, "--force", "-o", output)
    assert ran.status == 2
    assert "second.jsonl is the input: choose another output" in ran.complaint


def test_a_file_that_is_missing_in_a_row_is_told_with_how_many_bytes(
    tmp_path: Path, capsys: Capsys
) -> None:
    """Of a rotation of three files without the second, 100 % of the bytes were in frames."""
    from sniffer.mcapfile.sink import McapSink

    lines = chunks(CAPTURE)
    anchor = dict.fromkeys(ANCHOR, "7")
    files, at = [], 0
    for nth, part in enumerate((lines[:300], lines[300:700], lines[700:])):
        sink = McapSink(tmp_path / f"r{nth}.mcap", anchor, starts={"bus0": at})
        sink.raw("bus0", part)
        sink.close()
        at += sum(len(chunk.data) for chunk in part)
        files.append(tmp_path / f"r{nth}.mcap")
    missing = sum(len(chunk.data) for chunk in lines[300:700])
    for told in (
        within(capsys, "decode", files[0], files[2], "--summary"),
        within(capsys, "diagnose", "--together", files[0], files[2]),
    ):
        assert f"bus0: {missing} bytes before {files[2]} are in none of the files" in told.err
    rows = within(capsys, "decode", files[0], files[2], "--format", "jsonl").out
    assert f"{missing} bytes before this place were recorded, but not decoded" in rows
    whole = within(capsys, "decode", *files, "--format", "jsonl")
    assert "not-decoded" not in whole.out
    assert "none of the files" not in whole.err


def test_a_piece_of_a_split_that_is_missing_is_told_with_how_many_bytes(
    tmp_path: Path, capsys: Capsys
) -> None:
    assert within(capsys, "cut", CAPTURE, "-o", tmp_path / "x.mcap", "--split", "3s").status == 0
    first, second, third = sorted(tmp_path.glob("x-*.mcap"))
    missing = json.loads(within(capsys, "decode", second, "--format", "jsonl").out.splitlines()[-1])
    ran = within(capsys, "decode", first, third, "--summary")
    told = f"bus0: {missing['bytes']} bytes before {third} are in none of the files"
    assert told in ran.err
    assert "not-decoded" in ran.out
    for whole in ((first, second, third), (second, third)):
        ran = within(capsys, "decode", *whole, "--summary")
        assert "none of the files" not in ran.err
        assert "not-decoded" not in ran.out
