"""What an engineer asks of a capture, each answered by one command and by counting its rows."""

from __future__ import annotations

import io
import json
import sys
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import pytest

from tests.commands import within
from tests.golden import CAPTURES

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

Capsys = pytest.CaptureFixture[str]
Rows = list[dict[str, Any]]

WCK: Final = CAPTURES / "wck_damaged.log"
LSS: Final = CAPTURES / "lss_damaged.log"


def rows_of(capsys: Capsys, *options: str) -> Rows:
    ran = within(capsys, "decode", *options, "--format", "jsonl")
    assert ran.status == 0, ran.err
    return [json.loads(line) for line in ran.out.splitlines()]


def longest_period_ns(rows: Rows) -> float:
    asked: list[int] = [
        r["t_ns"]
        for r in rows
        if (r["type"], r.get("kind")) == ("frame", "request")
        and (r["servo_id"], r["op"]) == (0, "status_read")
    ]
    return max(b - a for a, b in pairwise(asked))


def longest_reply_ns(rows: Rows) -> float:
    took: list[int] = [
        r["response_time_ns"]
        for r in rows
        if (r["type"], r.get("servo_id"), r.get("op")) == ("transaction", 0, "status_read")
        and r["response_time_ns"] is not None
    ]
    return max(took)


@pytest.mark.parametrize(
    ("figure", "longest"),
    [("period_ns", longest_period_ns), ("response_time_ns", longest_reply_ns)],
)
def test_the_longest_that_stats_tells_is_the_longest_of_the_rows(
    figure: str, longest: Callable[[Rows], float], capsys: Capsys
) -> None:
    told = json.loads(within(capsys, "stats", WCK, "--format", "json").out)
    (mine,) = (
        c for c in told["buses"][0]["commands"] if (c["servo_id"], c["op"]) == (0, "status_read")
    )
    low, high = mine[figure]["max"]
    true = longest(rows_of(capsys, str(WCK)))
    assert low <= true <= high
    assert (low + high) / 2 == pytest.approx(true, abs=1), "no bin is between them"


@pytest.mark.parametrize("asked", [(), ("--why", "1")])
def test_a_sentence_of_the_diagnosis_is_one_line_in_a_pipe(
    asked: tuple[str, ...], capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    told = json.loads(within(capsys, "diagnose", LSS, "--format", "json").out)
    lines = within(capsys, "diagnose", LSS, *asked).out.splitlines()
    first = told["incidents"][0]
    assert any(line.endswith(first["story"]) for line in lines)
    if not asked:
        assert f"   {first['against']}" in lines
    monkeypatch.setenv("COLUMNS", "80")
    assert max(map(len, within(capsys, "diagnose", LSS).out.splitlines())) <= 80


def test_what_nothing_explains_is_not_judged_from_standard_input_and_that_is_said(
    capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    noise = bytes(i * i * 7 % 251 for i in range(600))
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(noise)))
    ran = within(capsys, "diagnose", "-", "--input-format", "bin")
    assert ran.status == 2
    assert ran.err.endswith("standard input has one: diagnose a file of them\n")


def test_a_temperature_has_one_unit_wherever_people_read_it(
    capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    capture = CAPTURES / "mightyzap_damaged.log"
    stated = next(
        r
        for r in rows_of(capsys, str(capture), "--servo", "2")
        if r["type"] == "sample" and r["register"] == "present_temperature"
    )
    asked: tuple[tuple[str, ...], ...] = (
        ("explain", f"{capture}@{stated['offset']}"),
        ("decode", str(capture)),
        ("stats", str(capture), "--alarm", "temperature > 20"),
        ("registers", "mightyzap-l12"),
        ("diagnose", str(capture)),
        ("report", str(capture)),
    )
    for command in asked:
        told = within(capsys, *command)
        assert "degC" not in told.out, command
        assert "°C" in told.out or command[0] in ("diagnose", "report"), command


def test_a_value_that_is_called_like_its_register_is_said_once(
    capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    told = within(capsys, "decode", CAPTURES / "mightyzap_damaged.log").out
    lines = [line for line in told.splitlines() if "moving" in line]
    assert any(", moving" in line for line in lines)
    assert not any("moving moving" in line for line in lines)


@pytest.mark.parametrize(
    "asked",
    [
        ("diff", "WCK", "NOISE"),
        ("diff", "NOISE", "WCK"),
        ("cut", "NOISE", "--from", "@byte:3", "--to", "@byte:100", "-o", "OUT"),
        ("cut", "NOISE", "--from", "0", "--to", "10", "-o", "OUT"),
        ("stats", "WCK", "NOISE"),
        ("query", "SELECT count(*) FROM frames", "WCK", "NOISE"),
        ("discover", "NOISE"),
    ],
)
def test_a_file_whose_protocol_cannot_be_told_is_named(
    asked: tuple[str, ...], tmp_path: Path, capsys: Capsys
) -> None:
    noise = tmp_path / "noise.bin"
    noise.write_bytes(bytes(i * i * 7 % 251 for i in range(600)))
    stands = {"WCK": WCK, "NOISE": noise, "OUT": tmp_path / "out.bin"}
    ran = within(capsys, *(stands.get(word, word) for word in asked))
    assert ran.status == 2
    assert ran.complaint.startswith(f"{noise}: cannot tell the protocol of these 600 bytes")
    assert "--protocol" in ran.complaint
    assert not stands["OUT"].exists()


@pytest.mark.parametrize(
    "asked",
    [
        ("convert", "NOISE", "OUT"),
        ("report", "NOISE"),
        ("replay", "NOISE", "--speed", "0"),
        ("check", "NOISE", "--rules", "RULES"),
        ("view", "NOISE", "-o", "PLOTS"),
        ("explain", "NOISE@5"),
        ("simulate", "--like", "NOISE"),
        ("replay", "NOISE", "--to", "/dev/null", "--as", "controller"),
    ],
)
def test_bytes_whose_protocol_cannot_be_told_are_those_of_a_file(
    asked: tuple[str, ...], tmp_path: Path, capsys: Capsys
) -> None:
    noise, rules = tmp_path / "noise.bin", tmp_path / "rules.toml"
    noise.write_bytes(bytes(i * i * 7 % 251 for i in range(600)))
    rules.write_text('[[rule]]\nwhat = "frames"\nat_least = 1\n')
    out = tmp_path / "out.jsonl"
    stands = {"NOISE": noise, "OUT": out, "RULES": rules, "PLOTS": tmp_path / "out.rrd"}
    stands["NOISE@5"] = noise.with_name(f"{noise.name}@5")
    ran = within(capsys, *(stands.get(word, word) for word in asked))
    assert ran.status == 2
    assert ran.complaint.startswith(f"cannot tell the protocol of these 600 bytes of {noise} (")
