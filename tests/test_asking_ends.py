"""Places by time: where seconds count from, or back from, and what was said first from one on."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tests.commands import within
from tests.lists import each_in_turn
from tests.test_asking import CAPTURE, Capsys, told

if TYPE_CHECKING:
    from pathlib import Path


@each_in_turn(
    2,
    ("part", "from_ns", "to_ns"),
    [
        (("--from", "-2s"), 2_000_000_000, None),
        (("--from", "-2", "--to", "-500ms"), 2_000_000_000, 500_000_000),
        (("--to", "-2.5"), None, 2_500_000_000),
        (("--from", "-1h"), 3_600_000_000_000, None),
    ],
)
def test_a_place_with_a_minus_is_so_long_before_the_end(
    part: tuple[str, ...],
    from_ns: int | None,
    to_ns: int | None,
    capsys: Capsys,
) -> None:
    whole = told(capsys)
    end = max(row["t_ns"] for row in whole if row["type"] in ("frame", "gap"))
    *rows, summary = told(capsys, *part)
    asked = summary["selection"]
    want = [None if ns is None else end - ns for ns in (from_ns, to_ns)]
    assert [asked["from_ns"], asked["to_ns"]] == want
    assert "before its end" in asked["part"]
    frames = [row for row in rows if row["type"] == "frame"]
    first, last = want[0] or 0, want[1] or end
    assert frames == [
        row for row in whole if row["type"] == "frame" and first <= row["t_ns"] <= last
    ]


def test_a_part_before_the_end_that_ends_before_it_begins_is_refused(capsys: Capsys) -> None:
    ran = within(capsys, "decode", CAPTURE, "--from", "-1s", "--to", "-2s")
    assert (ran.status, ran.out) == (2, "")
    assert "--to must lie behind --from" in ran.err


def test_what_is_said_from_a_time_on_is_explained(capsys: Capsys) -> None:
    for place in ("-5s", "3", "22:55:07", "-1min", "7.5s"):
        asked = f"{CAPTURE}@{place}" if place != "3" else f"{CAPTURE}@3.0"
        rows = told(capsys, "--from", place)
        first = next(row for row in rows if row["type"] in ("frame", "gap"))
        head, *_ = within(capsys, "explain", asked).out.splitlines()
        assert head.partition(":")[0] == f"{CAPTURE}, byte {first['offset']} of bus0"
    over = within(capsys, "explain", f"{CAPTURE}@1h")
    assert (over.status, over.complaint) == (2, "1h: nothing was said from there on")


def test_a_place_may_be_so_long_before_or_behind_what_is_found(
    capsys: Capsys,
) -> None:
    whole = told(capsys)
    third = [row for row in whole if row.get("code") == "no-response"][2]["t_ns"]
    asked = told(capsys, "--from", "@no-response:3-100ms", "--to", "@no-response:3+.5s")[-1]
    ends = (asked["selection"]["from_ns"], asked["selection"]["to_ns"])
    assert ends == (third - 100_000_000, third + 500_000_000)
    drawn = within(capsys, "explain", f"{CAPTURE}@no-response:3+20ms").out
    at = [r for r in whole if r["type"] in ("frame", "gap") and r["t_ns"] >= third + 20_000_000]
    assert f"byte {at[0]['offset']} of bus0" in drawn
    for wrong in ("@no-response:3-100", "@no-response-1x", "@first-error--1s"):
        assert within(capsys, "decode", CAPTURE, "--from", wrong).status == 2


def test_seconds_count_from_the_first_byte_that_may_lie_long_before_the_first_stamp(
    tmp_path: Path, capsys: Capsys
) -> None:
    exchange = "FFFFFF0102F10BFFFFFF010200FC"
    log, part = tmp_path / "held.log", tmp_path / "part.log"
    log.write_text(
        f"(1795215306.500000) bus0 #{exchange * 66}\n(1795215307.000000) bus0 #{exchange}\n"
    )
    rows = [row for row in told(capsys, file=log) if row["type"] == "frame"]
    seconds = f"{(rows[9]['t_ns'] - rows[0]['t_ns']) / 1e9 + 0.0001:.6f}"
    found = [
        row
        for row in told(capsys, "--from", "0", "--to", seconds, file=log)
        if row["type"] == "frame"
    ]
    assert found == rows[: len(found)]
    assert 8 <= len(found) <= 10
    ran = within(capsys, "cut", log, "--from", "0", "--to", seconds, "-o", part)
    assert ran.status == 0, ran.err
    assert part.read_text().split("#")[1].startswith(exchange)
