"""The benchmark of hours: the real recorder on a clock that leaps over its sleep."""

from __future__ import annotations

import pytest

from bench.hours import run


@pytest.mark.parametrize("buses", [1, 4])
def test_a_recording_on_a_leaping_clock_has_every_byte_of_its_lines(buses: int) -> None:
    seen = run(3.0, buses, 57600)
    assert seen.seconds >= 3.0
    assert seen.bytes >= 0.99 * buses * 3.0 * 5760
    assert seen.rounds > 1  # how many, the load of the machine says
    assert seen.file_mb * 1e6 > seen.bytes
