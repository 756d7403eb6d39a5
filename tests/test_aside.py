"""What stood where an output is written: it is back where nothing comes of that."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from sniffer.ground.model import Chunk, Clock
from sniffer.mcapfile.sink import McapSink
from tests.commands import talk, within
from tests.disks import disk
from tests.recordings import talk as simulated

if TYPE_CHECKING:
    from pathlib import Path

    Capsys = pytest.CaptureFixture[str]

DEAR = b"dear to somebody"

posix = pytest.mark.skipif(sys.platform == "win32", reason="needs links and disks of POSIX")


@pytest.mark.parametrize("content", [b"", bytes(range(7, 200)) * 40], ids=["nothing", "noise"])
@pytest.mark.parametrize("suffix", [".mcap", ".csv", ".jsonl"])
def test_an_input_of_which_nothing_is_decoded_replaces_no_file(
    suffix: str, content: bytes, tmp_path: Path, capsys: Capsys
) -> None:
    source, kept = tmp_path / "a.bin", tmp_path / f"x{suffix}"
    source.write_bytes(content)
    kept.write_bytes(DEAR)
    for command in (("convert", source, kept), ("decode", source, "-o", kept)):
        assert within(capsys, *command, "--force").status == 2
        assert kept.read_bytes() == DEAR


@pytest.mark.parametrize(
    "command",
    [
        "convert good x.csv --from 100 --to 200",
        "decode good -o x.jsonl --from 100 --to 200",
        "view good -o x.rrd --from 100 --to 200",
        "replay noise -o x.mcap --speed 0",
        "diff noise good -o x.rrd",
        "diff good good -o x.rrd --where value>1e9",
        "cut good x.mcap --from 100 --to 200",
    ],
)
def test_what_comes_to_nothing_replaces_no_file(
    command: str, good: Path, tmp_path: Path, capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    noise = tmp_path / "noise"
    noise.write_bytes(bytes(range(7, 200)) * 40)
    words = [{"good": str(good)}.get(word, word) for word in command.split()]
    (kept,) = (tmp_path / word for word in words if word.startswith("x."))
    kept.write_bytes(DEAR)
    assert within(capsys, *words, "--force").status == 2
    assert kept.read_bytes() == DEAR
    assert sorted(tmp_path.iterdir()) == sorted([good, kept, noise])


@posix
def test_an_output_that_finds_no_room_gives_back_what_stood_there(
    tmp_path: Path, capsys: Capsys
) -> None:
    source = tmp_path / "long.bin"
    source.write_bytes(talk(3000))
    with disk(tmp_path / "small", "100k") as folder:
        kept = folder / "x.jsonl"
        kept.write_bytes(DEAR)
        ran = within(capsys, "convert", source, kept, "--force")
        assert ran.status == 2
        assert f"{kept}: cannot be written (No space left on device)" in ran.complaint
        assert kept.read_bytes() == DEAR
        assert [*folder.iterdir()] == [kept]


@posix
def test_a_file_is_replaced_as_it_was_where_a_link_led_to_it(
    good: Path, tmp_path: Path, capsys: Capsys
) -> None:
    kept, link = tmp_path / "kept.jsonl", tmp_path / "x.jsonl"
    kept.write_bytes(DEAR)
    kept.chmod(0o640)
    link.symlink_to(kept)
    assert within(capsys, "decode", good, "--quiet", "-o", link, "--force").status == 0
    assert link.is_symlink()
    assert kept.read_bytes().startswith(b'{"type":')
    assert kept.stat().st_mode & 0o777 == 0o640
    assert sorted(tmp_path.iterdir()) == sorted([good, kept, link])


def test_what_is_decoded_of_one_bus_is_written_also_where_another_is_none(
    tmp_path: Path, capsys: Capsys
) -> None:
    arm = simulated("mightyzap", 0.2, bus="arm")
    noise = Chunk(bytes(range(7, 200)), (arm[-1].t_ns or 0) + 1, Clock.READ, "leg")
    source, out = tmp_path / "two.mcap", tmp_path / "x.jsonl"
    sink = McapSink(source, {"tool": "test"})
    sink.raw("arm", arm)
    sink.raw("leg", [noise])
    sink.close()
    out.write_bytes(DEAR)
    ran = within(capsys, "convert", source, out, "--force")
    assert ran.status == 2
    assert "on leg" in ran.complaint
    assert out.read_bytes().startswith(b'{"type":"frame","bus":"arm"')


@posix
def test_what_a_killed_run_put_away_is_gone_once_something_is_in_its_place(
    good: Path, tmp_path: Path, capsys: Capsys
) -> None:
    with subprocess.Popen([sys.executable, "-c", ""]) as ended:
        pass
    kept = tmp_path / "x.csv"
    kept.write_bytes(b"half of it")
    names = {ended.pid: False, os.getppid(): True, "mine": True}
    for name in names:
        (tmp_path / f".x.csv.{name}.old").write_bytes(DEAR)
    assert within(capsys, "convert", good, kept, "--force").status == 0
    assert {name: (tmp_path / f".x.csv.{name}.old").exists() for name in names} == names
