"""Curves of a report: bounded, the same whatever the cut, and drawn where their values are."""

from __future__ import annotations

import itertools
import math
import re
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer.decoding.durations import Quantiles
from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.ground.amounts import lasting, number
from sniffer.ground.model import Chunk, Clock
from sniffer.reports import svg
from sniffer.reports.curves import Charts
from sniffer.reports.histograms import TimeScale
from sniffer.reports.text import LEVELS, sparkline
from sniffer.simulation.buses import BUSES, simulate
from sniffer.statistics.collector import Collector
from sniffer.statistics.figures import DRAWN, ERROR, LONGEST, SHORTEST, Range, ServoFigures
from sniffer.statistics.figures import Extreme as End
from sniffer.statistics.grid import BUCKETS, CURVES, FINEST_NS, Grid
from tests.commands import within
from tests.golden import CAPTURES
from tests.lists import each_in_turn
from tests.recordings import talk
from tests.test_report import Reader, page_of

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from tests.test_report import Capsys

DAY_NS = 86_400_000_000_000
TIMES = st.lists(
    st.integers(-(10**15), 4 * 10**18) | st.integers(0, 10**10), min_size=1, max_size=60
)


def collected(protocol: str, chunks: Sequence[Chunk], cuts: Sequence[int]) -> Collector:
    """Return what is collected of chunks that come in groups."""
    collector = Collector()
    pipeline = Pipeline(Options(protocol=protocol), [collector], ahead=chunks)
    edges = sorted({0, len(chunks), *(c % len(chunks) for c in cuts)})
    for a, b in itertools.pairwise(edges):
        pipeline.feed(chunks[a:b])
    pipeline.close()
    pipeline.finish()
    return collector


def told(collector: Collector) -> tuple[Any, ...]:
    """Return all that a collector holds, so that it can be compared."""
    curves = collector.grid.curves()

    def rows(number: int) -> Any:
        curve = curves.get(number)
        if curve is None:
            return None
        columns = (curve.at, curve.n, curve.low, curve.high, curve.mean, curve.last)
        return [c.tolist() for c in columns]

    servos = [
        (
            lane,
            servo,
            mine.responses,
            sorted(mine.outcomes.items()),
            sorted(mine.goals.items()),
            sorted((k, r.count, r.least, r.most, rows(r.curve)) for k, r in mine.values.items()),
            sorted((k, rows(n)) for k, n in mine.curves.items()),
        )
        for lane, servo, mine in collector.servos()
    ]
    wires = [
        (bus, sorted((k, rows(n)) for k, n in w.curves.items()), sorted(w.remarks.items()))
        for bus, w in collector.wires.items()
    ]
    grid = collector.grid
    return servos, wires, grid.first_ns, grid.width_ns, grid.size


@each_in_turn(4, "protocol", BUSES)
@given(data=st.data())
def test_what_is_collected_does_not_depend_on_how_the_stream_was_cut(
    protocol: str, data: st.DataObject
) -> None:
    seed = data.draw(st.integers(0, 3))
    chunks = talk(protocol, 0.3, seed)
    cuts = data.draw(st.lists(st.integers(1, 10**6), max_size=8))
    assert told(collected(protocol, chunks, cuts)) == told(collected(protocol, chunks, []))


def test_frames_and_what_is_none_are_in_order_where_a_cut_is_between_them() -> None:
    chunks = talk("rs30x", 0.3, 1)
    assert told(collected("rs30x", chunks, [170_240])) == told(collected("rs30x", chunks, []))


