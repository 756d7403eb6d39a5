"""Goal steps in the figures: how long until a joint settles, how far it goes beyond."""

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sniffer.ground.model import Chunk, Clock
from tests.streams.mightyzap import packet
from tests.test_stats import MS, counted, exchange

if TYPE_CHECKING:
    from collections.abc import Sequence


def goal(at_ms: float, value: int) -> list[Chunk]:
    byte_ns = 10**10 // 57600
    data = packet(1, 0xF3, b"\x86" + value.to_bytes(2, "little"))
    return [Chunk(data, round(at_ms * MS) + len(data) * byte_ns, Clock.SAMPLE)]


def test_a_goal_step_settles_between_two_positions_and_overshoots_as_seen() -> None:
    way = [0, 1000, 1800, 2200, 2050, 2000, 2000, 2000]
    chunks = [c for k in range(5) for c in exchange(10.0 * k)]
    chunks += goal(50, 2000)
    for k, value in enumerate(way):
        chunks += exchange(60.0 + 10 * k, value)
    (servo,) = counted("mightyzap", chunks, baud=57600)["buses"][0]["servos"]
    (steps,) = servo["steps"]
    assert steps["count"] == 1
    assert steps["fates"] == {"settled": 1}
    # 2200 of 2000 is 10 % beyond, and outside; 2050 is inside
    assert steps["overshoot_percent"]["max"] == pytest.approx([10, 10], rel=0.03)
    low, high = steps["settle_ns"]["p50"]
    assert low <= 42 * MS
    assert high >= 48 * MS
    assert high - low <= 14 * MS


def test_a_position_under_the_id_that_may_be_everyone_is_of_no_other_servo() -> None:
    chunks = [*exchange(0), *goal(10, 2000), *exchange(20, 500, servo=0), *exchange(30, 2000)]
    zero, servo = counted("mightyzap", chunks, baud=57600)["buses"][0]["servos"]
    assert (zero["servo_id"], zero["following_error"]) == (0, [])
    (error,) = servo["following_error"]
    assert (error["size"]["count"], error["worst"]["value"]) == (1, 0)


def slow_steps(
    course: Sequence[tuple[str, float]], count: float, apart_ms: float
) -> tuple[dict[str, int], list[tuple[float, float, str]]]:
    """Return what becomes of steps, one event after the other; and those seen late to be in vain.

    Of these the goal, the last position, and what ended it.
    """
    out: defaultdict[str, int] = defaultdict(int)
    missed = []
    begun = looked = 0
    now = last = math.nan
    step: list[float] | None = None

    def end(fate: str) -> None:
        if step is not None:
            travel, target, *seen = step
            band = max(0.05 * abs(travel), 4 * count)
            inside = list(itertools.takewhile(lambda x: abs(x - target) <= band, reversed(seen)))
            unseen = "unseen" if fate == "overtaken" and not seen else fate
            out["settled" if len(inside) >= 2 else unseen] += 1
            if seen and not inside and (looked - begun) * apart_ms >= 500:
                ended = {"overtaken": "next_goal", "under_way": "capture_end"}[fate]
                missed.append((target, seen[-1], ended))

    for k, (kind, value) in enumerate(course):
        if kind == "at":
            last, looked = value, k
            if step is not None:
                step.append(value)
        elif value != now:
            end("overtaken")
            begun = k
            now, travel = value, value - last
            step = [travel, value] if abs(travel) > 8 * count else None
    end("under_way")
    return dict(out), missed


@given(
    course=st.lists(
        st.tuples(st.sampled_from(["at", "at", "to"]), st.integers(0, 400)), max_size=30
    ),
    cuts=st.lists(st.integers(1, 10**6), max_size=4),
    apart_ms=st.sampled_from([10.0, 120.0]),
)
@settings(max_examples=40)
def test_steps_are_judged_as_one_by_one(
    course: list[tuple[str, int]], cuts: list[int], apart_ms: float
) -> None:
    # so no position lies right on an edge of a band, where rounding would decide
    course = [("at", 0), *((kind, value // 11 * 11 + (kind == "to")) for kind, value in course)]
    chunks = [
        c
        for k, (kind, value) in enumerate(course)
        for c in (exchange(apart_ms * k, value) if kind == "at" else goal(apart_ms * k, value))
    ]
    (servo,) = counted("mightyzap", chunks, cuts, 57600)["buses"][0]["servos"]
    fates = {name: n for s in servo["steps"] for name, n in s["fates"].items()}
    slow, missed = slow_steps([(kind, float(value)) for kind, value in course], 1.0, apart_ms)
    assert fates == slow
    told = [goal for s in servo["steps"] for goal in s["unreached_goals"]]
    mm = 30 / 4095
    assert [(g["goal"]["value"], g["left"]["value"], g["ended"]) for g in told] == [
        (pytest.approx(aim * mm), pytest.approx(left * mm), ended) for aim, left, ended in missed
    ]
