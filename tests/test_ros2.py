"""What ROS 2 understands of a capture, held to two readers of other people."""

from __future__ import annotations

import math
import re
import signal
from typing import TYPE_CHECKING, Any, Final

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

import sniffer
from sniffer.decoding.rows import AnomalyRow, SampleRow
from sniffer.ground.model import NS, Chunk
from sniffer.jobs.telling import Teller
from sniffer.mcapfile.cdr import (
    DIAGNOSTICS,
    JOINT_STATE,
    DiagnosticStatus,
    diagnostics,
    joint_state,
)
from sniffer.mcapfile.flight import Around, FlightRecorder, Happening
from sniffer.mcapfile.joints import RosJoint
from sniffer.mcapfile.recover import recover
from sniffer.mcapfile.sink import McapSink
from tests.commands import within
from tests.recorder import Recorder, said_by, say_slowly
from tests.recordings import START_NS, talk
from tests.terminals import LINUX_ONLY, Terminal
from tests.test_convert import CAPTURES, LOG, Capsys
from tests.test_mcap_live import live

if TYPE_CHECKING:
    from pathlib import Path

    from tests.viewer import HeadlessViewer

DEGREES: Final = CAPTURES / "rs30x_damaged.log"

rosbags = pytest.importorskip("rosbags.typesys", reason="rosbags is not installed")
TYPES = rosbags.get_typestore(rosbags.Stores.ROS2_HUMBLE)

text = st.text(st.characters(exclude_categories=["C", "Z"], include_characters=" "), max_size=20)
number = st.floats(allow_nan=False, width=64)
moment = st.integers(0, (1 << 31) * 10**9 - 1)


@given(moment, text, number, st.none() | number)
def test_a_joint_state_is_what_rosbags_writes_of_it(
    t_ns: int, name: str, position: float, velocity: float | None
) -> None:
    data = joint_state(t_ns, name, position, velocity)
    read = TYPES.deserialize_cdr(data, JOINT_STATE.name)
    assert read.header.stamp.sec * 10**9 + read.header.stamp.nanosec == t_ns
    assert (read.name, read.position.tolist()) == ([name], [position])
    assert read.velocity.tolist() == ([] if velocity is None else [velocity])
    assert not len(read.effort)
    assert bytes(TYPES.serialize_cdr(read, JOINT_STATE.name)) == data


@given(
    moment,
    st.integers(0, 2),
    text,
    text,
    text,
    st.lists(st.tuples(text, text), max_size=3),
)
def test_a_diagnosis_is_what_rosbags_writes_of_it(
    t_ns: int, level: int, name: str, said: str, hardware: str, values: list[tuple[str, str]]
) -> None:
    data = diagnostics(t_ns, DiagnosticStatus(level, name, said, hardware, values))
    read = TYPES.deserialize_cdr(data, DIAGNOSTICS.name)
    (status,) = read.status
    assert (status.level, status.name, status.message) == (level, name, said)
    assert [(v.key, v.value) for v in status.values] == values
    assert bytes(TYPES.serialize_cdr(read, DIAGNOSTICS.name)) == data


@pytest.mark.parametrize("kind", [JOINT_STATE, DIAGNOSTICS], ids=lambda k: k.name)
def test_definitions_are_those_of_ros(kind: Any) -> None:
    wanted, _ = TYPES.generate_msgdef(kind.name, ros_version=2)
    assert kind.definition.decode() == wanted


def read_by_others(path: Path, *topics: str) -> dict[str, list[Any]]:
    """Return the messages as mcap-ros2-support reads them, by topic; rosbags writes the same."""
    reader = pytest.importorskip("mcap_ros2.reader", reason="mcap-ros2-support is not installed")
    out: dict[str, list[Any]] = {t: [] for t in topics or ("/joint_states", "/diagnostics")}
    for m in reader.read_ros2_messages(path, topics=[*out]):
        out[m.channel.topic].append(m.ros_msg)
    with path.open("rb") as stream:
        raw = [(s, m) for s, _, m in make_reader(stream).iter_messages(topics=[*out])]
    for schema, m in raw:
        assert schema is not None
        assert schema.encoding == "ros2msg"
        read = TYPES.deserialize_cdr(m.data, schema.name)
        assert bytes(TYPES.serialize_cdr(read, schema.name)) == m.data
    assert len(raw) == sum(map(len, out.values()))
    return out


