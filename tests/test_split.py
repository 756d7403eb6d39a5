"""``sniffer cut --split``: pieces that lie side by side, and together are the whole."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

import sniffer
from sniffer.decoding.spans import PieceRow, Span
from sniffer.ground.model import Chunk, Mark, MarkKind
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


def test_who_is_known_to_have_been_silent_at_the_end_of_a_piece_did_not_answer(
    tmp_path: Path, capsys: Capsys
) -> None:
    """227 ms were silent behind a request that is due within 100, and it was told as cut off."""
    source = LOG.with_name("lss_damaged.log")
    within(capsys, "cut", source, "--split", "300ms", "-o", tmp_path / "part.mcap")
    whole, pieces = told(capsys, source), told(capsys, *sorted(tmp_path.glob("part-*.mcap")))
    missing = [[row for row in rows if row[0] == "no-response"] for rows in (whole, pieces)]
    assert len(missing[0]) == 8
    assert sorted(map(str, missing[1])) == sorted(map(str, missing[0]))


def test_pieces_of_several_buses_are_read_as_one_though_the_last_answer_of_one_was_late(
    tmp_path: Path, capsys: Capsys
) -> None:
    """It is of the piece of its request: behind it stands how the others ended, long before."""
    logs = [LOG.with_name(f"{name}_damaged.log") for name in ("lss", "mightyzap", "rs30x")]
    all_, whole = tmp_path / "all.mcap", tmp_path / "whole.mcap"
    assert within(capsys, "merge", *logs, "-o", all_, "--quiet").status == 0
    within(capsys, "cut", all_, "--to", "1.6", "-o", whole)
    within(capsys, "cut", whole, "--split", "500ms", "-o", tmp_path / "part.mcap")
    pieces = sorted(tmp_path.glob("part-*.mcap"))
    assert len(pieces) == 4

    def heard(*files: Path) -> Counter[tuple[str, str, str]]:
        ran = within(capsys, "decode", *files, "--format", "jsonl")
        assert ran.status == 0
        rows = map(json.loads, ran.out.splitlines())
        return Counter((r["type"], r["bus"], r.get("hex", "")) for r in rows if "bus" in r)

    assert heard(*pieces) == heard(whole)


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


def test_a_bus_has_one_name_in_all_pieces_that_are_handed_on(robot: Path, tmp_path: Path) -> None:
    """Each was named by who speaks first in it."""
    lines = robot.read_text().splitlines()
    late = next(n for n, line in enumerate(lines) if float(line[1:17]) > 1795215306.5)
    lines[late:] = [line for line in lines[late:] if " arm " not in line]
    robot.write_text("\n".join(lines) + "\n")
    sniffer.split(robot, [tmp_path / "x.log"], 500_000_000, anonymise=True)
    buses = [
        {line.split()[1] for line in path.read_text().splitlines()}
        for path in sorted(tmp_path.glob("x-*.log"))
    ]
    assert buses[0] == {"bus0", "bus1"}
    assert buses[1] == {"bus1"}


@pytest.mark.parametrize("speaks_again", [False, True])
def test_a_bus_that_is_silent_does_not_keep_what_others_say_meanwhile(
    *, speaks_again: bool
) -> None:
    spans = [{"arm": Span(0, 2, 9), "leg": Span(0, 9, 1)}, {"leg": Span(9, 810, 1)}]
    spans.append({"arm": Span(2, 4, None), "leg": Span(810, 900, None)})
    mark = (Mark(MarkKind.BACK, 0),)
    again = [[Chunk(b"", 99, bus="arm", marks=mark), Chunk(b"cd", 99, bus="arm")]]
    groups = iter(
        [
            [Chunk(b"ab", 1, bus="arm")],
            *([Chunk(bytes(9), n, bus="leg")] for n in range(90)),
            *(again if speaks_again else []),
            *([Chunk(bytes(9), n, bus="leg")] for n in range(90, 100)),
        ]
    )
    row = PieceRow(groups, spans, {"arm": 1, "leg": 1})
    first = [chunk for group in row.piece(0) for chunk in group]
    assert b"".join(c.data for c in first if c.bus == "leg") == bytes(9)
    left = list(groups)
    assert len(left) > 90, "the rest of leg was read, and kept, to hear of arm"
    row = PieceRow(iter([*[[c] for c in first if c.data], *left]), spans, {"arm": 1, "leg": 1})
    pieces = [[chunk for group in row.piece(n) for chunk in group] for n in range(3)]
    arm = [chunk for chunk in pieces[2] if chunk.bus == "arm" and chunk.marks[:1] != ()]
    assert bool(arm) == speaks_again, "what is marked while it was silent stands in front of it"
    said = {bus: [b"".join(c.data for c in p if c.bus == bus) for p in pieces] for bus in spans[0]}
    assert said["leg"] == [bytes(9), bytes(801), bytes(90)]
    assert said["arm"] == [b"ab", b"", b"cd" if speaks_again else b""]


@pytest.mark.parametrize("every_ns", [0, -1])
def test_a_piece_without_a_length_is_refused(every_ns: int, tmp_path: Path) -> None:
    with pytest.raises(sniffer.SnifferError, match="1 ns at least"):
        sniffer.split(LOG, [tmp_path / "x.log"], every_ns)


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


def test_where_nothing_was_said_there_is_no_piece_and_its_number_is_left_out(
    tmp_path: Path,
) -> None:
    lines = LOG.read_text("ascii").splitlines()[:60]
    later = [f"({float(line[1:17]) + 5:.6f}){line[line.index(')') + 1 :]}" for line in lines]
    source = tmp_path / "a.log"
    source.write_text("\n".join(lines + later) + "\n")
    done = sniffer.split(source, [tmp_path / "x.log"], 2_000_000_000)
    assert [piece.files[0].name for piece in done] == ["x-0001.log", "x-0003.log"]


def test_of_many_pieces_the_first_and_the_last_are_named(tmp_path: Path, capsys: Capsys) -> None:
    ran = within(capsys, "cut", LOG, "--split", "500ms", "-o", tmp_path / "p.log")
    assert ran.status == 0
    assert "wrote 17 files, " in ran.err
    assert ran.err.strip().endswith("p-0017.log")


def test_pieces_of_an_earlier_split_that_stand_behind_these_are_named(
    tmp_path: Path, capsys: Capsys
) -> None:
    out = tmp_path / "p.log"
    assert within(capsys, "cut", LOG, "--split", "2s", "-o", out).status == 0
    ran = within(capsys, "cut", LOG, "--split", "3s", "-o", out, "--force")
    assert "behind these stands what is not of this split: p-0004.log and p-0005.log" in ran.err
    again = within(capsys, "cut", LOG, "--split", "2s", "-o", out, "--force")
    assert "not of this split" not in again.err
