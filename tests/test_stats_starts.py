"""How soon joints begin to move, and which goals they never reach: against one event at a time."""

from __future__ import annotations

import csv
import io
import itertools
import json
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from sniffer.statistics.firstmotion import REST_NS, FirstMotions
from sniffer.statistics.following import Course
from sniffer.statistics.goalsteps import HELD_NS
from tests.commands import sniffer
from tests.test_stats import MS, counted, exchange
from tests.test_stats_goals import goal

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from sniffer.ground.model import Chunk

LEAST: Final = 4.0
"""Counts that are no motion; a count is 1 here."""

Event = tuple[int, int | None, int]
"""Time in ms; a goal (None: it is let go) or, with 1 behind it, a position."""


def polled(begin_ms: float, values: Sequence[int]) -> list[Chunk]:
    return [c for k, value in enumerate(values) for c in exchange(begin_ms + 10 * k, value)]


def motions(chunks: list[Chunk]) -> dict[str, Any]:
    (servo,) = counted("mightyzap", chunks, baud=57600)["buses"][0]["servos"]
    out: dict[str, Any] = servo
    return out


def test_a_joint_that_stood_still_begins_to_move_between_two_positions() -> None:
    chunks = [*polled(0, [0] * 30), *goal(301, 2000), *polled(310, [0, 2, 4, 5, 300, 2000])]
    (start,) = motions(chunks)["first_motion"]
    assert (start["told"], start["moved"], start["recalled"]) == (1, 1, 0)
    low, high = start["ns"]["max"]
    # it was within four counts for the last time at 330, and seen beyond them at 340
    assert low == pytest.approx(30 * MS, abs=3 * MS)
    assert high == pytest.approx(40 * MS, abs=3 * MS)
    assert start["slowest"]["value_ns"] == [low, high]
    assert start["slowest"]["offset"] == 540


def test_a_joint_that_moves_already_begins_nothing() -> None:
    way = [*range(0, 3000, 100)]
    chunks = [*polled(0, way), *goal(301, 4000), *polled(310, [3100, 3200, 3300])]
    assert motions(chunks)["first_motion"] == []


def test_a_trajectory_begins_once_with_the_first_goal_that_asks_for_a_motion() -> None:
    chunks = polled(0, [0] * 30)
    for k, value in enumerate([3, 4, 20, 60, 120, 200, 300]):
        chunks += [*goal(301.0 + 20 * k, value), *polled(310 + 20 * k, [0 if k < 5 else 30 * k])]
    (start,) = motions(chunks)["first_motion"]
    assert (start["told"], start["moved"]) == (1, 1)
    low, high = start["ns"]["max"]
    assert low == pytest.approx((390 - 341) * MS, abs=3 * MS)
    assert high == pytest.approx((410 - 341) * MS, abs=3 * MS)


def test_what_the_goal_before_asks_for_is_no_motion_behind_the_next_one() -> None:
    chunks = [*polled(0, [0] * 30), *goal(301, 7), *polled(310, [0]), *goal(321, 2000)]
    assert motions([*chunks, *polled(330, [6, 7])])["first_motion"] == []


def test_a_goal_that_comes_back_before_a_motion_is_recalled() -> None:
    chunks = [*polled(0, [0] * 30), *goal(301, 2000), *polled(310, [0]), *goal(321, 0)]
    (start,) = motions([*chunks, *polled(330, [0] * 3)])["first_motion"]
    assert (start["told"], start["moved"], start["recalled"]) == (1, 0, 1)
    assert start["ns"] is None