def positions(path: Path, servo: int) -> list[tuple[int, float]]:
    return [
        (s.t_ns, s.value)
        for s in sniffer.decode(path)
        if isinstance(s, SampleRow) and s.servo_id == servo and s.quantity == "position"
        if s.value is not None and s.t_ns is not None
    ]


def stamped(states: list[Any], name: str) -> list[tuple[int, float]]:
    mine = [s for s in states if s.name == [name]]
    return [(s.header.stamp.sec * 10**9 + s.header.stamp.nanosec, s.position[0]) for s in mine]


def test_each_place_that_a_servo_said_is_a_joint_state_in_radians(
    tmp_path: Path, capsys: Capsys
) -> None:
    out = tmp_path / "ros.mcap"
    done = within(capsys, "convert", DEGREES, out, "--ros2")
    assert done.status == 0
    assert "/joint_states has bus0_servo1, bus0_servo2 and bus0_servo5" in done.err
    states = read_by_others(out)["/joint_states"]
    for servo in (1, 2, 5):
        wanted: list[Any] = [
            (t, pytest.approx(math.radians(v))) for t, v in positions(DEGREES, servo)
        ]
        assert len(wanted) > 20
        assert sorted(stamped(states, f"bus0_servo{servo}")) == wanted
    assert any(len(s.velocity) for s in states)
    assert all(not len(s.effort) for s in states)


def test_each_anomaly_is_a_diagnosis(tmp_path: Path, capsys: Capsys) -> None:
    out = tmp_path / "ros.mcap"
    within(capsys, "convert", LOG, out, "--ros2")
    told = [d.status[0] for d in read_by_others(out)["/diagnostics"]]
    found = [a for a in sniffer.decode(LOG) if isinstance(a, AnomalyRow)]
    levels = {"note": 0, "warn": 1, "error": 2}
    assert found
    assert sorted((d.level, d.message) for d in told) == sorted(
        (levels[a.severity], f"{a.detail} [{a.code}]") for a in found
    )


def test_joints_have_names_signs_offsets_and_the_others_are_left_out_and_named(
    tmp_path: Path, capsys: Capsys
) -> None:
    out, joints = tmp_path / "ros.mcap", tmp_path / "joints.toml"
    joints.write_text(
        """
[[joint]]
servo = 1
name = "left_slide"
sign = -1
offset = 0.015

[[joint]]
bus = "bus0"
servo = 2
name = "crank"
quantity = "position_mm"
scale = 0.1

[[joint]]
servo = 9
name = "nobody"
"""
    )
    done = within(capsys, "convert", LOG, out, "--ros2", "--joints", joints)
    assert "/joint_states has crank and left_slide\n" in done.err
    assert (
        "left out of /joint_states: servo 3 of bus0 (not among the joints) and servo 9 of bus0 "
        "(nobody never said where it is)"
    ) in done.err
    states = read_by_others(out)["/joint_states"]
    slide: list[Any] = [(t, pytest.approx(0.015 - v / 1000)) for t, v in positions(LOG, 1)]
    crank: list[Any] = [(t, pytest.approx(v / 10)) for t, v in positions(LOG, 2)]
    assert stamped(states, "left_slide") == slide
    assert stamped(states, "crank") == crank
    assert {s.name[0] for s in states} == {"left_slide", "crank"}
    assert not any(len(s.velocity) for s in states), "mightyZAP says no speed in units"


def test_what_has_no_physical_unit_takes_a_scale_or_is_left_out(tmp_path: Path) -> None:
    out = tmp_path / "ros.mcap"
    lines: list[str] = []
    tell = Teller(lines.append, quiet=False)
    joints = [RosJoint("bus0", 1, "hip", "load"), RosJoint("bus0", 2, "arm", "load", 0.5)]
    sniffer.convert(LOG, [out], contents=sniffer.Contents(None, joints), tell=tell)
    assert any(
        "servo 1 of bus0 (its load has no physical unit: it takes a scale)" in x for x in lines
    )
    assert {s.name[0] for s in read_by_others(out)["/joint_states"]} == {"arm"}


