"""The benchmark of hours: the real recorder on a clock that leaps over its sleep."""

from __future__ import annotations

from bench.hours import run
from tests.lists import each_in_turn


@each_in_turn(2, "buses", [1, 4])
def test_a_recording_on_a_leaping_clock_has_every_byte_of_its_lines(buses: int) -> None:
    seen = run(6.0, buses, 57600)  # a busy machine turns half as often
    assert seen.seconds >= 6.0
    assert seen.bytes >= 0.99 * buses * 6.0 * 5760
    assert seen.rounds >= 20
    assert seen.file_mb * 1e6 > seen.bytes
