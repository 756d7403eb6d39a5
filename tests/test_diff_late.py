"""``sniffer diff`` of how late servos are: to the first motion, and behind goals that move."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from sniffer.ground.model import Chunk, Clock
from sniffer.sinks.raw import LogFile
from tests.recordings import START_NS
from tests.test_diff import Capsys, compared
from tests.test_stats_goals import goal
from tests.test_stats_lag import follows
from tests.test_stats_starts import polled

if TYPE_CHECKING:
    from pathlib import Path


def steps_late(late: int) -> list[Chunk]:
    """Return steps from rest of a joint that begins to move so many polls of 10 ms later."""
    told, t, where = polled(0, [3000] * 30), 0.0, 3000
    for step in range(12):
        t, aim = t + 320, 3000 if step % 2 else 1000
        told += [*goal(t, aim), *polled(t + 10, [where] * late + [aim] * (29 - late))]
        where = aim
    return told


@pytest.mark.parametrize("name", ["first_motion", "lag"])
def test_how_late_servos_are_is_compared(name: str, capsys: Capsys, tmp_path: Path) -> None:
    a, b = tmp_path / "a.log", tmp_path / "b.log"
    for path, late in ((a, 2), (b, 8)):
        told = follows(10.0 * late, 14.0) if name == "lag" else steps_late(late)
        file = LogFile(path)
        file.take([Chunk(c.data, (c.t_ns or 0) + START_NS, Clock.FILE) for c in told])
        file.close()
    status, both = compared(capsys, a, b, "--baud", "57600")
    assert status == 1
    one = next(d for d in both["differences"] if (d["about"], d["name"]) == ("motion", name))
    assert one["effect"] == 1
    assert min(one["a"]["n"], one["b"]["n"]) >= 12
    assert one["b"]["median"] - one["a"]["median"] == pytest.approx(60, abs=6)
    assert compared(capsys, a, a, "--baud", "57600")[0] == 0
