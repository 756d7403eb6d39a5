"""Questions for what happened: settings written, pauses, servos that are silent, slow answers."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import pytest

from tests.questions.asking import each

if TYPE_CHECKING:
    from tests.questions.asking import Asker, Capture


def test_which_settings_the_controller_wrote(capture: Capture, asker: Asker) -> None:
    told = asker.rows(
        "decode", capture.path, "--kind", "request", "--where", "role = 'config'",
        "--format", "jsonl",
    )  # fmt: skip
    asked = {r["offset"] for r in capture.of("frame", kind="request")}
    mine = [r for r in capture.of("sample", role="config") if r["offset"] in asked]
    assert [r for r in told if r["type"] == "sample"] == mine


def test_the_longest_pause_of_the_controller(capture: Capture, asker: Asker) -> None:
    (told,) = asker.rows(
        "query", 'SELECT t_ns, t_ns - lag(t_ns) OVER (ORDER BY "offset") AS pause FROM frames '
        "WHERE kind = 'request' ORDER BY pause DESC NULLS LAST LIMIT 1", capture.path,
        "--format", "json", led_by="SELECT frames",
    )  # fmt: skip
    times = [r["t_ns"] for r in capture.of("frame", kind="request")]
    assert told["pause"] == max(b - a for a, b in pairwise(times))


def test_which_ids_never_answer(capture: Capture, asker: Asker) -> None:
    told = asker.rows(
        "query", "SELECT servo_id FROM transactions WHERE outcome <> 'not_expected' "
        "GROUP BY 1 HAVING count(*) FILTER (outcome = 'ok') = 0", capture.path,
        "--format", "json", led_by="transactions",
    )  # fmt: skip
    asked = [r for r in capture.of("transaction") if r["outcome"] != "not_expected"]
    answered = {r["servo_id"] for r in asked if r["outcome"] == "ok"}
    assert {r["servo_id"] for r in told} == {r["servo_id"] for r in asked} - answered


def test_which_firmware_each_servo_has(capture: Capture, asker: Asker) -> None:
    told = asker.rows(
        "decode", capture.path, "--where", "register = 'firmware_version'", "--format", "jsonl"
    )
    mine = capture.of("sample", register="firmware_version")
    assert [r for r in told if r["type"] == "sample"] == mine


def test_which_answers_took_longer_than_5_ms(capture: Capture, asker: Asker) -> None:
    told = asker.rows(
        "decode", capture.path, "--where", "response_time_ns > 5000000", "--format", "jsonl"
    )
    mine = [r for r in capture.of("transaction") if (r["response_time_ns"] or 0) > 5_000_000]
    assert [r for r in told if r["type"] == "transaction"] == mine


def test_what_the_servos_complain_of_themselves(capture: Capture, asker: Asker) -> None:
    told = asker.rows(
        "decode", capture.path, "--where", "code LIKE 'device-%'", "--format", "jsonl"
    )
    mine = [r for r in capture.of("anomaly") if r["code"].startswith("device-")]
    assert [r for r in told if r["type"] == "anomaly"] == mine


def test_how_far_each_joint_was_from_its_goal(capture: Capture, asker: Asker) -> None:
    import pandas as pd  # half a second, which each worker would spend to collect this file

    told = asker.rows(
        "query", "SELECT p.servo_id, max(abs(g.value - p.value)) AS error FROM "
        "(FROM samples WHERE quantity = 'position' AND role = 'measured' AND value IS NOT NULL) p "
        "ASOF JOIN (FROM samples WHERE quantity = 'goal_position' AND value IS NOT NULL) g "
        "ON p.servo_id = g.servo_id AND p.t_ns >= g.t_ns GROUP BY 1", capture.path,
        "--format", "json", led_by="samples",
    )  # fmt: skip
    values = pd.DataFrame([r for r in capture.of("sample") if r["value"] is not None])
    by_time = values.sort_values("t_ns", kind="stable")
    joined = pd.merge_asof(
        by_time[(by_time["quantity"] == "position") & (by_time["role"] == "measured")],
        by_time[by_time["quantity"] == "goal_position"],
        on="t_ns", by="servo_id", suffixes=("", "_goal"),
    )  # fmt: skip
    error = (joined["value_goal"] - joined["value"]).abs().groupby(joined["servo_id"]).max()
    mine = {int(who): pytest.approx(value, abs=2e-6) for who, value in error.dropna().items()}
    assert {r["servo_id"]: r["error"] for r in told} == mine


def test_when_each_servo_was_first_and_last_heard(capture: Capture, asker: Asker) -> None:
    told = asker.rows(
        "query", "SELECT servo_id, min(t_ns) AS first, max(t_ns) AS last FROM frames "
        "WHERE kind = 'response' GROUP BY 1", capture.path, "--format", "json", led_by="frames",
    )  # fmt: skip
    mine = {
        who: (min(r["t_ns"] for r in rows), max(r["t_ns"] for r in rows))
        for who, rows in each(capture.of("frame", kind="response"), lambda r: r["servo_id"])
    }
    assert {r["servo_id"]: (r["first"], r["last"]) for r in told} == mine