def test_a_recording_calls_joints_as_it_calls_its_servos(tmp_path: Path, capsys: Capsys) -> None:
    run, out = tmp_path / "run.mcap", tmp_path / "ros.mcap"
    sink = McapSink(run, {"name.1": "hip"})
    sent = talk("mightyzap")
    sink.raw("bus0", [Chunk(c.data, c.t_ns, c.clock, "bus0") for c in sent])
    sink.close()
    done = within(capsys, "convert", run, out, "--ros2", "--topics", "raw")
    assert "/joint_states has bus0_servo2, bus0_servo3 and hip" in done.err
    found = read_by_others(out)["/joint_states"]
    assert {s.name[0] for s in found} == {"hip", "bus0_servo2", "bus0_servo3"}
    assert all(s.header.stamp.sec >= START_NS // 10**9 for s in found)


@LINUX_ONLY
def test_a_live_recording_has_what_a_conversion_of_it_has(tmp_path: Path) -> None:
    """Two buses, and two files: what is known of joints crosses from one to the other."""
    with Terminal() as one, Terminal() as two:
        ports = ("left={}=rs30x@115200", "right={}=mightyzap@57600")
        with Recorder(tmp_path, *ports, "--ros2", "--name", "1=hip", lines=[one, two]) as run:
            for seed in (1, 2):
                say_slowly(one, said_by("rs30x", seed, 0.4), 60)
                say_slowly(two, said_by("mightyzap", seed, 0.4), 60)
                if seed == 1:
                    run.tell(signal.SIGHUP)
                    run.wait_until(lambda: len(recorded_files(tmp_path)) == 2, "no second file")
            ran = run.stop()
    assert ran.status == 0
    parts = recorded_files(tmp_path)
    live = [read_by_others(part) for part in parts]
    again = tmp_path / "again.mcap"
    sniffer.convert(parts, [again], contents=sniffer.Contents(None, []))
    wanted = read_by_others(again)
    for topic, least in (("/joint_states", 40), ("/diagnostics", 1)):
        mine = [repr(message) for part in live for message in part[topic]]
        assert len(mine) > least
        assert sorted(mine) == sorted(repr(message) for message in wanted[topic])
    for part in parts:
        with part.open("rb") as stream:
            found = make_reader(stream).iter_messages(
                topics=["/joint_states"], log_time_order=False
            )
            times = [message.log_time for _, _, message in found]
        assert times == sorted(times), "all buses in the order of time"
    (told,) = (line for line in ran.err.splitlines() if "/joint_states has" in line)
    assert "hip" in told


def recorded_files(folder: Path) -> list[Path]:
    return sorted(folder.glob("run*.mcap"), key=lambda path: (len(path.name), path.name))


@LINUX_ONLY
def test_a_flight_recorder_writes_joint_states_too(tmp_path: Path) -> None:
    path = tmp_path / "incident.mcap"
    options = sniffer.Options("rs30x", baud=115200)
    sink = FlightRecorder(path, {}, options, Around(None, NS, 1 << 20), joints=())
    sent = [Chunk(c.data, c.t_ns, c.clock, "bus0") for c in talk("rs30x")]
    sink.raw("bus0", sent)
    sink.happened(Happening(sent[-1].t_ns or 0, "bus0", "a test", "any"))
    sink.close()
    states = read_by_others(sink.files[0])["/joint_states"]
    assert len(states) > 20
    assert "bus0_servo1" in sink.remarks[0]


def test_rerun_draws_the_position_of_each_servo_unasked_where_the_recording_has_plots(
    tmp_path: Path, capsys: Capsys, headless_viewer: HeadlessViewer
) -> None:
    path = tmp_path / "run.mcap"
    within(capsys, "convert", LOG, path, "--topics", "state,plots")
    views = headless_viewer.show(path).views
    assert headless_viewer.complaints() == []
    topics = [f"/bus0/plots/servo_{servo}_position_mm" for servo in (1, 2, 3)]
    assert sorted((view.view_class, view.origin) for view in views) == [
        ("TimeSeries", topic) for topic in topics
    ]
    said = read_by_others(path, *topics)
    for servo, topic in enumerate(topics, 1):
        values = [value for _, value in positions(LOG, servo)]
        assert [m.data[0] for m in said[topic]] == pytest.approx(values)
        assert {len(m.data) for m in said[topic]} == {1}
        assert not any(m.layout.dim for m in said[topic])


def test_a_recording_with_plots_that_is_cut_has_all_of_them_again_and_none_twice(
    tmp_path: Path,
) -> None:
    path, cut, anew = (tmp_path / f"{name}.mcap" for name in ("run", "cut", "anew"))
    sink = live(path, talk("mightyzap", 2.0), flush_ns=0, topics=["plots"])
    data = path.read_bytes()
    sink.close()
    topic = "/bus0/plots/servo_1_position_mm"
    cut.write_bytes(data[: len(data) * 3 // 4])
    assert recover(cut, cut).derived, "nothing else is asked for"
    sniffer.convert(cut, [anew], contents=sniffer.Contents(["plots"]))
    kept, wanted = ([m.data[0] for m in read_by_others(path, topic)[topic]] for path in (cut, anew))
    assert sorted(kept) == sorted(wanted)
    assert recover(cut, cut).derived == 0


@pytest.mark.parametrize("options", [(), ("--ros2",)])
def test_rerun_plots_joint_states_unasked_and_all_joints_as_one_curve(
    options: tuple[str, ...], tmp_path: Path, capsys: Capsys, headless_viewer: HeadlessViewer
) -> None:
    within(capsys, "convert", DEGREES, tmp_path / "run.mcap", *options)
    views = headless_viewer.show(tmp_path / "run.mcap").views
    assert headless_viewer.complaints() == []
    curves = {view.name for view in views if view.view_class == "TimeSeries"}
    known = [e.entity_path for e in headless_viewer.client.get_recording_schema().entities]
    drawn = {f"joint_states/{what}" for what in ("position", "velocity", "effort")}
    assert curves == (drawn if options else set())
    assert known.count("/joint_states/position") == len(options), "an entity for three joints"


def test_a_time_that_ros_cannot_say_is_refused_in_a_line(tmp_path: Path, capsys: Capsys) -> None:
    late = tmp_path / "late.log"
    late.write_text(re.sub(r"^\(\d+", "(4795215306", LOG.read_text(), flags=re.MULTILINE))
    done = within(capsys, "convert", late, tmp_path / "x.mcap", "--ros2")
    assert done.status == 2
    told = "messages of ROS 2 have no times after January 2038: leave out --ros2"
    assert told in done.complaint


@pytest.mark.parametrize(
    ("said", "complaint"),
    [
        ("[[joint]]\nservo = 1\n", "joint 1 has no name"),
        ("[[joint]]\nname = 'a'\n", "joint 1 has no servo"),
        ("[[joint]]\nservo = 300\nname = 'a'\n", "servo = 300: it must be an id of 0..255"),
        ("[[joint]]\nservo = 1\nname = 'a'\nsing = -1\n", "did you mean sign?"),
        ("[[joint]]\nservo = 1\nname = 'a'\nsign = 2\n", "sign = 2: it must be 1 or -1"),
        ("[[joint]]\nservo = 1\nname = 'a'\nscale = 0\n", "every place would be the same"),
        ("[[joint]]\nservo = 1\nname = 'a'\noffset = nan\n", "offset = nan: it must be a number"),
        ("[[joint]]\nservo = 1\nname = ''\n", "name = '': it must be a text"),
        ("[joint]\nservo = 1\n", "write a table [[joint]] for each joint"),
        ("[[joint]]\nservo = 1\nname = 'a'\n" * 2, "servo 1 of bus0 is both a and a"),
        (
            "[[joint]]\nservo = 1\nname = 'a'\n[[joint]]\nservo = 2\nname = 'a'\n",
            "two joints are called a",
        ),
        ("joint = ", "is no TOML"),
    ],
)
def test_what_cannot_be_meant_is_refused_with_its_place(
    tmp_path: Path, capsys: Capsys, said: str, complaint: str
) -> None:
    joints = tmp_path / "joints.toml"
    joints.write_text(said)
    done = within(capsys, "convert", LOG, tmp_path / "x.mcap", "--ros2", "--joints", joints)
    assert done.status == 2
    assert complaint in done.complaint
    assert not (tmp_path / "x.mcap").exists()


def test_ros_is_about_recordings_and_joints_about_ros(tmp_path: Path, capsys: Capsys) -> None:
    done = within(capsys, "record", "/dev/null", "-o", tmp_path / "x.csv", "--ros2")
    assert (done.status, "--ros2 is about a recording: -o x.mcap" in done.complaint) == (2, True)
    for arguments, complaint in (
        (("x.csv", "--ros2"), "--ros2 is about a recording: name an .mcap"),
        (("x.mcap", "--joints", "joints.toml"), "--joints goes with --ros2"),
        (("x.mcap", "--ros2", "--joints", tmp_path / "none.toml"), "cannot be read"),
    ):
        done = within(capsys, "convert", LOG, tmp_path / arguments[0], *arguments[1:])
        assert (done.status, complaint in done.complaint) == (2, True)
