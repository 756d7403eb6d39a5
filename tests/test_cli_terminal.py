"""What text looks like on terminals and in pipes: colours, widths, times."""

from __future__ import annotations

import contextlib
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from rich.cells import cell_len

import sniffer
from sniffer.decoding.rows import AnomalyRow, FrameRow
from sniffer.sinks.text import WIDE
from tests.commands import COMMAND, environment, started, talk, two_buses, within
from tests.terminals import PATIENCE_S
from tests.test_cli_text import ANSI, CAPTURES, rows_of, sample, shown, table_of

Capsys = pytest.CaptureFixture[str]
Patch = pytest.MonkeyPatch


def on_a_terminal(*arguments: str | Path, status: int = 0, **env: str) -> str:
    """Run a command whose output is a terminal, and return what that was sent."""
    pty = pytest.importorskip("pty")
    ours, theirs = pty.openpty()
    try:
        with Path(os.devnull).open("wb") as nothing:
            variables = {"TERM": "xterm-256color", **env}
            process = started(*arguments, out=theirs, err=nothing.fileno(), env=variables)
        os.close(theirs)
        sent = b""
        while True:
            got = b""
            with contextlib.suppress(OSError):  # Linux ends so, others with an empty read
                got = os.read(ours, 1 << 16)
            if not got:
                break
            sent += got
        assert process.wait(PATIENCE_S) == status
    finally:
        os.close(ours)
    return sent.decode().replace("\r\n", "\n")


@pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")
def test_colour_is_for_terminals_and_changes_nothing_else(
    capsys: Capsys, monkeypatch: Patch
) -> None:
    path = CAPTURES / "wck_damaged.log"
    coloured = on_a_terminal("decode", path, COLUMNS="80")
    assert "\x1b[31m" in coloured  # an error
    assert "\x1b[32m" in coloured  # an answer
    assert ANSI.sub("", coloured) == sample(capsys, monkeypatch, path.name, 80)
    for command in (["protocols"], ["registers", "wck"], ["explain", "FF FF FF 00 02 F1 0C"]):
        monkeypatch.setenv("COLUMNS", "80")
        assert ANSI.sub("", on_a_terminal(*command, COLUMNS="80")) == within(capsys, *command).out


@pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")
def test_no_color_is_respected() -> None:
    plain = on_a_terminal("decode", CAPTURES / "wck_damaged.log", COLUMNS="80", NO_COLOR="1")
    assert not re.search(r"\x1b\[[34]\d", plain)


def piped(*arguments: object, **variables: str) -> str:
    """Return what a command writes into a pipe whose width nobody states."""
    command = [*COMMAND, *map(str, arguments)]
    env = environment(**variables)
    env = {k: v for k, v in env.items() if k != "FORCE_COLOR" or k in variables}
    done = subprocess.run(command, capture_output=True, env=env, check=True)
    return done.stdout.decode()


def test_in_a_pipe_no_cell_is_cut_and_every_byte_is_there() -> None:
    head, lines = table_of(piped("decode", CAPTURES / "mightyzap_damaged.log"))
    assert {"bus", "bytes"} < set(head.split())
    assert not any("…" in line for line in lines)
    rows = rows_of("mightyzap_damaged.log")
    assert len(lines) == len(rows)
    for line, row in zip(lines, rows, strict=True):
        assert bytes.fromhex(row.hex).hex(" ").upper() in line
    assert any("punch_initial_value 0" in line for line in lines)  # the last of 21 registers


def test_colour_is_forced_and_forbidden_by_option_and_environment() -> None:
    path = CAPTURES / "wck_manual.hex"
    plain = piped("decode", path)
    assert "\x1b" not in plain
    for coloured in (
        piped("decode", path, "--color", "always", NO_COLOR="1", TERM="dumb"),
        piped("decode", path, FORCE_COLOR="1", TERM="xterm"),
    ):
        assert "\x1b[32m" in coloured
        assert ANSI.sub("", coloured) == plain
    assert piped("decode", path, "--color", "never", FORCE_COLOR="1", TERM="xterm") == plain


@pytest.mark.parametrize("width", [80, 140])
def test_times_count_from_the_first_line_or_from_the_line_before(
    width: int, capsys: Capsys, monkeypatch: Patch
) -> None:
    path, digits = CAPTURES / "rs30x_manual.hex", 3 if width == 80 else 6
    rows = rows_of(path.name)
    ends = [row.t_ns for row in rows]
    befores = {"rel": [ends[0]] * len(ends), "delta": [ends[0], *ends[:-1]]}
    for how, before in befores.items():
        text = shown(capsys, monkeypatch, path, width, "--time", how)
        told = [line.split()[0] for line in table_of(text)[1]]
        assert told == [f"{(t - b) / 1e9:.{digits}f}" for t, b in zip(ends, before, strict=True)]


