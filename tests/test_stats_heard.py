"""When each servo was heard, as ``sniffer stats`` tells it, and what it tells of a selection."""

from __future__ import annotations

import csv
import io
import itertools
import json
from typing import TYPE_CHECKING

import pytest

import sniffer
from sniffer.decoding.rows import FrameRow
from tests.commands import within
from tests.golden import CAPTURES
from tests.test_stats import MS, counted, exchange

if TYPE_CHECKING:
    from collections.abc import Callable

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
