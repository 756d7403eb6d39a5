"""``sniffer stats --every``: a bus slice by slice of time, as a slow count of the rows has it."""

from __future__ import annotations

import csv
import io
import json
import math
from collections import Counter
from typing import TYPE_CHECKING, Any

import pytest

import sniffer
from sniffer.ground.model import NS, SnifferError
from sniffer.statistics.slices import COUNTED, QUANTILES
from tests.commands import records, two_buses, within
from tests.golden import captures
from tests.lists import each_in_turn, in_turn
from tests.schemas import hold_to

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

Capsys = pytest.CaptureFixture[str]
Interval = tuple[int, int]

(DAMAGED,) = (path for path in captures() if path.name == "mightyzap_damaged.log")


def by_hand(rows: list[dict[str, Any]], bus: str, width: int) -> dict[str, Counter[int]]:
    """Count JSON lines slice by slice."""
    rows = [row for row in rows if row.get("bus") == bus]
    ends = {row["offset"]: row["t_ns"] for row in rows if row["type"] == "frame"}
    out: dict[str, Counter[int]] = {name: Counter() for name in COUNTED}

    def count(name: str, t_ns: int, n: int = 1) -> None:
        out[name][t_ns // width * width] += n

    for row in rows:
        kind = row["type"]
        if kind in ("frame", "gap"):
            count("bytes", row["t_ns"], row["length"])
        if kind == "frame":
            count("frames", row["t_ns"])
        if kind == "frame" and row["kind"] == "request":
            count("requests", row["t_ns"])
        if kind == "transaction" and row["outcome"] == "no_response":
            count("missing", ends[row["request_offset"]])
        if kind == "anomaly" and row["severity"] != "note":
            count({"error": "errors", "warn": "warnings"}[row["severity"]], row["t_ns"])
    return out


def replies_by_hand(rows: list[dict[str, Any]], bus: str, width: int) -> dict[int, list[Interval]]:
    """Return the bounds of response times slice by slice, by when the answer ended."""
    rows = [row for row in rows if row.get("bus") == bus]
    ends = {row["offset"]: row["t_ns"] for row in rows if row["type"] == "frame"}
    out: dict[int, list[Interval]] = {}
    for row in rows:
        if row["type"] == "transaction" and row["outcome"] == "ok":
            took, spread = row["response_time_ns"], row["uncertainty_ns"]
            at = ends[row["response_offset"]] // width * width
            out.setdefault(at, []).append((max(took - spread, 0), took + spread))
    return out


def in_slices(bus: Mapping[str, Any]) -> dict[str, dict[int, int]]:
    """Return what JSON says of slices, by when each begins; those with nothing left out."""
    told = bus["slices"]
    return {
        name: {told["first_ns"] + k * told["slice_ns"]: n for k, n in enumerate(counts) if n}
        for name, counts in told.items()
        if isinstance(counts, list)
    }


@each_in_turn(3, ("every", "width"), [("1s", NS), ("100ms", NS // 10), ("1min", 60 * NS)])
def test_slices_have_what_a_slow_count_of_the_rows_has(
    every: str, width: int, tmp_path: Path, capsys: Capsys
) -> None:
    path = two_buses(tmp_path / "two.log", DAMAGED)
    rows = records(within(capsys, "decode", path, "--format", "jsonl").out)
    told = json.loads(within(capsys, "stats", path, "--every", every, "--format", "json").out)
    hold_to("stats", told)
    for bus in told["buses"]:
        assert in_slices(bus) == by_hand(rows, bus["bus"], width)
        shares = [n * 10 / 57600 / (width / NS) for n in bus["slices"]["bytes"]]
        assert bus["load"]["shares"] == pytest.approx(shares, abs=1e-6)
        most = max(bus["slices"]["bytes"]) * 10 / 57600 / (width / NS)
        assert bus["load"]["peak"] == pytest.approx(max(bus["load"]["mean"], most), abs=1e-6)
        assert (bus["load"]["slice_ns"], bus["load"]["first_ns"] % width) == (width, 0)
    table = within(capsys, "stats", path, "--every", every, "--format", "csv").out
    found = {
        (row["bus"], row["figure"], int(row["t_ns"])): int(row["value"])
        for row in csv.DictReader(io.StringIO(table))
        if row["about"] == "slice" and row["value"] not in ("", "0")
        if row["figure"] in COUNTED
    }
    assert found == {
        (bus["bus"], figure, t_ns): n
        for bus in told["buses"]
        for figure, counts in in_slices(bus).items()
        for t_ns, n in counts.items()
    }


def test_of_a_short_part_the_load_is_at_most_no_less_than_over_all(capsys: Capsys) -> None:
    part = ("stats", DAMAGED, "--from", "1", "--to", "1.03", "--format", "json")
    for every in ((), ("--every", "1s")):
        (bus,) = json.loads(within(capsys, *part, *every).out)["buses"]
        assert bus["load"]["mean"] > 0.3
        assert bus["load"]["peak"] >= bus["load"]["mean"]


def test_of_a_selection_in_slices_what_is_selected_is_counted(capsys: Capsys) -> None:
    asked = ("--servo", "3", "--kind", "request")
    rows = records(within(capsys, "decode", DAMAGED, *asked, "--format", "jsonl").out)
    said = within(capsys, "stats", DAMAGED, *asked, "--every", "1s", "--format", "json").out
    (bus,) = json.loads(said)["buses"]
    assert len(bus["slices"]["frames"]) == 9, "over all the time that was heard"
    assert in_slices(bus)["requests"] == by_hand(rows, "bus0", NS)["requests"]


@in_turn(3)
@pytest.mark.parametrize(("every", "width"), [("1s", NS), ("100ms", NS // 10)])
@pytest.mark.parametrize("asked", [(), ("--servo", "3"), ("--op", "load_data")])
def test_response_times_of_a_slice_lie_within_what_a_sort_of_them_tells(
    asked: tuple[str, ...], every: str, width: int, tmp_path: Path, capsys: Capsys
) -> None:
    path = two_buses(tmp_path / "two.log", DAMAGED)
    rows = records(within(capsys, "decode", path, *asked, "--format", "jsonl").out)
    frames = records(within(capsys, "decode", path, "--format", "jsonl").out)
    rows = [row for row in rows if row["type"] == "transaction"]
    rows += [row for row in frames if row["type"] == "frame"]
    argv: tuple[str | Path, ...] = ("stats", path, *asked, "--every", every)
    told = json.loads(within(capsys, *argv, "--format", "json").out)
    hold_to("stats", told)
    table = [*csv.DictReader(io.StringIO(within(capsys, *argv, "--format", "csv").out))]
    for bus in told["buses"]:
        slices = bus["slices"]
        replies, first = slices["response_time_ns"], slices["first_ns"]
        known = replies_by_hand(rows, bus["bus"], width)
        assert sum(replies["count"]) == sum(map(len, known.values())) > 0
        for k, n in enumerate(replies["count"]):
            mine = known.get(first + k * width, [])
            assert n == len(mine)
            for name, share in QUANTILES.items():
                one = replies[name][k]
                if not mine:
                    assert one is None
                    continue
                for side, bound in enumerate(one):
                    true = sorted(m[side] for m in mine)[math.ceil(share * n) - 1]
                    assert name != "max" or bound == true, "of the longest there is no bin"
                    assert bound == pytest.approx(true, rel=0.023), "a bin is 2 % wide"
                    assert (bound <= true) if side == 0 else (bound >= true)
        shown = [
            r for r in table if (r["bus"], r["figure"]) == (bus["bus"], "response_time_ns.max")
        ]
        of_slices = [[int(r["low"]), int(r["high"])] for r in shown if r["about"] == "slice"]
        assert of_slices == [one for one in replies["max"] if one]


@pytest.mark.parametrize("columns", [80, 140])
def test_the_text_has_a_line_for_each_slice_within_the_terminal(
    columns: int, capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    lines = within(capsys, "stats", DAMAGED, "--every", "2s").out.splitlines()
    assert max(map(len, lines)) <= columns
    begin = next(n for n, line in enumerate(lines) if line.startswith(" over time"))
    words = [line.split() for line in lines[begin + 2 : begin + 7]]
    assert [w[0] for w in words] == [f"22:55:{s:02}" for s in (6, 8, 10, 12, 14)]
    said = ["4713", "367"] if columns == 140 else []  # there is no room for what load tells as well
    row = ["40.9", "%", *said, "209", "1", "5", "13", "<1.00", "<1.27"]
    assert words[0][1 : 1 + len(row)] == row
    assert ("16.91" in words[0]) == (columns == 140)
    assert lines[begin + 7] == ""


def test_a_width_that_cannot_be_is_told_in_a_line(capsys: Capsys) -> None:
    for width in ("5ms", "0", "often"):
        ran = within(capsys, "stats", DAMAGED, "--every", width)
        assert (ran.status, ran.out) == (2, "")
        assert ran.err.endswith(f"{width!r}: write a time of 10 ms or more, such as 1s or 100ms\n")
    with pytest.raises(SnifferError, match="less than 10 ms"):
        sniffer.stats(DAMAGED, every_ns=5_000_000)


def test_too_many_slices_are_refused_and_none_without_a_clock(
    tmp_path: Path, capsys: Capsys
) -> None:
    lines = DAMAGED.read_text().splitlines()[:40]
    later = [line.replace("(1795215306", "(1805215306") for line in lines]
    path = tmp_path / "years.log"
    path.write_text("\n".join([*lines, *later]))
    ran = within(capsys, "stats", path, "--every", "1s")
    assert (ran.status, ran.out) == (2, "")
    assert "are 10000001 slices of time: choose longer ones" in ran.err.splitlines()[-1]
    silent = DAMAGED.with_name("mightyzap_manual.hex")
    ran = within(capsys, "stats", silent, "--every", "1s", "--format", "json")
    assert "slices" not in json.loads(ran.out)["buses"][0]


def test_figures_of_one_bus_tell_nothing_of_another(tmp_path: Path, capsys: Capsys) -> None:
    path = tmp_path / "two.log"
    lines = [f"({n / 100:.6f}) {bus} #FFFFFF{n % 2 + 1:02X}02F1{0xB - n % 2:02X}\n"
             for n in range(40) for bus in ("arm", "leg")]  # fmt: skip
    path.write_text("".join(lines))
    how = ("--protocol", "mightyzap", "--baud", "57600")
    both = within(capsys, "stats", path, *how).out
    assert [line for line in both.splitlines() if " at 57600 baud" in line] == [
        "arm: mightyzap at 57600 baud",
        "leg: mightyzap at 57600 baud",
    ]
    one = within(capsys, "stats", path, *how, "--bus", "leg", "--every", "1s").out
    assert "leg: mightyzap" in one
    assert "arm" not in one
    none = within(capsys, "stats", path, *how, "--servo", "9").out
    assert "arm: mightyzap" in none


def test_anomalies_over_time_tell_of_no_bytes_and_no_load(capsys: Capsys) -> None:
    said = within(capsys, "stats", DAMAGED, "--code", "no-response", "--every", "2s").out
    lines = said.splitlines()
    at = lines.index(" over time")
    assert [line.split() for line in lines[at + 1 : at + 7]] == [
        ["from", "errors", "warnings"],
        ["22:55:06", "1", "0"],
        ["22:55:08", "5", "0"],
        ["22:55:10", "1", "0"],
        ["22:55:12", "2", "0"],
        ["22:55:14", "0", "0"],
    ]


@pytest.mark.parametrize(
    ("every", "told"),
    [("1s", "last slice heard in part"), ("1min", "first and last slice heard in part")],
)
def test_slices_that_were_heard_in_part_are_told_beside_their_loads(
    every: str, told: str, capsys: Capsys
) -> None:
    said = within(capsys, "stats", DAMAGED, "--every", every).out
    assert f" over time (response times in ms; {told})" in said.splitlines()
