"""Captures that last over a midnight: times of two days are told apart."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Final

import pytest

from tests.commands import within

if TYPE_CHECKING:
    from tests.test_convert import Capsys

CAPTURE: Final = Path(__file__).parents[1] / "sample_captures" / "mightyzap_damaged.log"


@pytest.fixture
def two_days(tmp_path: Path) -> Path:
    text = CAPTURE.read_text()
    later = re.sub(r"(?m)^\((\d+)", lambda t: f"({int(t[1]) + 86400}", text)
    path = tmp_path / "days.log"
    path.write_text(text.rstrip("\n") + "\n" + later)
    return path


def test_a_listing_says_where_a_day_begins(two_days: Path, capsys: Capsys) -> None:
    out = within(capsys, "decode", two_days).out.splitlines()
    at = out.index("2026-11-21")
    assert out[at - 1].startswith("22:55:14.00")
    assert out[at + 1].startswith("22:55:06.00")
    relative = within(capsys, "decode", two_days, "--time", "rel").out
    for told in (relative, within(capsys, "decode", CAPTURE).out):
        assert not re.search(r"(?m)^2026-", told)


def test_what_is_shown_of_the_second_day_alone_has_its_date(two_days: Path, capsys: Capsys) -> None:
    midnight = 1795219200 * 10**9
    shown = within(capsys, "decode", two_days, "--where", f"t_ns > {midnight}").out
    assert shown.splitlines()[1] == "2026-11-21"
    quiet = within(capsys, "decode", two_days, "--where", f"t_ns < {midnight}").out
    assert "2026-" not in quiet.split("\n\n")[0]


def test_when_a_servo_answered_last_is_told_with_the_day(
    two_days: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capsys
) -> None:
    monkeypatch.setenv("COLUMNS", "150")
    assert " 2026-11-21 22:55:13.968 " in within(capsys, "stats", two_days).out
    assert " 22:55:13.968 " in within(capsys, "stats", CAPTURE).out


def test_an_incident_of_the_second_day_alone_has_its_date(tmp_path: Path, capsys: Capsys) -> None:
    clean = CAPTURE.with_name("mightyzap_clean.log").read_text()
    later = re.sub(r"(?m)^\((\d+)", lambda t: f"({int(t[1]) + 86400}", CAPTURE.read_text())
    path = tmp_path / "days.log"
    path.write_text(clean.rstrip("\n") + "\n" + later)
    told = within(capsys, "diagnose", path).out
    assert re.search(r"(?m)^\d  2026-11-21 22:55:0\d\.\d ", told)


def test_an_incident_that_ends_on_another_day_says_which(
    two_days: Path, tmp_path: Path, capsys: Capsys
) -> None:
    told = within(capsys, "diagnose", two_days).out
    assert "6 times until 2026-11-21 22:55:13.9" in " ".join(told.split())
    assert "2026-" not in within(capsys, "diagnose", CAPTURE).out
    assert within(capsys, "report", two_days, "-o", tmp_path / "r.md").status == 0
    written = (tmp_path / "r.md").read_text()
    assert re.search(r"22:55:06\.\d+ to 2026-11-21 22:55:13\.\d+", written)


def test_hours_of_a_clock_that_counts_from_its_beginning_are_seen_whole(
    tmp_path: Path, capsys: Capsys
) -> None:
    path = tmp_path / "uptime.log"
    path.write_text(re.sub(r"(?m)^\(17952\d{5}", "(1000000", CAPTURE.read_text()))
    out = within(capsys, "decode", path).out.splitlines()
    assert re.match(r"277:46:40\.001\d* +(bus0 +)?1 > echo", out[1])
