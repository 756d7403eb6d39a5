"""How far apart requests that are alike are, and what of a command is a loop."""

from __future__ import annotations

from typing import Final

import pytest

from sniffer.ground.model import Chunk, Clock
from tests.test_stats import counted, exchange

MS: Final = 1_000_000


def test_a_period_and_its_jitter_are_known_to_the_stamps() -> None:
    chunks = [c for k in range(50) for c in exchange(20.0 * k + (1.0 if k % 2 else 0.0))]
    (command,) = counted("mightyzap", chunks, baud=57600)["buses"][0]["commands"]
    assert command["period_ns"]["min"] == pytest.approx([19 * MS, 19 * MS], rel=0.01)
    assert command["period_ns"]["max"] == pytest.approx([21 * MS, 21 * MS], rel=0.01)
    low, high = command["jitter_ns"]["p50"]
    assert low <= 2 * MS <= high <= 2.2 * MS
    low, high = command["response_time_ns"]["p50"]
    assert 0.45 * MS <= low <= 0.5 * MS <= high <= 0.55 * MS


def test_what_is_asked_once_in_a_while_is_no_loop_that_stalls() -> None:
    chunks = [c for k in range(60) for c in exchange(20.0 * k + (8.0 if k == 40 else 0.0))]
    chunks[20:20] = exchange(195.0, asked=0x8E)
    chunks[100:100] = exchange(975.0, asked=0x8E)
    (command,) = counted("mightyzap", chunks, baud=57600)["buses"][0]["commands"]
    assert command["period_ns"]["max"] == pytest.approx([780 * MS, 780 * MS], rel=0.01)
    assert command["longest_period"]["value_ns"] == pytest.approx([28 * MS, 28 * MS], rel=0.01)
    assert command["longest_period"]["t_ns"] == pytest.approx(808 * MS, abs=MS // 10)


def test_the_jitter_of_a_loop_is_its_own_and_not_of_what_is_asked_once_in_a_while() -> None:
    chunks = [c for k in range(60) for c in exchange(20.0 * k)]
    chunks[20:20] = exchange(195.0, asked=0x8E)
    chunks[60:60] = exchange(575.0, asked=0x8E)
    chunks[100:100] = exchange(975.0, asked=0x8E)
    (command,) = counted("mightyzap", chunks, baud=57600)["buses"][0]["commands"]
    assert command["period_ns"]["count"] == 59 + 2
    loop = command["loop"]
    assert (loop["address"], loop["requests"], loop["offset"]) == (0x8C, 60, 0)
    assert loop["period_ns"]["count"] == 59
    assert loop["period_ns"]["max"] == pytest.approx([20 * MS, 20 * MS], rel=0.01)
    assert loop["jitter_ns"]["max"][1] < MS / 10


def test_goals_of_more_and_fewer_digits_are_one_loop() -> None:
    lines = [f"#5D{goal}\r".encode() for goal in (-90, 0, 900, -1200, 5, 1800) * 5]
    chunks = [Chunk(line, 20 * MS * (k + 1), Clock.SAMPLE) for k, line in enumerate(lines)]
    (command,) = counted("lss", chunks, baud=115200)["buses"][0]["commands"]
    assert command["loop"]["requests"] == 30
    for periods in (command["period_ns"], command["loop"]["period_ns"]):
        assert periods["count"] == 29
        assert periods["max"][1] < 21 * MS
