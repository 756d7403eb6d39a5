"""What a curve of Rerun shows: to the end, in points, steps and holes, by the second."""

from __future__ import annotations

import math
import struct
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import rerun as rr
from hypothesis import given
from hypothesis import strategies as st
from rerun.chunk import RrdReader

import sniffer
from sniffer.decoding.decoder import Decoder
from sniffer.ground.model import NS, Chunk, Clock, Severity
from sniffer.sinks.rerun.entities import LogLine
from sniffer.sinks.rerun.judged import opening_ns
from sniffer.sinks.rerun.longrun import MOST, Overview
from sniffer.sinks.rerun.sink import RerunSink
from tests.streams.mightyzap import packet
from tests.test_rerun import LOAD, START_NS, STORE, Bus, read, write
from tests.transcripts import ROOT

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path


def test_a_goal_is_drawn_on_to_the_end(tmp_path: Path) -> None:
    bus = Bus()
    bus.say(packet(1, STORE, b"\x86\x10\x08"))
    bus.say(packet(1, 0))
    for _ in range(3):
        bus.ask(1, 0x92, b"\x78", 0)
    write(tmp_path / "a.rrd", bus.chunks)
    rows, static = read(tmp_path / "a.rrd")
    ((told, goal),) = rows["/bus0/servo/1/goal_position"]
    assert rows["/bus0/servo/1/goal_position/held"] == [(told, goal), (bus.now_ns, goal)]
    assert static["/bus0/servo/1/goal_position/held"] == static["/bus0/servo/1/goal_position"]


def test_a_register_that_repeats_another_now_and_then_is_drawn_as_points(tmp_path: Path) -> None:
    decoder, sink = Decoder("lss"), RerunSink(tmp_path / "a.rrd")
    said = [f"#5D{900 - 10 * k}\r".encode() for k in range(9)] + [b"#5QDT\r", b"*5QDT850\r"]
    chunks = [Chunk(line, START_NS + k * 10_000_000, Clock.SAMPLE) for k, line in enumerate(said)]
    for batch in (decoder.feed(*chunks), decoder.close()):
        sink.write("bus0", decoder.protocol, batch)
    sink.close()
    rows, static = read(tmp_path / "a.rrd")
    assert [value for _, value in rows["/bus0/servo/5/target_position"]] == [85.0]
    assert "SeriesPoints:markers" in static["/bus0/servo/5/target_position"]
    assert "SeriesLines:names" in static["/bus0/servo/5/goal_position"]
    # what was told last is the second register's: the first is not drawn on
    assert not any(entity.endswith("/held") for entity in rows)


def test_the_following_error_is_the_position_minus_the_last_goal(tmp_path: Path) -> None:
    bus, expected = Bus(), []
    for goal, position in ((2000, 2100), (3000, 2900), (None, 3000)):
        if goal is not None:
            bus.say(packet(1, STORE, b"\x86" + struct.pack("<H", goal)))
            bus.say(packet(1, 0))
        bus.ask(1, 0x8C, struct.pack("<H", position))
        expected.append(position - (goal or 3000))
    write(tmp_path / "a.rrd", bus.chunks)
    rows, _ = read(tmp_path / "a.rrd")
    errors = [value for _, value in rows["/bus0/servo/1/following_error"]]
    assert np.array(errors) / errors[0] * expected[0] == pytest.approx(expected)
    positions = [t for t, _ in rows["/bus0/servo/1/present_position"]]
    assert [t for t, _ in rows["/bus0/servo/1/following_error"]] == positions


def polled(path: Path, times_ms: Sequence[int]) -> tuple[list[float], dict[str, Any]]:
    """Return the positions drawn of a servo that is asked at these times, and how."""
    bus = Bus()
    for ms in times_ms:
        bus.now_ns = START_NS + ms * 1_000_000
        bus.ask(1, 0x8C, b"\x10\x08")
    write(path, bus.chunks)
    rows, static = read(path)
    entity = "/bus0/servo/1/present_position"
    return [value for _, value in rows[entity]], static[entity]