@given(times=TIMES, data=st.data())
def test_a_grid_keeps_count_sum_and_extremes_in_few_buckets(
    times: list[int], data: st.DataObject
) -> None:
    values = [data.draw(st.integers(-(10**6), 10**6)) for _ in times]
    grid = Grid()
    curve, other = grid.curve(), grid.curve()
    k = data.draw(st.integers(0, len(times)))
    for part in (slice(0, k), slice(k, None)):
        grid.add(curve, np.array(times[part], np.int64), np.array(values[part], float))
    assert 1 <= grid.size <= BUCKETS
    found = grid.curves()
    assert not len(found[other])
    kept = found[curve]
    assert kept.n.sum() == len(times)
    assert math.isclose((kept.mean * kept.n).sum(), sum(values), abs_tol=1e-6)
    assert (kept.low.min(), kept.high.max()) == (min(values), max(values))
    at = [(t - grid.first_ns) // grid.width_ns for t in times]
    assert set(kept.at.tolist()) == set(at)
    for bucket, low, high, last in zip(
        kept.at.tolist(), kept.low.tolist(), kept.high.tolist(), kept.last.tolist(), strict=True
    ):
        mine = [v for v, b in zip(values, at, strict=True) if b == bucket]
        assert (low, high) == (min(mine), max(mine))
        # buckets become one in the order of their times, whenever each was filled
        assert last == mine[-1] if times == sorted(times) else last in mine


def test_a_grid_is_as_fine_as_its_time_allows() -> None:
    grid = Grid()
    curve = grid.curve()
    for span, width in ((0, 1), (1023, 1), (1024, 2), (3_600_000, 4096)):
        grid.add(curve, np.array([span * FINEST_NS]), np.array([1.0]))
        assert grid.width_ns == width * FINEST_NS
    assert grid.size > BUCKETS // 2


def test_curves_beyond_the_bound_are_not_kept() -> None:
    grid = Grid()
    assert [grid.curve() for _ in range(CURVES)] == list(range(CURVES))
    assert grid.curve() == -1
    grid.add(-1, np.array([1]), np.array([1.0]))
    assert grid.size == 0


def points(path: str) -> list[tuple[int, int]]:
    """Return the points of a path as a browser walks it."""
    out: list[tuple[int, int]] = []
    x = y = 0
    for command, rest in re.findall(r"([MlhvVz])([^MlhvVz]*)", path):
        numbers = [int(n) for n in re.findall(r"-?\d+", rest)]
        match command:
            case "M":
                x, y = numbers
            case "h":
                x += numbers[0]
            case "v":
                y += numbers[0]
            case "V":
                y = numbers[0]
            case "l":
                for dx, dy in zip(numbers[::2], numbers[1::2], strict=True):
                    x, y = x + dx, y + dy
                    out.append((x, y))
                continue
            case _:
                continue
        out.append((x, y))
    return out


COLUMN = st.lists(st.tuples(st.integers(1, 9), st.integers(0, svg.HEIGHT)), min_size=1, max_size=80)


@given(COLUMN)
def test_a_line_goes_through_all_its_points_and_no_others(column: list[tuple[int, int]]) -> None:
    x = np.cumsum([dx for dx, _ in column])
    y = np.array([y for _, y in column])
    path = svg.line(x, y)
    given_ = set(zip(x.tolist(), y.tolist(), strict=True))
    walked = set(points(path))
    assert walked <= given_
    level = {(int(x[k]), int(y[k])) for k in range(1, len(x) - 1) if y[k - 1] == y[k] == y[k + 1]}
    assert given_ - walked <= level
    assert path.count("M") == len(svg.runs(x))


@given(COLUMN)
def test_a_band_encloses_what_lies_between_its_lines(column: list[tuple[int, int]]) -> None:
    x = np.cumsum([dx for dx, _ in column])
    top = np.array([y for _, y in column])
    bottom = np.minimum(top + 7, svg.HEIGHT)
    walked = set(points(svg.band(x, top, bottom)))
    for k, (at, y) in enumerate(walked):
        i = int(np.searchsorted(x, at))
        assert x[i] == at, k
        assert y in (top[i], bottom[i])


@given(COLUMN)
def test_stairs_keep_each_value_until_the_next(column: list[tuple[int, int]]) -> None:
    x = np.cumsum([dx for dx, _ in column])
    y = np.array([y for _, y in column])
    end = int(x[-1]) + 3
    walked = points(svg.stairs(x, y, end))
    assert walked[0] == (x[0], y[0])
    assert walked[-1] == (end, y[-1])
    for (x0, y0), (x1, y1) in itertools.pairwise(walked):
        assert x0 == x1 or y0 == y1


@given(st.floats(-1e9, 1e9), st.floats(0, 1e9), st.sampled_from([0.0, 0.5, 5.0]), st.integers(2, 5))
def test_an_axis_holds_its_range_between_round_ends(
    low: float, span: float, least: float, labels: int
) -> None:
    axis = svg.axis(low, low + span, least=least, labels=labels)
    slack = 1e-6 * max(abs(low), span, 1.0)
    assert axis.low <= low + slack
    assert axis.high >= low + span - slack
    assert axis.high > axis.low
    assert 2 <= len(axis.ticks) <= 2 * labels + 2
    ends = axis.y(np.array([axis.low, axis.high]))
    assert ends.tolist() == [svg.HEIGHT, 0]


@given(COLUMN, st.integers(1, 12))
def test_a_coarser_curve_has_the_same_count_sum_and_extremes(
    column: list[tuple[int, int]], factor: int
) -> None:
    grid = Grid()
    number = grid.curve()
    at = np.cumsum([dx for dx, _ in column]) * FINEST_NS
    grid.add(number, at, np.array([float(y) for _, y in column]))
    fine = grid.curves()[number]
    coarse = svg.coarser(fine, factor)
    assert coarse.n.sum() == fine.n.sum()
    assert math.isclose((coarse.mean * coarse.n).sum(), (fine.mean * fine.n).sum())
    assert (coarse.low.min(), coarse.high.max()) == (fine.low.min(), fine.high.max())
    assert len(np.unique(coarse.at)) == len(coarse)


def noisy(servos: int, seed: int = 1) -> Collector:
    """Return a collector full of noise: no curve can take more room on a page."""
    rng = np.random.default_rng(seed)
    collector = Collector()
    grid = collector.grid
    t_ns = np.arange(4 * BUCKETS) * FINEST_NS * 900
    mine: dict[int, ServoFigures] = {}
    for servo in range(servos):
        figures = mine[servo] = ServoFigures(responses=1)
        named = [(q, "x") for q in DRAWN]
        for key in named:
            value = rng.normal(0, 100, len(t_ns))
            ends = End(float(value.min()), 0, 0), End(float(value.max()), 0, 0)
            figures.values[key] = Range(len(value), *ends, curve=grid.curve())
            grid.add(figures.values[key].curve, t_ns, value)
        for key in ((ERROR, "x"), (SHORTEST, "ms"), (LONGEST, "ms")):
            figures.curves[key] = grid.curve()
            grid.add(figures.curves[key], t_ns, np.abs(rng.normal(0, 100, len(t_ns))))
    collector.__dict__["noise"] = mine
    return collector


@pytest.mark.parametrize("servos", [8, 32])
def test_curves_of_nothing_but_noise_take_less_than_a_page_may(servos: int) -> None:
    collector = noisy(servos)
    charts = Charts(collector, servos, Clock.FILE)
    size = sum(
        len(charts.servo(mine, []).encode()) for mine in collector.__dict__["noise"].values()
    )
    assert size < 2_500_000


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (0.0, "0"),
        (-0.0, "0"),
        (12.0, "12"),
        (12.34567, "12.35"),
        (-0.00012345, "-0.0001234"),
        (1234567.0, "1234567"),
        (1e9, "1e+09"),
        (math.nan, "none"),
        (99.996, "100"),
    ],
)
def test_numbers_have_as_many_digits_as_people_read(value: float, shown: str) -> None:
    assert number(value) == shown


