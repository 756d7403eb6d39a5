"""By how much a joint is behind its goals: the shift that leaves least of its following error."""

from __future__ import annotations

import bisect
import math
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.commands import within
from tests.test_stats import MS, counted, exchange
from tests.test_stats_goals import goal

if TYPE_CHECKING:
    from pathlib import Path

    from sniffer.ground.model import Chunk

GOALS_MS = 20.0
COUNT = 30 / 4095
"""Of a mightyZAP's position, in mm."""
SHIFTS_MS = range(0, 501, 4)


def trajectory(t_ms: float) -> float:
    """Return where a joint is to be: no motion that repeats within a second."""
    return 2000 + 900 * math.sin(t_ms / 310) + 500 * math.sin(t_ms / 173)


def held(t_ms: float) -> int:
    """Return the goal that was sent last."""
    return round(trajectory(t_ms // GOALS_MS * GOALS_MS))


def follows(lag_ms: float, seconds: float = 6.0, *, noise: int = 0) -> list[Chunk]:
    """Return a joint that is where its goal was some time ago."""
    out: list[Chunk] = []
    for k in range(round(seconds * 1000 / GOALS_MS)):
        t = k * GOALS_MS
        out += goal(t, held(t))
        # the answer ends 4.6 ms behind the begin of its request
        out += exchange(t + 6, held(max(t + 10.6 - lag_ms, 0)) + noise * (-1) ** k)
    return out


def lag_of(chunks: list[Chunk], cuts: list[int] | None = None) -> dict[str, Any] | None:
    (servo,) = counted("mightyzap", chunks, cuts or [], 57600)["buses"][0]["servos"]
    (error,) = servo["following_error"]
    lag: dict[str, Any] | None = error["lag"]
    return lag


@pytest.mark.parametrize("lag_ms", [0, 20, 60, 180, 420])
def test_the_lag_of_a_joint_is_where_it_is_said_to_be(lag_ms: float) -> None:
    lag = lag_of(follows(lag_ms, noise=3))
    assert lag is not None
    low, high = lag["ns"]
    assert low <= lag_ms * MS <= high + GOALS_MS * MS
    assert high - low <= 10 * MS
    assert lag["rms"] < 0.2
    assert lag["rms"] <= lag["rms_unshifted"]


def test_a_joint_that_hangs_limp_has_no_lag() -> None:
    chunks = [
        c for k in range(200) for c in (*goal(20 * k, held(20 * k)), *exchange(20 * k + 6, 9))
    ]
    assert lag_of(chunks) is None


def test_a_goal_that_stands_still_tells_no_lag() -> None:
    chunks = [*goal(0, 2000), *(c for k in range(1, 200) for c in exchange(20.0 * k, 2000))]
    assert lag_of(chunks) is None


def test_few_positions_tell_no_lag() -> None:
    assert lag_of(follows(60, 1.0)) is None


def test_a_capture_without_times_tells_no_lag(tmp_path: Path, capsys: Any) -> None:
    dump = tmp_path / "dump.bin"
    dump.write_bytes(b"".join(c.data for c in follows(60)))
    ran = within(capsys, "stats", dump, "--protocol", "mightyzap", "--baud", "57600")
    assert ran.status == 0
    assert "following error" in ran.out
    assert "lag" not in ran.out


@given(
    lag_ms=st.integers(0, 300),
    cuts=st.lists(st.integers(1, 10**6), max_size=4),
    dropped=st.lists(st.integers(0, 300), max_size=60),
)
@settings(max_examples=10)
def test_a_lag_is_that_of_one_shift_after_the_other(
    lag_ms: int, cuts: list[int], dropped: list[int]
) -> None:
    pairs = follows(lag_ms, 2.0)
    chunks = [c for k, c in enumerate(pairs) if k // 3 * 3 not in dropped]
    told = lag_of(chunks)
    assert lag_of(chunks, cuts) == told
    one_by_one = slowly(chunks)
    assert (told is None) == (one_by_one is None)
    if told is not None and one_by_one is not None:
        # stamps have an uncertainty of their own
        assert told.pop("ns") == pytest.approx(one_by_one.pop("ns"), abs=MS / 10)
        assert told == one_by_one


def slowly(chunks: list[Chunk]) -> dict[str, Any] | None:
    """Return the lag of a joint, one position and one shift after the other."""
    goals: list[tuple[int, int]] = []
    positions: list[tuple[int, int]] = []
    for chunk in chunks:
        assert chunk.t_ns is not None
        value = int.from_bytes(chunk.data[-3:-1], "little")
        if chunk.data[5] == 0xF3 and (not goals or goals[-1][1] != value):
            goals.append((chunk.t_ns, value))
        elif chunk.data[5] == 0:
            positions.append((chunk.t_ns, value))
    squares = [0] * len(SHIFTS_MS)
    count = 0
    times = [t for t, _ in goals]
    for at, position in positions:
        aims = [bisect.bisect_right(times, at - shift * MS) - 1 for shift in SHIFTS_MS]
        if aims[-1] < 0 or aims[-1] == aims[0]:
            continue
        count += 1
        for k, aim in enumerate(aims):
            squares[k] += round(1000 * COUNT * (goals[aim][1] - position)) ** 2
    least = min(squares)
    if count < 50 or least > max(squares) / 2:
        return None
    best = next(k for k, s in enumerate(squares) if s <= 1.1 * least)
    while best + 1 < len(squares) and squares[best + 1] <= squares[best]:
        best += 1
    low, high = max(SHIFTS_MS[best] - 4, 0), SHIFTS_MS[best] + 4
    rms, whole = (round(math.sqrt(squares[k] / count) / 1000, 6) for k in (best, 0))
    return {"ns": [low * MS, high * MS], "count": count, "rms": rms, "rms_unshifted": whole}