def test_a_slow_poll_is_no_ramp_and_a_quick_one_is_a_line(tmp_path: Path) -> None:
    _, slow = polled(tmp_path / "slow.rrd", range(0, 20_000, 2000))
    _, quick = polled(tmp_path / "quick.rrd", range(0, 200, 20))
    step, line = (style["SeriesLines:interpolation_mode"] for style in (slow, quick))
    assert (step, line) == ([2], [1])


def test_a_hole_is_a_hole_and_a_few_lost_answers_are_none(tmp_path: Path) -> None:
    drawn, _ = polled(tmp_path / "a.rrd", [*range(0, 400, 20), *range(3000, 3400, 20)])
    assert [math.isnan(value) for value in drawn] == [False] * 20 + [True] + [False] * 20
    drawn, _ = polled(tmp_path / "b.rrd", [*range(0, 400, 20), *range(440, 800, 20)])
    assert not any(map(math.isnan, drawn))


def test_missing_answers_and_bus_load_are_told_by_the_second(tmp_path: Path) -> None:
    bus = Bus()
    for tick in range(40):
        bus.now_ns = START_NS + tick * 100_000_000
        bus.ask(1, 0x8C, b"\x10\x08")
        if 10 <= tick < 20 and tick % 2:
            bus.say(packet(2, LOAD, b"\x8c\x02"))
        elif tick % 2:
            bus.ask(2, 0x8C, b"\x10\x08")
    write(tmp_path / "a.rrd", bus.chunks)
    rows, _ = read(tmp_path / "a.rrd")
    missing = {t - START_NS: n for t, n in rows["/bus0/servo/2/missing_answers"]}
    assert [missing[s * 1_000_000_000] for s in range(4)] == [0, 5, 0, 0]
    assert {n for _, n in rows["/bus0/servo/1/missing_answers"]} == {0}
    load = [percent for _, percent in rows["/bus0/bus_load"]]
    said = sum(len(chunk.data) for chunk in bus.chunks)
    assert sum(load[:-1]) == pytest.approx(said * 40_000 / 1e7, rel=0.01)
    marks = [t for t, _ in rows["/bus0/servo/2/marks/position/error"]]
    assert len(marks) == 5


def test_the_incidents_of_a_capture_stand_in_its_plot_with_their_causes(tmp_path: Path) -> None:
    capture = ROOT / "sample_captures" / "mightyzap_damaged.log"
    known = [one for one in sniffer.diagnose(capture).incidents if one.servo_ids]
    assert known
    sniffer.convert(capture, [tmp_path / "a.rrd"])
    rows, _ = read(tmp_path / "a.rrd")
    for one in known:
        for servo in one.servo_ids:
            log = rows[f"/bus0/servo/{servo}/incidents"]
            assert any(row[0] == one.first_ns and one.cause in str(row) for row in log)
            marks = rows[f"/bus0/servo/{servo}/marks/position/incident"]
            assert one.first_ns in [t for t, _ in marks]
    alone = tmp_path / "b.rrd"
    sniffer.convert(capture, [alone], selection=sniffer.Selection.of(servos=[1]))
    entities = read(alone)[0]
    assert not [path for path in entities if "/servo/2/" in path], "what is not shown is not marked"


def test_an_incident_that_comes_before_all_else_leaves_the_times_dates(tmp_path: Path) -> None:
    path = tmp_path / "a.rrd"
    live = rr.RecordingStream("live")
    live.save(path)
    sink, decoder, bus = RerunSink(recording=live), Decoder("mightyzap", baud=250_000), Bus()
    sink.incident("bus0", [1], LogLine(START_NS, Severity.WARN, "bad-cable"))
    bus.ask(1, 0x8C, b"\x10\x08")
    sink.write("bus0", decoder.protocol, decoder.feed(*bus.chunks))
    sink.close()
    live.disconnect()
    batches = [chunk.to_record_batch() for chunk in RrdReader(str(path)).stream()]
    kinds = {str(b.schema.field("time").type) for b in batches if "time" in b.schema.names}
    assert kinds == {"timestamp[ns]"}


