"""Questions for a part of a capture: who, what, when, where."""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from typing import TYPE_CHECKING, Any

import pandas as pd
import pytest

from tests.questions.asking import frames

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.questions.asking import Asker, Capture

NS = 1_000_000_000


def test_only_one_servos_writes(capture: Capture, asker: Asker) -> None:
    who, op = capture.servo, capture.write
    told = asker.rows(
        "decode", capture.path, "--servo", str(who), "--op", op, "--kind", "request",
        "--format", "jsonl", led_by="only these servos commands request",
    )  # fmt: skip
    mine = frames(capture.of("frame", servo_id=who, op=op, kind="request"))
    assert frames(told) == mine != []
    assert told[-1]["type"] == "summary"


def test_what_a_servo_was_told_also_in_commands_to_several(capture: Capture, asker: Asker) -> None:
    told = asker.rows(
        "decode", capture.path, "--servo", str(capture.servo), "--where", "role = 'commanded'",
        "--format", "jsonl",
    )  # fmt: skip
    mine = capture.of("sample", servo_id=capture.servo, role="commanded")
    assert [r for r in told if r["type"] == "sample"] == mine != []


def test_200_ms_around_the_first_error(capture: Capture, asker: Asker) -> None:
    at = capture.first_error["t_ns"]
    told = asker.rows(
        "decode", capture.path, "--from", "@first-error", "--around", "200ms", "--format", "jsonl",
        led_by="@first-error 200ms widen",
    )  # fmt: skip
    near = [r for r in capture.of("frame") if abs(r["t_ns"] - at) <= NS // 5]
    assert frames(told) == frames(near) != []
    assert capture.first_error["code"] in {r["code"] for r in told if r["type"] == "anomaly"}


def test_what_stands_at_a_byte(capture: Capture, asker: Asker) -> None:
    every = capture.of("frame")
    for row in every[len(every) // 3 :: len(every) // 3]:
        inside = row["offset"] + row["length"] // 2
        told = asker.ask("explain", f"{capture.path}@{inside}", led_by="FILE@12175 byte").out
        drawn = "".join(re.findall(r"\b[0-9A-Fa-f]{2}\b", told)).lower()
        assert row["hex"] in drawn, told
        (same,) = frames(
            asker.rows(
                "decode",
                capture.path,
                "--from",
                f"@byte:{inside}",
                "--to",
                f"@byte:{inside}",
                "--format",
                "jsonl",
                led_by="@byte:12175",
            )
        )
        assert same == (row["offset"], row["hex"])


def test_all_checksum_errors_with_their_bytes(capture: Capture, asker: Asker) -> None:
    bad = capture.of("anomaly", code="bad-checksum")
    if not bad:
        pytest.skip("nothing was altered there")
    told = asker.rows("decode", capture.path, "--code", "bad-checksum", "--format", "jsonl")
    assert [r for r in told if r["type"] == "anomaly"] == bad
    table = asker.ask("decode", capture.path, "--code", "bad-checksum").out.splitlines()
    lines = [line for line in table if " ! bad-checksum " in line]
    spans = [r["evidence"][0] for r in bad]
    data = bytes.fromhex("".join(r["hex"] for r in capture.in_order))
    for line, (at, length) in zip(lines, spans, strict=True):
        mine = data[at : at + length].hex(" ").upper()
        assert re.search(rf" {mine} +error$", line), line


def test_which_bytes_belong_to_no_frame(capture: Capture, asker: Asker) -> None:
    told = asker.rows("decode", capture.path, "--where", "reason IS NOT NULL", "--format", "jsonl")
    mine = [(r["offset"], r["hex"], r["reason"]) for r in capture.of("gap")]
    assert [(r["offset"], r["hex"], r["reason"]) for r in told if r["type"] == "gap"] == mine
    held = bytearray(b"\1" * capture.rows[-1]["bytes"])
    for r in capture.of("frame"):
        held[r["offset"] : r["offset"] + r["length"]] = bytes(r["length"])
    assert sum(held) == sum(len(text) // 2 for _, text, _ in mine), "counted byte by byte"


def test_how_many_frames_of_a_kind(capture: Capture, asker: Asker) -> None:
    told = asker.rows(
        "query", "SELECT kind, op, count(*) AS n FROM frames GROUP BY ALL", capture.path,
        "--format", "json", led_by="frames GROUP",
    )  # fmt: skip
    mine = Counter((r["kind"], r["op"]) for r in capture.of("frame"))
    assert {(r["kind"], r["op"]): r["n"] for r in told} == dict(mine)


def test_which_registers_were_written_and_when(capture: Capture, asker: Asker) -> None:
    told = asker.rows(
        "decode", capture.path, "--kind", "request", "--where", "register IS NOT NULL",
        "--format", "jsonl",
    )  # fmt: skip
    asked = {r["offset"] for r in capture.of("frame", kind="request")}
    mine = [r for r in capture.of("sample") if r["offset"] in asked]
    assert [r for r in told if r["type"] == "sample"] == mine != []


def test_the_last_goal_before_the_first_error(capture: Capture, asker: Asker) -> None:
    at = capture.first_error["t_ns"]
    goals = [r for r in capture.of("sample", quantity="goal_position") if r["t_ns"] <= at]
    told = asker.rows(
        "query", "SELECT servo_id, max_by(value, t_ns) AS goal FROM samples "
        "WHERE quantity = 'goal_position' GROUP BY servo_id", capture.path,
        "--to", "@first-error", "--format", "json", led_by="@first-error samples",
    )  # fmt: skip
    last = {r["servo_id"]: r["value"] for r in goals}
    assert {r["servo_id"]: r["goal"] for r in told} == pytest.approx(last)


def test_the_first_frame_after_each_gap(capture: Capture, asker: Asker) -> None:
    told = asker.rows(
        "query", "SELECT g.offset AS gap, min(f.offset) AS next FROM gaps g JOIN frames f "
        "ON f.offset > g.offset GROUP BY g.offset ORDER BY g.offset", capture.path,
        "--format", "json", led_by="gaps",
    )  # fmt: skip
    begins = sorted(r["offset"] for r in capture.of("frame"))
    mine = [
        (r["offset"], next(b for b in begins if b > r["offset"]))
        for r in capture.of("gap")
        if begins[-1] > r["offset"]
    ]
    assert [(r["gap"], r["next"]) for r in told] == mine != []


def test_one_register_over_time_as_a_table(capture: Capture, asker: Asker) -> None:
    values = capture.of("sample", quantity="position", servo_id=capture.servo)
    register = values[0]["register"]
    values = [r for r in values if r["register"] == register]
    out = asker.folder / "values.csv"
    ran = asker.ask(
        "convert", capture.path, out, "--servo", str(capture.servo),
        "--where", f"register = '{register}'", led_by="csv",
    )  # fmt: skip
    assert ran.status == 0, ran.err
    table = pd.read_csv(out)
    assert table["value"].tolist() == pytest.approx([r["value"] for r in values])
    assert table["t_ns"].tolist() == [r["t_ns"] for r in values]


@pytest.mark.parametrize("which", ["servo", "op", "kind", "where"])
def test_one_selection_counts_alike_everywhere(which: str, capture: Capture, asker: Asker) -> None:
    asked = {
        "servo": ("--servo", str(capture.servo)),
        "op": ("--op", capture.poll),
        "kind": ("--kind", "response"),
        "where": ("--where", f"length > 5 AND servo_id <> {capture.servo}"),
    }[which]
    tests: dict[str, Callable[[dict[str, Any]], bool]] = {
        "servo": lambda r: r["servo_id"] == capture.servo,
        "op": lambda r: r["op"] == capture.poll,
        "kind": lambda r: r["kind"] == "response",
        "where": lambda r: r["length"] > 5 and r["servo_id"] not in (None, capture.servo),
    }
    fits = tests[which]
    n = sum(map(fits, capture.of("frame")))
    path = capture.path
    assert len(frames(asker.rows("decode", path, *asked, "--format", "jsonl"))) == n
    out = asker.folder / "part.jsonl"
    assert asker.ask("convert", path, out, *asked).status == 0
    assert out.read_text().count('"type": "frame"') + out.read_text().count('"type":"frame"') == n
    sql = "SELECT count(*) AS n FROM frames"
    assert asker.rows("query", sql, path, *asked, "--format", "json") == [{"n": n}]
    told_of = {r["offset"] for r in capture.of("sample", servo_id=capture.servo)}
    those = {r["offset"] for r in capture.of("frame") if fits(r)}
    if which == "servo":  # stats counts the frames, too, that tell several servos their goals
        those |= told_of
    assert asker.bus(path, *asked)["frames"] == len(those)


def test_cut_out_some_seconds(capture: Capture, asker: Asker) -> None:
    out = asker.folder / "part.log"
    ran = asker.ask("cut", capture.path, "--from", "1", "--to", "3", "-o", out, led_by="part")
    assert ran.status == 0, ran.err
    first = min(r["t_ns"] for r in capture.rows if r["type"] in ("frame", "gap"))
    inside = [
        r["hex"]
        for r in capture.of("frame")
        if first + NS < r["t_start_ns"] and r["t_ns"] < first + 3 * NS
    ]
    part = [hexes for _, hexes in frames(asker.rows("decode", out, "--format", "jsonl"))]
    begin = part.index(inside[0])
    assert part[begin : begin + len(inside)] == inside
    assert len(part) < len(inside) + 40, "a little outside of it, and no more"


def test_as_candump(capture: Capture, asker: Asker) -> None:
    out = asker.folder / "as.log"
    assert asker.ask("convert", capture.path, out, led_by=".log").status == 0
    line = re.compile(r"\((\d+\.\d+)\) bus0 #([0-9A-F]+)(?: .*)?")
    matches = [line.fullmatch(text) for text in out.read_text().splitlines()]
    data = "".join(found[2] for found in matches if found).lower()
    assert all(matches)
    assert data == "".join(r["hex"] for r in capture.in_order)


def test_as_a_wide_table(capture: Capture, asker: Asker) -> None:
    out = asker.folder / "wide.csv"
    assert (
        asker.ask("convert", capture.path, out, "--wide", led_by="quantity of a servo").status == 0
    )
    (head, *lines) = csv.reader(io.StringIO(out.read_text()))
    values = capture.of("sample", quantity="position", servo_id=capture.servo)
    (column,) = [
        i for i, name in enumerate(head)
        if re.search(rf"\b{capture.servo}\b", name.replace("_", " ").replace("/", " "))
        and "position" in name and "goal" not in name
    ]  # fmt: skip
    told = [float(line[column]) for line in lines if line[column]]
    assert told == pytest.approx([r["value"] for r in values], abs=1e-6)
