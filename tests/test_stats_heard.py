"""When each servo was heard, as ``sniffer stats`` tells it, and what it tells of a selection."""

from __future__ import annotations

import csv
import io
import itertools
import json
import re
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sniffer
from sniffer.decoding.rows import FrameRow, GapRow
from tests.commands import within
from tests.golden import CAPTURES
from tests.lists import each_in_turn
from tests.test_stats import MS, counted, exchange

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

CAPTURE = CAPTURES / "mightyzap_damaged.log"


def test_a_servo_was_heard_first_and_last_when_its_frames_say(
    capsys: pytest.CaptureFixture[str],
) -> None:
    answers: dict[int | None, list[FrameRow]] = {}
    for row in sniffer.decode(CAPTURE):
        if isinstance(row, FrameRow) and row.kind == "response":
            answers.setdefault(row.servo_id, []).append(row)
    (bus,) = json.loads(within(capsys, "stats", CAPTURE, "--format", "json").out)["buses"]
    assert {s["servo_id"]: s["responses"] for s in bus["servos"]} == {
        servo: len(rows) for servo, rows in answers.items()
    }
    table = csv.DictReader(io.StringIO(within(capsys, "stats", CAPTURE, "--format", "csv").out))
    flat = {(r["servo_id"], r["figure"]): r for r in table if r["about"] == "servo"}
    for s in bus["servos"]:
        rows = answers[s["servo_id"]]
        for name, row in (("first_answer", rows[0]), ("last_answer", rows[-1])):
            assert s[name] == {"t_ns": row.t_ns, "offset": row.offset}
            told = flat[str(s["servo_id"]), name]
            assert (told["t_ns"], told["offset"]) == (str(row.t_ns), str(row.offset))
        low, high = s["longest_pause"]["value_ns"]
        longest = max(b.t_ns - a.t_ns for a, b in itertools.pairwise(rows))
        assert low <= longest <= high


@each_in_turn(3, "capture", ["mightyzap_damaged.log", "lss_damaged.log", "wck_clean.log"])
def test_the_longest_silence_of_a_bus_is_between_two_things_that_were_heard(
    capture: str, capsys: pytest.CaptureFixture[str]
) -> None:
    heard = [
        row for row in sniffer.decode(CAPTURES / capture) if isinstance(row, FrameRow | GapRow)
    ]
    heard.sort(key=lambda row: row.offset)
    (bus,) = json.loads(within(capsys, "stats", CAPTURES / capture, "--format", "json").out)[
        "buses"
    ]
    silence, ns = bus["longest_silence"], 10 * 10**9 // bus["baud"]
    apart = [(b.t_ns - len(b.hex) // 2 * ns - a.t_ns, a) for a, b in itertools.pairwise(heard)]
    longest, before = max(apart, key=lambda each: each[0])
    assert (silence["t_ns"], silence["offset"]) == (before.t_ns, before.offset)
    low, high = silence["value_ns"]
    assert low - MS // 10 <= longest <= high + MS // 10
    shown = within(capsys, "stats", CAPTURES / capture).out
    since = (before.t_ns - bus["first_ns"]) / 1e9
    assert re.search(rf" s, silent for \S+ ms at most, from second {since:.3f} on\n", shown)


def test_the_longest_silence_is_told_in_seconds_of_the_capture_that_from_takes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of the bus that was heard later they were its own."""
    one = (CAPTURES / "mightyzap_damaged.log").read_text("ascii").splitlines()
    later = [
        re.sub(r"\((\d+)(\S+) bus0", lambda t: f"({int(t[1]) + 20}{t[2]} leg", line) for line in one
    ]
    path = tmp_path / "two.log"
    path.write_text("\n".join([*one, *later]) + "\n", "ascii")
    shown = within(capsys, "stats", path).out
    arm, leg = re.findall(r"at most, from second (\S+) on\n", shown)
    assert float(leg) == pytest.approx(float(arm) + 20, abs=0.002)


@given(cuts=st.lists(st.integers(1, 10**6), max_size=6))
@settings(max_examples=15)
def test_the_longest_silence_is_the_same_however_the_stream_is_cut(cuts: list[int]) -> None:
    chunks = [c for k, t in enumerate((0, 40, 300, 320, 900)) for c in exchange(t, k)]
    (bus,) = counted("mightyzap", chunks, cuts, 57600)["buses"]
    (whole,) = counted("mightyzap", chunks, baud=57600)["buses"]
    assert bus["longest_silence"] == whole["longest_silence"]
    low, high = whole["longest_silence"]["value_ns"]
    assert low <= 580 * MS
    assert high >= 565 * MS


@pytest.mark.parametrize(
    ("capture", "protocol"),
    [("lss_clean.bin", "lss"), ("mightyzap_damaged.log", "mightyzap+rs30x")],
)
def test_no_silence_is_told_without_a_clock_or_of_a_bus_that_two_protocols_share(
    capture: str, protocol: str
) -> None:
    told = sniffer.stats(CAPTURES / capture, sniffer.Options(protocol=protocol)).as_dict()
    assert [bus["longest_silence"] for bus in told["buses"]] == [None]


def test_a_servo_that_never_answered_was_never_heard() -> None:
    asked, answer = exchange(0)
    chunks = [asked, answer, *exchange(40), exchange(80, servo=2)[0], *exchange(120)]
    one, two = counted("mightyzap", chunks, baud=57600)["buses"][0]["servos"]
    assert one["longest_pause"]["value_ns"] == [pytest.approx(80 * MS, rel=1e-3)] * 2
    assert [two[k] for k in ("first_answer", "last_answer", "longest_pause")] == [None] * 3


@pytest.fixture
def shown(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Callable[[str], str]:
    def show(where: str) -> str:
        monkeypatch.setenv("COLUMNS", "80")
        return within(capsys, "stats", CAPTURE, "--where", where, "--quiet").out

    return show


def test_a_selection_of_values_counts_the_answers_that_state_them(
    shown: Callable[[str], str],
) -> None:
    text = shown("quantity = 'voltage' AND servo_id = 3")
    lines = text.splitlines()
    head = next(line for line in lines if line.split()[:2] == ["servo", "command"])
    row = lines[lines.index(head) + 1].split()
    assert head.split()[2] == "answers"
    assert int(row[2]) > 100
    assert "when each servo said what is selected" in text


def test_where_nothing_is_selected_that_is_said(shown: Callable[[str], str]) -> None:
    text = shown("quantity = 'voltage' AND value < 1")
    assert "nothing that it said is selected" in text
    assert "traffic" not in text
