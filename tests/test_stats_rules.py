"""How long rules of the user's own were met, and when, as ``sniffer stats --alarm`` tells it."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

from tests.commands import within
from tests.golden import CAPTURES
from tests.test_stats import MS, Counting, told_of

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

CAPTURE = CAPTURES / "mightyzap_damaged.log"


def test_how_long_a_rule_was_met_lies_between_the_values_around_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    bus = Counting(capsys).bus(CAPTURE, "--alarm", "3.temperature > 31")
    (rule,) = bus["alarms"]
    met = [
        (row.t_ns, row.value > 31)
        for row in told_of(CAPTURE)
        if row.type == "sample" and row.servo_id == 3 and row.register == "present_temperature"
        if row.value is not None
    ]
    pairs = list(itertools.pairwise(met))
    assert rule["values"] == len(met)
    assert rule["met_ns"] == [
        sum(b[0] - a[0] for a, b in pairs if a[1] and b[1]),
        sum(b[0] - a[0] for a, b in pairs if a[1] or b[1]),
    ]
    when = [t_ns for t_ns, is_met in met if is_met]
    assert [rule[end]["t_ns"] for end in ("first", "last")] == [when[0], when[-1]]
    assert rule["worst"]["value"] == 32
    done = Counting(capsys).says(CAPTURE, "--alarm", "3.temperature > 31")
    begun = bus["first_ns"]
    assert "3.temperature > 31" in done.out
    seconds = [f"{(t_ns - begun) / 1000 / MS:.3f}" for t_ns in (when[0], when[-1])]
    assert " ".join(seconds) in " ".join(done.out.split())


def test_of_a_rule_that_none_met_no_moment_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    (rule,) = Counting(capsys).bus(CAPTURE, "--alarm", "3.temperature > 99")["alarms"]
    assert (rule["met"], rule["first"], rule["last"], rule["worst"]) == (0, None, None, None)


def test_rules_that_a_recording_keeps_are_counted_as_those_that_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Only decode knew them."""
    path = tmp_path / "kept.mcap"
    rule = "3.temperature > 31"
    assert within(capsys, "convert", CAPTURE, path, "--alarm", rule).status == 0
    bus = Counting(capsys).bus(path)
    assert [each["rule"] for each in bus["alarms"]] == [rule]
    assert bus["alarms"] == Counting(capsys).bus(path, "--alarm", rule)["alarms"]
    assert "your rules" in Counting(capsys).says(path).out


def test_a_rule_that_nothing_was_judged_by_is_told_to_be_none(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """It read as one that was never met."""
    rules = ["--alarm", "7.voltage < 8", "--alarm", "current > 8", "--alarm", "voltage < 8"]
    absent = "the rule '7.voltage < 8' judges nothing: servo 7 is not in it: one of 1, 2, 3\n"
    for command in ("decode", "stats", "diagnose"):
        told = within(capsys, command, CAPTURE, *rules)
        assert told.status == 0
        assert told.err.count("judges nothing") == 1 + (command == "stats")
        assert absent in told.err
    silent = "the rule 'current > 8' judges nothing: no value of that kind was told\n"
    assert silent in within(capsys, "stats", CAPTURE, *rules).err
    elsewhere = within(capsys, "stats", CAPTURE, "--alarm", "bus0:3.current > 8").err
    assert "the rule 'bus0:3.current > 8' judges nothing: no value" in elsewhere