@given(
    st.lists(st.tuples(st.integers(0, 8), st.integers(0, 900), st.floats(0, 50)), min_size=1),
)
def test_an_overview_has_the_largest_of_every_few_seconds(
    rows: list[tuple[int, int, float]],
) -> None:
    overview = Overview()
    for who, second, value in rows:
        times = np.array([second * NS, (second + 1) * NS], np.int64)
        overview.add(("bus0", who, "error"), (times, np.array([value, np.nan])))
    for who in range(9):
        overview.add(("bus0", who, "error"), (np.array([rows[0][1] * NS]), np.zeros(1)))
        rows = [*rows, (who, rows[0][1], 0.0)]
    seconds = [second for _, second, _ in rows]
    step = overview.step_s
    if max(seconds) - min(seconds) < MOST:
        assert step == 1
        assert not list(overview.curves())
        return
    assert 1 + max(seconds) // step - min(seconds) // step <= MOST
    for (_, who, _), (times, values) in overview.curves():
        assert (np.diff(times) >= 0).all()
        assert min(seconds) * NS <= times[0]
        assert times[-1] <= (max(seconds) + 1) * NS
        peaks = {
            k: max(v for w, s, v in rows if w == who and s // step == k)
            for k in {s // step for w, s, _ in rows if w == who}
        }
        known = ~np.isnan(values)
        drawn = zip(times[known].tolist(), values[known].tolist(), strict=True)
        starts = {max(k * step, min(seconds)) * NS: v for k, v in peaks.items()}
        assert {t: v for t, v in drawn if t in starts and starts[t] == v} == starts
        assert set(values[known].tolist()) == set(peaks.values())


def test_a_long_recording_opens_with_few_steps_of_the_largest_errors(tmp_path: Path) -> None:
    bus = Bus()
    for second in range(150):
        bus.now_ns = START_NS + second * NS
        for servo in range(1, 9):
            bus.say(packet(servo, STORE, b"\x86" + struct.pack("<H", 2000)))
            bus.say(packet(servo, 0))
            bus.ask(servo, 0x8C, struct.pack("<H", 2000 + second))
    write(tmp_path / "a.rrd", bus.chunks)
    rows, static = read(tmp_path / "a.rrd")
    for servo in range(1, 9):
        entity = f"/bus0/servo/{servo}/largest_following_error"
        assert len(rows[entity]) > 150
        steps = [value for _, value in rows[f"{entity}_overview"] if not math.isnan(value)]
        assert 150 / 4 <= len(steps) <= MOST
        assert steps == sorted(steps)
        assert static[f"{entity}_overview"] == static[entity]


def test_plots_open_at_the_first_incident_that_is_an_error_and_without_one_at_the_first_error() -> (
    None
):
    warned, grave, later = (
        LogLine(t_ns, severity, "incident")
        for t_ns, severity in ((5, Severity.WARN), (40, Severity.ERROR), (90, Severity.ERROR))
    )
    assert opening_ns([warned, later, grave], 20) == 40
    assert opening_ns([warned], 20) == 20
    assert opening_ns([warned], None) == 5
    assert opening_ns([], None) is None


def test_a_following_error_has_the_sign_that_figures_have(tmp_path: Path) -> None:
    capture = ROOT / "sample_captures" / "mightyzap_damaged.log"
    out = tmp_path / "a.rrd"
    sniffer.convert(capture, [out])
    rows, _ = read(out)
    (bus,) = sniffer.stats(capture).as_dict()["buses"]
    for servo in bus["servos"]:
        curve = [value for _, value in rows[f"/bus0/servo/{servo['servo_id']}/following_error"]]
        worst = servo["following_error"][0]["worst"]["value"]
        assert max(curve, key=abs) == pytest.approx(worst, abs=1e-5)
        assert worst
