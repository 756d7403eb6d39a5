"""The README keeps its word: transcripts are what commands print, every command is shown."""

from __future__ import annotations

import re
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from sniffer.cli import cli
from tests.commands import environment
from tests.terminals import PATIENCE_S
from tests.transcripts import (
    ROOT,
    Stage,
    abridged,
    agrees,
    fences,
    is_run,
    missing_tools,
    renewed,
    shown,
)

if TYPE_CHECKING:
    from pathlib import Path

README = ROOT / "README.md"
TEXT = README.read_text(encoding="utf-8")
HINT = "if the change is meant: make golden, and read the diff"


def test_every_transcript_is_what_the_command_prints(tmp_path: Path) -> None:
    wrong: list[str] = []
    run = 0
    with Stage(tmp_path) as stage:
        for one in shown(TEXT):
            if not is_run(one) or missing_tools(one):
                continue
            got = stage.run(one)
            run += 1
            true = not one.told or agrees(one.output, got, live=one.live)
            if not true or stage.status not in (0, 1):
                printed = "\n".join(abridged(got, one.output))
                wrong.append(f"$ {one.source}\n{printed}")
    assert run > 10
    assert not wrong, f"{HINT}; these print something else:\n" + "\n\n".join(wrong)


@pytest.mark.parametrize("name", sorted(cli.commands))
def test_every_command_is_in_the_readme(name: str) -> None:
    assert re.search(rf"\bsniffer {name}\b", TEXT)


def test_the_demo_tells_its_story_on_one_screen(tmp_path: Path) -> None:
    (tmp_path / "sample_captures").symlink_to(ROOT / "sample_captures")
    done = subprocess.run(
        [sys.executable, "-m", "sniffer.cli.demo"],
        cwd=tmp_path,
        env=environment(COLUMNS="80", DISPLAY="", WAYLAND_DISPLAY=""),
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=True,
    )
    assert done.stderr == ""
    lines = done.stdout.splitlines()
    assert len(lines) <= 40
    assert lines == [line.rstrip() for line in lines]
    assert "brownout, 99 % sure" in done.stdout
    assert "duplicate-id" in done.stdout
    made = {path.name for path in (tmp_path / "demo-out").iterdir()}
    assert made == {"demo.mcap", "demo.rrd", "demo.html"}


@pytest.mark.parametrize("target", ["demo", "test"])
def test_every_make_target_the_readme_shows_exists(target: str) -> None:
    assert f"$ make {target}" in TEXT
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert re.search(rf"^{target}:", makefile, re.MULTILINE)


def test_every_option_in_the_readme_is_an_option_of_its_command() -> None:
    for one in shown(TEXT):
        for call in re.findall(r"\bsniffer (\w+)([^|;&]*)", one.source):
            known = {o for p in cli.commands[call[0]].params for o in p.opts}
            given = set(re.findall(r"(?<!\S)--?[a-z][\w-]*", call[1]))
            assert given <= known, one.source


@pytest.mark.parametrize(
    ("said", "got", "same"),
    [
        (["a"], ["a"], True),
        (["a"], ["a", "b"], False),
        (["a", "..."], ["a", "b", "c"], True),
        (["a", "...", "c"], ["a", "b", "c"], True),
        (["a", "...", "c"], ["a", "c"], True),
        (["a", "...", "a"], ["a"], False),
        (["b", "..."], ["a", "b"], False),
        ([], [], True),
        ([], ["a"], False),
    ],
)
def test_dots_stand_for_lines_left_out(said: list[str], got: list[str], same: bool) -> None:
    assert agrees(said, got) is same


@pytest.mark.parametrize(
    ("said", "got", "same"),
    [
        ("1 < QD  position 35.6 deg   <3.03 ms", "1 < QD  position 5.8 deg  11.1 ms", True),
        ("/dev/pts/3", "/dev/pts/14", True),
        ("12 frames", "12 gaps", False),
        ("12", "12 more", False),
        ("6 frames, 2 anomalies", "7 frames, 1 anomaly", True),
        ("0 bytes in no frame", "1 byte in no frame", True),
    ],
)
def test_what_happens_now_has_other_numbers_each_time(said: str, got: str, *, same: bool) -> None:
    assert agrees([said], [got], live=True) is same
    assert not agrees([said], [got])


def test_a_command_in_the_background_goes_on_until_it_is_waited_for_or_the_page_is_done(
    tmp_path: Path,
) -> None:
    begun = "echo sniffer 1; while ! test -e go; do sleep 0.02; done; echo 2; exit &"
    page = f"```console\n$ {begun}\nsniffer 0\n$ touch go; sniffer --version >&2\n...\n```\n"
    page += "```console\n$ wait %1\n0\n$ sniffer simulate wck &\n/dev/pts/0\n```\n"
    with Stage(tmp_path) as stage:
        for one in shown(page):
            assert agrees(one.output, stage.run(one), live=True), one.source
            assert one.live
        first, second = (job.process for job in stage.jobs)
        assert (first.poll(), second.poll()) == (0, None)
    assert second.poll() is not None


def test_a_recorder_that_is_killed_in_an_example_has_recorded_as_long_as_the_page_says(
    tmp_path: Path,
) -> None:
    lines = (
        "sniffer simulate wck --link bus &\n/dev/pts/0",
        "sniffer record bus=wck --quiet -o cut.mcap & sleep 2; kill -9 $!",
        "sniffer replay cut.mcap --speed 0 --from 1.5 | grep -c ' < '",
    )
    page = "```console\n" + "".join(f"$ {line}\n" for line in lines) + "```\n"
    with Stage(tmp_path) as stage:
        got = [(stage.run(one), stage.status) for one in shown(page)]
        assert [job.process.poll() for job in stage.jobs] == [None, -9]
    assert [status for _, status in got] == [0, 0, 0]
    assert int(got[2][0][-1]) > 0


@pytest.mark.parametrize(
    "line",
    [
        "sniffer decode no-such-file.bin",
        "sniffer record no-such-port=wck --quiet -o x.mcap & sleep 1; kill -9 $!",
    ],
)
def test_what_a_command_that_fails_prints_is_written_into_no_page(
    tmp_path: Path, line: str
) -> None:
    with pytest.raises(SystemExit, match=r"ends with status 2:\nsniffer: no-such-.* no such"):
        renewed(f"```console\n$ {line}\nas it was\n```\n", tmp_path)


def test_a_page_written_anew_says_what_is_printed_and_keeps_what_it_left_out(
    tmp_path: Path,
) -> None:
    page = (
        "a\n```console\n$ make demo\n$ sniffer --version | tr a-z A-Z\nold\n```\n"
        "```console\n$ sniffer --help\n1\n2\n...\n1\n```\n"
        "```python\nprint(1 + 1)\n```\n\n```text\n```\nb\n"
    )
    new = renewed(page, tmp_path)
    assert "$ make demo\n$ sniffer --version | tr a-z A-Z\nSNIFFER, VERSION " in new
    assert "\n```\n```console\n$ sniffer --help\nUsage: sniffer [OPTIONS] COMMAND" in new
    assert len(fences(new)[1].text.splitlines()) == 5
    assert new.endswith("```python\nprint(1 + 1)\n```\n\n```text\n2\n```\nb\n")