@pytest.mark.parametrize(
    ("ns", "shown"),
    [
        (1_500_000, "1.5 ms"),
        (8_003_000_000, "8.003 s"),
        (125_000_000_000, "2 min 5 s"),
        (3_600_000_000_000, "1 h 0 min"),
        (2 * DAY_NS, "48 h 0 min"),
    ],
)
def test_lengths_of_time_are_told_in_the_unit_that_suits_them(ns: int, shown: str) -> None:
    assert lasting(ns) == shown


@given(st.lists(st.tuples(st.integers(1, 10**11), st.integers(0, 10**9)), min_size=1, max_size=50))
def test_a_histogram_counts_each_time_once_at_its_lower_and_at_its_upper_bound(
    times: list[tuple[int, int]],
) -> None:
    q = Quantiles()
    ns, spread = np.array(times).T
    q.add(ns, spread)
    scale = TimeScale([q])
    for counts in q.histogram():
        assert counts.sum() == len(times)
        assert scale.fitted(counts).sum() == len(times)
    for share in (0.5, 0.99, 1.0):
        bounds = q.at(share)
        assert bounds is not None
        assert 0 <= scale.share(bounds.low) <= scale.share(bounds.high) <= 100


def test_a_line_that_is_hardly_busy_is_drawn_on_a_scale_that_shows_it(
    tmp_path: Path, capsys: Capsys
) -> None:
    path = tmp_path / "idle.log"
    frames = ("FFFFFF0102F10B", "FFFFFF010200FC")
    path.write_text(
        "".join(
            f"({t + k * 0.01:.6f}) bus0 #{hexed}\n"
            for t in (1000.0, 4600.0)
            for k, hexed in enumerate(frames)
        )
    )
    page = page_of(capsys, path, tmp_path)
    plot = page.partition("busy share of the line")[2].partition("</figure>")[0]
    assert re.findall(r"<span[^>]*>([\d.]+)</span>", plot) == ["0", "0.5", "1"]


