"""Questions for a stretch of time: all commands that read take the same one."""

from __future__ import annotations

import datetime
import json
import re
from itertools import pairwise
from typing import TYPE_CHECKING

import pytest

from tests.questions.asking import frames

if TYPE_CHECKING:
    from tests.questions.asking import Asker, Capture

NS = 1_000_000_000


def clock(t_ns: int) -> str:
    moment = datetime.datetime.fromtimestamp(t_ns // NS, datetime.UTC)
    return f"{moment:%H:%M:%S}.{t_ns % NS:09d}"


@pytest.mark.parametrize("said", ["seconds", "clock", "iso", "minutes", "before the end"])
def test_a_stretch_is_the_same_for_every_command(said: str, capture: Capture, asker: Asker) -> None:
    first = min(r["t_ns"] for r in capture.in_order)
    last = max(r["t_ns"] for r in capture.in_order if r["type"] in ("frame", "gap"))
    is_before = said == "before the end"
    begin, end = (
        (last - 2 * NS, last - NS // 2) if is_before else (first + 3 * NS // 2, first + 3 * NS)
    )
    day = datetime.datetime.fromtimestamp(first // NS, datetime.UTC).date()
    ends = {
        "seconds": ("1.5", "3"),
        "clock": (clock(begin), clock(end)),
        "iso": (f"{day}T{clock(begin)}Z", f"{day}T{clock(end)}Z"),
        "minutes": ("0.025min", "0.05min"),
        "before the end": ("-2s", "-500ms"),
    }[said]
    asked = ("--from", ends[0], "--to", ends[1])
    inside = [r for r in capture.of("frame") if begin <= r["t_ns"] <= end]
    told = asker.rows("decode", capture.path, *asked, "--format", "jsonl", led_by="seconds ISO")
    assert frames(told) == frames(inside) != []
    assert told[-1]["frames"] == len(inside)
    assert asker.bus(capture.path, *asked)["frames"] == len(inside)
    sql = "SELECT count(*) AS n FROM frames"
    assert asker.rows("query", sql, capture.path, *asked, "--format", "json") == [
        {"n": len(inside)}
    ]
    out = asker.folder / "part.jsonl"
    assert asker.ask("convert", capture.path, out, *asked).status == 0
    assert frames([json.loads(line) for line in out.read_text().splitlines()]) == frames(inside)
    refused = asker.ask("convert", capture.path, asker.folder / "part.log", *asked)
    assert (refused.status, "`sniffer cut`" in refused.complaint) == (2, True)


def test_nothing_is_wrong_at_the_edges_of_a_stretch(capture: Capture, asker: Asker) -> None:
    whole = {(r["code"], r["t_ns"], r["servo_id"]) for r in capture.of("anomaly")}
    for begin in ("1.013", "2.377", "3.141"):
        told = asker.rows(
            "decode", capture.path, "--from", begin, "--to", str(float(begin) + 0.5),
            "--format", "jsonl",
        )  # fmt: skip
        found = {(r["code"], r["t_ns"], r["servo_id"]) for r in told if r["type"] == "anomaly"}
        assert found <= whole


def test_the_third_answer_that_did_not_come(capture: Capture, asker: Asker) -> None:
    lost = capture.of("anomaly", code="no-response")
    if len(lost) < 3:
        pytest.skip("fewer were lost")
    told = asker.ask("explain", f"{capture.path}@no-response:3", led_by="@no-response:3").out
    drawn = "".join(re.findall(r"\b[0-9A-Fa-f]{2}\b", told)).lower()
    at = lost[2]["evidence"][0][0]
    (asked,) = capture.of("frame", offset=at)
    assert asked["hex"] in drawn
    near = asker.rows(
        "decode", capture.path, "--from", "@no-response:3", "--around", "50ms", "--format", "jsonl",
        led_by="@no-response:3 50ms"[:14],
    )  # fmt: skip
    assert lost[2]["t_ns"] in [r["t_ns"] for r in near if r["type"] == "anomaly"]


def test_the_first_error_of_one_servo(capture: Capture, asker: Asker) -> None:
    errors = [r for r in capture.of("anomaly", severity="error") if r["servo_id"] is not None]
    for who in {r["servo_id"] for r in errors} & {r["servo_id"] for r in capture.of("frame")}:
        first = next(r for r in errors if r["servo_id"] == who)
        told = asker.rows(
            "decode", capture.path, "--from", f"@first-error:servo={who}", "--around", "1ms",
            "--format", "jsonl", led_by="@first-error:servo=3",
        )  # fmt: skip
        found = [(r["code"], r["t_ns"]) for r in told if r["type"] == "anomaly"]
        assert (first["code"], first["t_ns"]) in found


def test_how_long_between_one_frame_and_the_next(capture: Capture, asker: Asker) -> None:
    ran = asker.ask(
        "decode", capture.path, "--time", "delta", "--kind", "request", led_by="the line before"
    )
    table = ran.out.split("\n\n")[0].splitlines()[1:]
    told = [float(line.split()[0]) for line in table]
    times = [r["t_ns"] for r in capture.of("frame", kind="request")]
    mine = [0.0] + [(b - a) / NS for a, b in pairwise(times)]
    assert told == pytest.approx(mine, abs=1e-6)
