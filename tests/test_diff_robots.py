"""Two runs of simulated robots compared: what one robot does and the other does not."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest

from tests.commands import within
from tests.lists import each_in_turn
from tests.schemas import hold_to
from tests.test_cli_diagnose import log

if TYPE_CHECKING:
    from pathlib import Path

Capsys = pytest.CaptureFixture[str]


def compared(capsys: Capsys, *arguments: str | Path) -> tuple[int, list[dict[str, Any]]]:
    ran = within(capsys, "diff", *arguments, "--format", "json")
    found = json.loads(ran.out)
    hold_to("diff", found)
    return ran.status, found["differences"]


@each_in_turn(
    2,
    ("protocol", "fault", "servo", "cause"),
    [
        ("mightyzap", "limp:2@5s", 2, "torque-off"),
        ("rs30x", "limp:5@5s", 5, "torque-off"),
        ("mightyzap", "nv-wear:3", 3, "nv-wear"),
        ("lss", "chatty:2", 2, "chatty-device"),
    ],
)
def test_what_befell_one_run_alone_is_told_with_its_cause(
    protocol: str, fault: str, servo: int, cause: str, tmp_path: Path, capsys: Capsys
) -> None:
    a, b = log(tmp_path / "a.log", protocol), log(tmp_path / "b.log", protocol, fault, seed=8)
    for runs, counts in (((a, b), ("b", "a")), ((b, a), ("a", "b"))):
        status, differ = compared(capsys, *runs)
        assert status == 1
        (one,) = (d for d in differ if d["about"] == "incident")
        assert (one["servo_id"], one["name"], one["test"]) == (servo, cause, "diagnosis")
        assert one["p"] <= 0.5
        assert one[counts[0]]["count"] >= 1
        assert one[counts[1]]["count"] == 0
        assert f", in {counts[0].upper()} alone (" in one["sentence"]


def test_runs_with_the_same_incident_do_not_differ_by_it(tmp_path: Path, capsys: Capsys) -> None:
    a, b = (log(tmp_path / f"{n}.log", "mightyzap", "limp:2@5s", seed=n) for n in (5, 8))
    _, differ = compared(capsys, a, b)
    assert not [d for d in differ if d["about"] == "incident"]


def test_noise_on_the_line_is_left_to_the_tests(tmp_path: Path, capsys: Capsys) -> None:
    a = log(tmp_path / "a.log", "mightyzap", "noise:1%")
    b = log(tmp_path / "b.log", "mightyzap", seed=8)
    _, differ = compared(capsys, a, b)
    assert not [d for d in differ if d["about"] == "incident"]


def test_of_a_selection_no_incidents_are_compared(tmp_path: Path, capsys: Capsys) -> None:
    a = log(tmp_path / "a.log", "mightyzap")
    b = log(tmp_path / "b.log", "mightyzap", "limp:2@5s", seed=8)
    _, differ = compared(capsys, a, b, "--servo", "1")
    assert not [d for d in differ if d["about"] == "incident"]


def test_how_far_joints_are_from_their_goals_is_compared(tmp_path: Path, capsys: Capsys) -> None:
    a = log(tmp_path / "a.log", "mightyzap", seconds=60)
    b = log(tmp_path / "b.log", "mightyzap", "limp:2", seconds=60, seed=8)
    _, differ = compared(capsys, a, b)
    mine = [d for d in differ if d["servo_id"] == 2]
    (one,) = (d for d in mine if d["name"] == "following_error_mm")
    assert (one["about"], one["test"]) == ("value", "Mann-Whitney")
    assert one["b"]["median"] > 3 * one["a"]["median"]