def test_a_curve_of_goals_alone_is_called_so(tmp_path: Path, capsys: Capsys) -> None:
    path = tmp_path / "x.log"
    goal = "FFFFFF0105F386FF077A"
    path.write_text("".join(f"({k}.0) bus0 #{goal}\n" for k in range(1, 40)))
    assert "<b>goal position</b> mm" in page_of(capsys, path, tmp_path)


def test_the_error_is_that_of_the_last_goal_before_each_position() -> None:
    chunks = [
        Chunk(f.wire, f.t_end_ns, Clock.SAMPLE)
        for f in simulate("wck", seed=5, start_ns=10**18, duration_s=3.0)
    ]
    collector = collected("wck", chunks, [])
    curves = collector.grid.curves()
    drawn = 0
    for _, _, mine in collector.servos():
        name = mine.unit_of("position")
        curve = curves[mine.curves[ERROR, name or ""]]
        position, goal = (mine.values[q, name or ""] for q in ("position", "goal_position"))
        widest = max(
            abs(goal.most.value - position.least.value), abs(goal.least.value - position.most.value)
        )
        assert np.abs(curve.high).max() <= widest + 0.01
        drawn += len(curve)
    assert drawn > 100


def test_times_that_count_from_zero_are_no_day_of_1969(tmp_path: Path, capsys: Capsys) -> None:
    nobodys = tmp_path / "nobodys.mcap"
    within(capsys, "cut", CAPTURES / "wck_clean.log", "-o", nobodys, "--to", "1", "--anonymise")
    for told in (
        Reader(page_of(capsys, nobodys, tmp_path)).text,
        within(capsys, "report", nobodys).out,
    ):
        assert "(no date)" in told
        assert "1969-" not in told
        assert "1970-" not in told


def test_a_line_of_characters_is_level_where_all_numbers_are_one() -> None:
    """Means of one number differ in their last bit by how many of them there are."""
    grid = Grid()
    curve = grid.curve()
    for k in range(300):
        times = np.arange(k % 7 + 1) * FINEST_NS // 10 + k * 3 * FINEST_NS
        grid.add(curve, times, np.full(len(times), 14.652))
    assert set(sparkline(grid.curves()[curve], grid.size)) <= {LEVELS[0], " "}


def test_a_line_does_not_go_on_over_hours_in_which_nothing_was_said() -> None:
    """A minute of polls, three hours of nothing, a minute of polls: two stretches, two dots."""
    assert svg.line(np.array([0, 700]), np.array([5, 5])).count("M") == 2
    assert svg.line(np.array([0, 1, 700, 701]), np.array([5, 5, 9, 9])).count("M") == 2
    assert svg.line(np.arange(0, 1000, 200), np.arange(5)).count("M") == 1