def test_times_of_a_selection_count_from_where_the_capture_begins(
    capsys: Capsys, monkeypatch: Patch
) -> None:
    """So they can be given to --from; the first line that was selected was 0."""
    monkeypatch.delenv("COLUMNS", raising=False)  # as into a pipe: nothing is left out
    path = CAPTURES / "mightyzap_damaged.log"
    asked = ("decode", path, "--time", "rel", "--code", "bad-checksum")
    first = within(capsys, *asked).out.splitlines()[1].split()[0]
    rows = [row for row in sniffer.decode(path) if isinstance(row, FrameRow | AnomalyRow)]
    bad = next(row for row in rows if isinstance(row, AnomalyRow) and row.code == "bad-checksum")
    began = next(row.t_ns for row in rows if isinstance(row, FrameRow))
    assert float(first) == pytest.approx((bad.t_ns - began) / 1e9, abs=1e-5)
    part = within(capsys, "decode", path, "--from", str(float(first) - 0.001), "--code", asked[-1])
    assert part.out.splitlines()[1].split()[4] == "bad-checksum"


@pytest.mark.parametrize("begin", ["3", "@bad-checksum", "-5s", "22:55:09"])
def test_times_of_a_part_count_from_where_the_capture_begins(
    begin: str, capsys: Capsys, monkeypatch: Patch
) -> None:
    """The same frame had another time in each part, and none that --from takes."""
    monkeypatch.delenv("COLUMNS", raising=False)  # as into a pipe: nothing is left out
    path = CAPTURES / "mightyzap_damaged.log"
    asked = ("decode", path, "--time", "rel")
    whole = within(capsys, *asked).out.split("\n\n")[0].splitlines()
    part = within(capsys, *asked, "--from", begin)
    lines = part.out.split("\n\n")[0].splitlines()
    assert lines[1:] == whole[-len(lines) + 1 :]
    told = re.search(r"a part of it: .*, from second ([0-9.]+) on", part.err)
    assert (told is None) == (begin == "3")
    if told is not None:
        again = within(capsys, *asked, "--from", told[1]).out.split("\n\n")[0]
        assert again.splitlines() == lines


def test_a_line_counts_from_the_one_before_of_its_bus(
    tmp_path: Path, capsys: Capsys, monkeypatch: Patch
) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)  # as into a pipe: nothing is left out
    path = two_buses(tmp_path / "two.log", CAPTURES / "mightyzap_damaged.log")
    asked = ("decode", path, "--time", "delta", "--kind", "request")
    both = within(capsys, *asked).out.splitlines()
    alone = within(capsys, *asked, "--where", "bus = 'leg'").out.splitlines()
    of_leg = [[line for line in lines if " leg " in line] for lines in (both, alone)]
    assert of_leg[0] == of_leg[1]
    assert len(of_leg[0]) > 5
    assert "line before of the same bus" in " ".join(within(capsys, "decode", "--help").out.split())


def test_the_widths_that_the_readme_names_are_those_of_the_table(tmp_path: Path) -> None:
    text = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
    found = re.search(r"From (\d+) columns on the\s+table has .*?from (\d+) on the bytes", text)
    assert found is not None
    path = tmp_path / "good.bin"
    path.write_bytes(talk(2))
    heads = {}
    for width in (WIDE - 1, WIDE, int(found[2]) - 1, int(found[2])):
        command = [*COMMAND, "decode", str(path)]
        done = subprocess.run(
            command, capture_output=True, env=environment(COLUMNS=str(width)), check=True
        )
        heads[width] = done.stdout.decode().splitlines()[0].split()
    assert int(found[1]) == WIDE
    assert [("bus" in h, "bytes" in h) for h in heads.values()] == [
        (False, False),
        (True, False),
        (True, False),
        (True, True),
    ]


def test_columns_stand_under_each_other_where_names_have_signs_of_two_cells(
    capsys: Capsys, monkeypatch: Patch
) -> None:
    path = CAPTURES / "rs30x_manual.hex"
    text = shown(capsys, monkeypatch, path, 140, "--name", "1=左膝関節")
    lines = [line for line in text.splitlines() if re.search(r" [<>] \w", line)]
    assert len({cell_len(re.split(r" [<>] \w", line)[0]) for line in lines}) == 1
    assert any("左膝関節" in line for line in lines)