def test_goals_that_held_and_were_not_reached_are_told_with_what_ended_them() -> None:
    chunks = [*polled(0, [0] * 5), *goal(51, 2000), *polled(60, [500, 1200, *[1500] * 60])]
    chunks += [*goal(681, 3000), *polled(690, [1500, 1600, 3000, 3000])]
    chunks += [*goal(731, 0), *polled(740, [*range(2900, 2900 - 55 * 40, -40)])]
    (steps,) = motions(chunks)["steps"]
    one, two = steps["unreached_goals"]
    assert steps["unreached"] == 2
    count = 30 / 4095
    for told, aim, start, left, stands, ended in (
        (one, 2000, 0, 1500, True, "next_goal"),
        (two, 0, 3000, 740, False, "capture_end"),
    ):
        assert told["goal"]["value"] == pytest.approx(aim * count)
        assert told["start"] == pytest.approx(start * count)
        assert told["left"]["value"] == pytest.approx(left * count)
        assert (told["stands"], told["ended"]) == (stands, ended)
    assert one["held_ns"] == 630 * MS
    assert steps["fates"] == {"overtaken": 1, "settled": 1, "under_way": 1}


def test_a_goal_that_was_looked_at_too_early_or_was_met_at_the_last_look_is_not_missed() -> None:
    chunks = [*polled(0, [0] * 5), *goal(51, 2000), *polled(60, [500, 1200])]
    chunks += [*goal(3000, 3000), *polled(3010, [2000]), *polled(5000, [3000])]
    chunks += [*goal(6000, 0), *polled(6010, [2900]), *polled(8000, [0])]
    (steps,) = motions(chunks)["steps"]
    assert (steps["unreached"], steps["unreached_goals"]) == (0, [])
    assert steps["fates"] == {"overtaken": 2, "under_way": 1}


def slow_starts(events: Sequence[Event]) -> tuple[int, int, int, list[tuple[int, int]]]:
    """Return goals from rest, those moved and recalled, and bounds in ms, event after event."""
    seen: list[tuple[int, int]] = []
    goals: list[tuple[int, float]] = []
    wait: tuple[int, float, float, int] | None = None
    told = moved = recalled = 0
    bounds = []
    for t, value, is_position in events:
        if is_position:
            assert value is not None
            seen.append((t, value))
            if wait is not None:
                at, rest, sign, still = wait
                if (value - rest) * sign > LEAST:
                    moved, wait = moved + 1, None
                    bounds.append((still - at, t - at))
                else:
                    wait = (at, rest, sign, t)
            continue
        now = float("nan") if value is None else float(value)
        before = goals[-1][1] if goals else float("nan")
        if now == before or (now != now and before != before):
            continue
        if wait is not None:
            if (now - wait[1]) * wait[2] > 2 * LEAST:
                goals.append((t, now))
                continue
            recalled, wait = recalled + 1, None
        since = t - REST_NS // MS
        old = [k for k, (at, _) in enumerate(seen) if at <= since]
        if len(seen) >= 2 and old:
            there = [p for _, p in seen[min(old[-1], len(seen) - 2) :]]
            rest = there[-1]
            asked = [g for at, g in goals if at > since and abs(g - rest) > LEAST]
            still = max(there) - min(there) <= LEAST
            if still and not asked and abs(now - rest) > 2 * LEAST:
                told += 1
                wait = (t, float(rest), 1.0 if now > rest else -1.0, t)
        goals.append((t, now))
    return told, moved, recalled, bounds


EVENTS: Final = st.lists(
    st.tuples(
        st.sampled_from([1, 20, 60, 150, 250]),
        st.sampled_from([0, 3, 6, 10, 12, 40, -40, -9, None]),
        st.sampled_from([0, 1, 1]),
    ),
    max_size=40,
)


