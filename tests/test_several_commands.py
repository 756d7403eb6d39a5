"""Commands that read a capture read it in several files, too: such as those of a rotation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import pytest

from tests.commands import within
from tests.live import saved
from tests.test_several import CAPTURE, parts

if TYPE_CHECKING:
    from pathlib import Path

Capsys = pytest.CaptureFixture[str]

COMMANDS: Final = {
    "report": (),
    "discover": (),
    "discover of a part": ("--from", "0.2", "--to", "1"),
    "replay": ("--speed", "0"),
    "replay of a part": ("--speed", "0", "--from", "@first-error", "--around", "100ms"),
}


@pytest.mark.parametrize("what", COMMANDS)
def test_what_is_said_of_parts_is_what_is_said_of_the_whole(
    what: str, tmp_path: Path, capsys: Capsys
) -> None:
    command = what.partition(" ")[0]
    whole = within(capsys, command, CAPTURE, *COMMANDS[what])
    assert whole.status == 0, whole.err
    assert whole.out
    pieces = parts(tmp_path, (333, 900))
    told = within(capsys, command, *pieces, *COMMANDS[what])
    assert told.status == 0, told.err
    named = told.out.replace(" ".join(map(str, pieces)), str(CAPTURE))
    assert _of_the_traffic(named) == _of_the_traffic(whole.out)


def _of_the_traffic(text: str) -> list[str]:
    """Return what is said, without the line that says how it was written."""
    return [line for line in text.splitlines() if not line.startswith("- input: ")]


@pytest.mark.parametrize("place", [("--from", "0.5", "--to", "1.5"), ("--to", "@first-error")])
def test_what_is_cut_out_of_parts_is_what_is_cut_out_of_the_whole(
    place: tuple[str, ...], tmp_path: Path, capsys: Capsys
) -> None:
    whole, several = tmp_path / "whole.log", tmp_path / "several.log"
    assert within(capsys, "cut", CAPTURE, *place, "-o", whole).status == 0
    ran = within(capsys, "cut", *parts(tmp_path, (333, 900)), *place, "-o", several)
    assert ran.status == 0, ran.err
    assert several.read_text() == whole.read_text() != ""


@pytest.mark.parametrize(
    "command",
    [("cut", "--from", "0.2"), ("replay", "--speed", "0", "--to", "pty", "--as", "controller")],
)
def test_none_of_several_inputs_is_written_over(
    command: tuple[str, ...], tmp_path: Path, capsys: Capsys
) -> None:
    """It was looked whether the output is called as all of them together are."""
    pieces = parts(tmp_path, (333, 900))
    last = pieces[-1].read_bytes()
    name, *options = command
    ran = within(capsys, name, *pieces, *options, "-o", pieces[-1], "--force")
    assert ran.complaint == f"{pieces[-1]} is the input: choose another output"
    assert pieces[-1].read_bytes() == last


def test_the_bytes_of_parts_are_copied_beside_what_is_decoded(
    tmp_path: Path, capsys: Capsys
) -> None:
    copy, decoded = tmp_path / "copy.log", tmp_path / "copy.jsonl"
    ran = within(capsys, "decode", *parts(tmp_path, (700,)), "-o", copy, "-o", decoded, "--quiet")
    assert ran.status == 0, ran.err
    again = within(capsys, "decode", copy, "--format", "jsonl")
    assert again.out.splitlines()[-1] == decoded.read_text().splitlines()[-1]


@pytest.mark.parametrize("made", [("x.csv", "--wide", "--hold"), ("x.csv",), ("x.log",)])
def test_what_is_made_of_parts_together_is_what_is_made_of_the_whole(
    made: tuple[str, ...], tmp_path: Path, capsys: Capsys
) -> None:
    name, *how = made
    whole, several = tmp_path / f"whole-{name}", tmp_path / f"several-{name}"
    assert within(capsys, "convert", CAPTURE, whole, *how).status == 0
    pieces = parts(tmp_path, (333, 900))
    ran = within(capsys, "convert", "--together", *pieces, "-o", several, *how)
    assert ran.status == 0, ran.err
    assert several.read_text() == whole.read_text() != ""


def test_parts_together_without_a_file_to_make_are_refused(tmp_path: Path, capsys: Capsys) -> None:
    ran = within(capsys, "convert", "--together", *parts(tmp_path, (333, 900)))
    assert ran.status == 2
    assert ran.complaint == (
        "name OUT, behind -o, a file whose suffix says what to make: run.mcap, run.csv"
    )


def test_parts_are_drawn_as_the_whole_is(tmp_path: Path, capsys: Capsys) -> None:
    drawn = []
    for number, files in enumerate(([CAPTURE], parts(tmp_path, (333, 900)))):
        output = tmp_path / f"{number}.rrd"
        ran = within(capsys, "view", *files, "-o", output)
        assert ran.status == 0, ran.err
        rows = saved(output)
        # a mark stands on its curve as far as the pass has it
        drawn.append({k: sorted(t for t, _ in rows[k]) for k in rows if "/marks/" not in k})
    assert drawn[0] == drawn[1]
    assert any(map(len, drawn[0].values()))


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("replay", "--redecode"), "--redecode compares one recording: name one FILE"),
        (("open", "--follow"), "--follow shows what comes of one FILE: name one"),
    ],
)
def test_what_is_about_one_file_says_so(
    arguments: tuple[str, str], complaint: str, tmp_path: Path, capsys: Capsys
) -> None:
    command, option = arguments
    ran = within(capsys, command, *parts(tmp_path, (700,)), option)
    assert ran.status == 2
    assert complaint in ran.complaint


def test_a_port_is_looked_at_alone(tmp_path: Path, capsys: Capsys) -> None:
    first, _ = parts(tmp_path, (700,))
    ran = within(capsys, "open", first, "/dev/null")
    assert ran.status == 2
    assert "/dev/null is a port, which is looked at alone: name nothing else" in ran.complaint


def test_a_capture_of_many_files_is_called_after_the_first(tmp_path: Path, capsys: Capsys) -> None:
    pieces = parts(tmp_path, (300, 600, 900))
    ran = within(capsys, "report", *pieces)
    assert ran.out.splitlines()[0].endswith("part0.log and 3 more")
