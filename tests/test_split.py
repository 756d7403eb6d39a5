"""``sniffer cut --split``: pieces that lie side by side, and together are the whole."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import sniffer
from sniffer.mcapfile.source import session
from tests.commands import within

Capsys = pytest.CaptureFixture[str]

BY_WHAT_WAS = {"capture-start", "capture-end", "device-recovered"}
"""Codes that depend on what was said before a piece, or behind it."""

LOG = Path(__file__).parents[1] / "sample_captures" / "mightyzap_damaged.log"


def hexed(path: Path) -> str:
    """Return all bytes of a log, whatever its lines are."""
    return "".join(line.rpartition("#")[2] for line in path.read_text("ascii").splitlines())


def told(capsys: Capsys, *files: Path) -> list[Any]:
    """Return what frames and anomalies captures have, without what depends on their edges."""
    out: list[Any] = []
    for file in files:
        lines = within(capsys, "decode", file, "--format", "jsonl").out.splitlines()
        for row in map(json.loads, lines):
            if row["type"] == "frame":
                out.append((row["hex"], row["kind"], row["servo_id"]))
            elif row["type"] == "anomaly" and row["code"] not in BY_WHAT_WAS:
                out.append((row["code"], row["servo_id"]))
    return out


def test_pieces_by_time_say_together_what_the_whole_says(tmp_path: Path, capsys: Capsys) -> None:
    out = tmp_path / "part.log"
    ran = within(capsys, "cut", LOG, "--split", "3s", "-o", out)
    pieces = sorted(tmp_path.glob("part-*.log"))
    assert ran.status == 0
    assert [piece.name for piece in pieces] == [f"part-{n:04}.log" for n in (1, 2, 3)]
    assert "".join(map(hexed, pieces)) == hexed(LOG), "no byte is in two of them, or in none"
    whole = told(capsys, LOG)
    assert len(whole) > 1400
    assert sorted(map(str, told(capsys, *pieces))) == sorted(map(str, whole))


def test_a_piece_knows_of_what_it_is_one_and_from_when_to_when(tmp_path: Path) -> None:
    done = sniffer.split(LOG, [tmp_path / "a.mcap"], 2_000_000_000, sniffer.Window("1", "6"))
    assert [piece.files[0].name for piece in done] == [f"a-{n:04}.mcap" for n in (1, 2, 3)]
    facts = [session(piece.files[0]) for piece in done]
    begins = [int(fact["cut.from_ns"]) for fact in facts]
    assert [begin - begins[0] for begin in begins] == [0, 2_000_000_000, 4_000_000_000]
    offsets = [int(fact["cut.offset.bus0"]) for fact in facts]
    assert offsets == sorted(set(offsets))


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    """A log of two buses."""
    lines = LOG.read_text("ascii").splitlines()[:400]
    path = tmp_path / "robot.log"
    path.write_text(
        "\n".join(line.replace(" bus0 ", f" {bus} ") for line in lines for bus in ("arm", "l/eg"))
        + "\n"
    )
    return path


def test_pieces_by_bus_are_called_after_it(robot: Path, tmp_path: Path, capsys: Capsys) -> None:
    ran = within(capsys, "cut", robot, "--split", "bus", "-o", tmp_path / "x.log")
    assert ran.status == 0
    arm, leg = tmp_path / "x-arm.log", tmp_path / "x-l_eg.log"
    assert {line.split()[1] for line in arm.read_text().splitlines()} == {"arm"}
    assert {line.split()[1] for line in leg.read_text().splitlines()} == {"l/eg"}
    assert hexed(arm) == hexed(leg)
    assert len(hexed(arm)) * 2 == len(hexed(robot))


def test_buses_whose_names_make_one_name_of_a_file_have_files_of_their_own(
    robot: Path, tmp_path: Path
) -> None:
    robot.write_text(robot.read_text().replace(" arm ", " l:eg "))
    done = sniffer.split(robot, [tmp_path / "x.log"], None)
    assert [piece.files[0].name for piece in done] == ["x-l_eg.log", "x-l_eg_.log"]


def test_pieces_that_are_handed_on_do_not_name_the_bus(robot: Path, tmp_path: Path) -> None:
    done = sniffer.split(robot, [tmp_path / "x.log"], None, anonymise=True)
    assert [piece.files[0].name for piece in done] == ["x-bus0.log", "x-bus1.log"]


def test_nothing_is_written_where_one_of_the_pieces_is_there_already(
    tmp_path: Path, capsys: Capsys
) -> None:
    there = tmp_path / "part-0003.log"
    there.write_text("mine")
    ran = within(capsys, "cut", LOG, "--split", "3s", "-o", tmp_path / "part.log")
    assert ran.status == 2
    assert "part-0003.log is there already" in ran.err
    assert [path.name for path in tmp_path.iterdir()] == ["part-0003.log"]
    assert there.read_text() == "mine"


@pytest.mark.parametrize(
    ("by", "why"),
    [
        ("soon", "'soon': write a time such as 10min, or bus"),
        ("0s", "'0s': write a time such as 10min, or bus"),
    ],
)
def test_a_split_that_cannot_be_says_what_to_write(
    by: str, why: str, tmp_path: Path, capsys: Capsys
) -> None:
    ran = within(capsys, "cut", LOG, "--split", by, "-o", tmp_path / "part.log")
    assert ran.status == 2
    assert why in ran.err
    assert not [*tmp_path.iterdir()]


def test_more_pieces_than_anybody_can_want_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sniffer.jobs.split.MOST", 8)
    with pytest.raises(sniffer.SnifferError, match="makes 9 pieces, 8 at most: make them longer"):
        sniffer.split(LOG, [tmp_path / "part.log"], 1_000_000_000)
    assert not [*tmp_path.iterdir()]


def test_of_many_pieces_the_first_and_the_last_are_named(tmp_path: Path, capsys: Capsys) -> None:
    ran = within(capsys, "cut", LOG, "--split", "500ms", "-o", tmp_path / "p.log")
    assert ran.status == 0
    assert "wrote 17 files, " in ran.err
    assert ran.err.strip().endswith("p-0017.log")