@settings(max_examples=150, deadline=None)
@given(EVENTS, st.lists(st.integers(1, 39), max_size=3))
@example([(150, 0, 1)] * 3 + [(1, 40, 0), (60, 0, 1), (60, 40, 1)], [4])
@example([(150, 0, 1)] * 3 + [(1, 40, 0), (60, -40, 0), (60, 0, 1), (60, -40, 1)], [4, 5])
def test_starts_are_those_of_one_event_at_a_time_however_the_stream_is_cut(
    drawn: Sequence[Event], cuts: Sequence[int]
) -> None:
    events: list[Event] = []
    t = 1000
    for wait, value, is_position in drawn:
        t += wait
        events.append((t, 0 if is_position and value is None else value, is_position))
    motions_, before = FirstMotions([]), float("nan")
    edges = [0, *sorted({c for c in cuts if c < len(events)}), len(events)]
    for begin, end in itertools.pairwise(edges):
        part = events[begin:end]
        if not part:
            continue
        held, now = [], before
        for _, value, is_position in part:
            now = now if is_position else float("nan") if value is None else float(value)
            held.append(now)
        course = Course(
            1,
            "",
            np.array([t * MS for t, _, _ in part]),
            np.zeros(len(part), np.int64),
            np.arange(begin, end),
            np.array([float(v) if p and v is not None else np.nan for _, v, p in part]),
            np.array(held),
            before,
            np.ones(len(part), bool),
        )
        motions_._count[""] = 1.0
        motions_.add(course)
        before = now
    told, moved, recalled, bounds = slow_starts(events)
    mine = motions_.figures().get((1, ""))
    assert (told > 0) == (mine is not None)
    if mine is not None:
        assert (mine.told, mine.moved, mine.recalled) == (told, moved, recalled)
        assert mine.times.count == len(bounds)
        if bounds:
            longest = mine.times.longest()
            assert longest is not None
            assert abs(longest.low - max(low for low, _ in bounds) * MS) <= 1
            assert abs(longest.high - max(high for _, high in bounds) * MS) <= 1


def test_what_was_not_reached_and_when_it_began_is_told_as_text_json_and_csv(
    tmp_path: Path,
) -> None:
    chunks = [*polled(0, [0] * 30), *goal(301, 2000), *polled(310, [0, 0, *[1500] * 60])]
    chunks += [*goal(931, 1500), *polled(940, [1500] * 3)]
    path = tmp_path / "run.log"
    lines = [f"({(c.t_ns or 0) / 1e9:.9f}) bus0 #{c.data.hex().upper()}" for c in chunks]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    asked = ("stats", path, "--protocol", "mightyzap", "--baud", "57600", "--name", "1=left_knee")
    shown = sniffer(*asked, env={"COLUMNS": "80"}).out
    begun = shown.split(" first motion behind ")[1].splitlines()
    assert begun[2].split()[:4] == ["1", "left_knee", "1", "1"]
    missed = shown.split(f" goals not reached in {HELD_NS / 1e9:g} s and more")[1].splitlines()
    assert missed[2].split() == [
        *("1", "left_knee", "0.303", "14.7", "0", "11", "3.66", "mm", "0.63", "next", "goal"),
    ]
    (servo,) = json.loads(sniffer(*asked, "--format", "json").out)["buses"][0]["servos"]
    (one,) = servo["steps"][0]["unreached_goals"]
    rows = list(csv.DictReader(io.StringIO(sniffer(*asked, "--format", "csv").out)))
    told = {r["figure"]: r for r in rows if r["about"] == "unreached"}
    assert {r["name"] for r in told.values()} == {"1"}
    assert float(told["goal"]["value"]) == one["goal"]["value"]
    assert int(told["left"]["offset"]) == one["left"]["offset"]
    assert told["ended"]["value"] == "next_goal"
    slowest = next(r for r in rows if (r["about"], r["figure"]) == ("first_motion", "slowest"))
    start = servo["first_motion"][0]["slowest"]
    assert [float(slowest["low"]), float(slowest["high"])] == start["value_ns"]
    assert int(slowest["offset"]) == start["offset"]
    page = tmp_path / "run.md"
    assert sniffer("report", *asked[1:], "-q", "-o", page).status == 0
    table = [line.split("|") for line in page.read_text(encoding="utf-8").splitlines()]
    head = next(row for row in table if " goals not reached " in row)
    mine = table[table.index(head) + 2]
    assert mine[head.index(" goals not reached ")].strip() == "1"
    assert " / " in mine[head.index(" first motion ms p50 / max ")]
