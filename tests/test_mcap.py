"""Recordings hold what was heard, and other people's tools read them."""

from __future__ import annotations

import bisect
import dataclasses
import itertools
import json
import math
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory

from sniffer.decoding.decoder import Decoder
from sniffer.ground.codes import OK
from sniffer.ground.model import (
    NS,
    Batch,
    Chunk,
    Clock,
    Direction,
    InputError,
    Mark,
    MarkKind,
    OutputError,
)
from sniffer.ground.registers import schema_path
from sniffer.mcapfile.container import Container
from sniffer.mcapfile.fields import state_field
from sniffer.mcapfile.sink import McapSink
from sniffer.mcapfile.source import chunks, groups, recorded, session
from sniffer.messages.log_pb2 import Log
from sniffer.messages.recording_pb2 import Anomaly, Frame, Gap, Kind, Stats, Transaction
from sniffer.messages.recording_pb2 import Direction as DirectionMessage
from sniffer.messages.servo_state_pb2 import ServoState
from sniffer.protocols import PROTOCOLS
from sniffer.sources import open_source
from tests.lists import in_turn
from tests.recordings import START_NS, heads, keep, messages, record, talk

if TYPE_CHECKING:
    from sniffer.ground.columnar import Columns
    from sniffer.protocols.base import BusProtocol

RERUN = shutil.which("rerun", path=str(Path(sys.executable).parent))
EVERY = pytest.mark.parametrize("name", PROTOCOLS)

any_mark = st.builds(
    Mark,
    st.sampled_from(MarkKind),
    st.integers(-(1 << 40), 1 << 40),
    st.integers(0, 1 << 40),
    st.integers(0, 1 << 50),
)
any_chunk = st.builds(
    Chunk,
    st.binary(max_size=40),
    st.none() | st.integers(0, 1 << 61) | st.integers(START_NS, START_NS + 1000) | st.just(-5),
    st.sampled_from(Clock),
    st.sampled_from(["bus0", "arm/left", "Über bus"]),
    st.sampled_from(Direction),
    st.just(()) | st.lists(any_mark, max_size=3).map(tuple),
)


@given(st.lists(st.lists(any_chunk, max_size=12), max_size=4), st.sampled_from([0, 10**9]))
def test_chunks_of_every_clock_direction_and_bus_come_back_as_they_went_in_with_their_marks(
    parts: list[list[Chunk]], flush_ns: int
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        keep(path, parts, flush_ns=flush_ns)
        back = list(chunks(path))
        found = heads(path)
        log = [m.log_time for m in found]
    sent = [c for part in parts for c in part]
    for bus in {c.bus for c in sent}:
        assert [c for c in back if c.bus == bus] == [c for c in sent if c.bus == bus]
    assert len(back) == len(sent)
    assert log == sorted(log)
    for channel in {m.channel_id for m in found}:
        numbers = [m.sequence for m in found if m.channel_id == channel]
        assert numbers == list(range(len(numbers)))


@in_turn(2)
@EVERY
def test_messages_are_those_that_are_encoded_one_by_one(name: str, tmp_path: Path) -> None:
    sent = talk(name, 2.0)
    batches = record(tmp_path / "run.mcap", name, sent)
    found = messages(tmp_path / "run.mcap")
    wanted = expected(PROTOCOLS[name], batches, sent)
    assert found.keys() - {"/bus0/raw", "/bus0/stats"} == wanted.keys()
    for topic, rows in wanted.items():
        got = found[topic]
        if topic in ("/bus0/anomalies", "/bus0/log"):  # of one time, they may stand in any order
            got, rows = sorted(got, key=str), sorted(rows, key=str)
        assert got == rows, topic
    assert len(found["/bus0/frames"]) > 100
    assert found["/bus0/gaps"]
    assert sum(s.frames for s in found["/bus0/stats"]) == len(found["/bus0/frames"])
    assert sum(s.bytes for s in found["/bus0/stats"]) == sum(len(c.data) for c in sent)
    assert list(chunks(tmp_path / "run.mcap")) == sent


def expected(
    protocol: BusProtocol, batches: list[Batch], sent: list[Chunk]
) -> dict[str, list[Any]]:
    """Encode batches the plain way: one message object a row, states joined read by read."""
    out: dict[str, list[Any]] = {}
    ends = list(itertools.accumulate(len(c.data) for c in sent))
    reads: dict[str, int] = {}

    def add(topic: str, message: Any) -> None:
        out.setdefault(f"/bus0/{topic}", []).append(message)

    for b in batches:
        frames, names, took = b.frames, b.frames.__slots__, {}
        for q, r, outcome, time, spread in rows_of(b.transactions):
            row = max(q, 0) if q >= 0 else r
            t = Transaction(outcome=outcome, op=protocol.op_name(int(frames.op[row])))
            set_if(t, "request_offset", b.base + int(frames.start[q]), q >= 0)
            set_if(t, "response_offset", b.base + int(frames.start[r]), r >= 0)
            set_if(t, "servo_id", int(frames.servo_id[row]), frames.servo_id[row] >= 0)
            set_if(t, "response_time_ns", time, time >= 0)
            set_if(t, "response_time_ms", time / 1e6, time >= 0)
            set_if(t, "uncertainty_ns", spread, spread >= 0)
            add("transactions", t)
            if outcome == OK and time >= 0:
                took[r] = time
        for i in range(len(frames)):
            column: Any = {n: int(getattr(frames, n)[i]) for n in names}
            f = Frame(
                t_start_ns=column["t_start"],
                t_end_ns=column["t_end"],
                offset=b.base + column["start"],
                length=column["length"],
                kind=Kind.Name(column["kind"]),
                op=protocol.op_name(column["op"]),
                op_code=column["op"],
                flags=column["flags"],
                direction=DirectionMessage.Name(column["direction"]),
                data=b.data[column["start"] : column["start"] + column["length"]],
            )
            set_if(f, "uncertainty_ns", column["uncertainty"], column["uncertainty"] >= 0)
            for n in ("servo_id", "address", "status"):
                set_if(f, n, column[n], column[n] >= 0)
            add("frames", f)
        for (row, servo), values in itertools.groupby(rows_of(b.values), lambda v: (v[8], v[1])):
            state: Any = ServoState(offset=b.base + int(frames.start[row]))
            state.kind = int(frames.kind[row])
            empty = True
            for value in values:
                field = state_field(protocol.registers[value[2]])
                if value[9] and field is not None and not math.isnan(value[5]):
                    kind = type(getattr(state, field))
                    setattr(state, field, kind(value[5]))
                    empty = False
            set_if(state, "response_time_ns", took.get(row, 0), row in took)
            set_if(state, "response_time_ms", took.get(row, 0) / 1e6, row in took)
            if empty:
                continue
            topic = f"servo/{servo}/state"
            read = bisect.bisect_left(ends, b.base + int(frames.end[row]))
            before = out.get(f"/bus0/{topic}", [])[-1:]
            if read == reads.get(topic) and not fields_of(before[0]) & fields_of(state):
                before[0].MergeFrom(state)
                before[0].offset, before[0].kind = state.offset, state.kind
            else:
                add(topic, state)
            reads[topic] = read
        for g in b.gaps:
            data, detail = b.data[g.start : g.start + g.length], json.dumps(dict(g.detail))
            at: Any = {"offset": b.base + g.start, "length": g.length, "data": data}
            add("gaps", Gap(t_ns=g.t_ns, reason=g.reason, detail=detail, **at))
        for a in sorted(b.anomalies, key=lambda a: a.t_ns):
            m: Any = Anomaly(t_ns=a.t_ns, group=a.group, code=a.code, detail=a.detail)
            m.severity = int(a.severity)
            m.evidence.extend(Anomaly.Evidence(offset=o, length=n) for o, n in a.evidence)
            set_if(m, "servo_id", a.servo_id, a.servo_id is not None)
            add("anomalies", m)
            who = "" if a.servo_id is None else f"servo {a.servo_id}: "
            who = "" if who and re.search(rf"\b{who[:-2]}\b", a.detail) else who
            log: Any = Log(name="bus0", message=f"{who}{a.detail} [{a.code}]")
            log.level = 2 + int(a.severity)
            log.timestamp.FromNanoseconds(a.t_ns)
            add("log", log)
    return out


def rows_of(columns: Columns) -> Any:
    names = [f.name for f in dataclasses.fields(columns)]
    return zip(*(getattr(columns, n).tolist() for n in names), strict=True)


def fields_of(state: Any) -> set[str]:
    return {field.name for field, _ in state.ListFields()} - {"offset", "kind"}


def set_if(message: Any, name: str, value: Any, condition: object) -> None:
    if condition:
        setattr(message, name, value)


def test_the_schemas_in_the_file_decode_it_and_what_a_packet_did_not_carry_is_absent(
    tmp_path: Path,
) -> None:
    record(tmp_path / "run.mcap", "mightyzap", talk("mightyzap"))
    seen: dict[str, list[Any]] = {}
    with (tmp_path / "run.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages():
            seen.setdefault(channel.topic.rpartition("/")[2], []).append(message)
    assert seen.keys() == {
        *("raw", "frames", "transactions", "state", "gaps", "anomalies", "log", "stats")
    }
    for state in seen["state"]:
        named = {f.name for f, _ in state.ListFields()} - {"offset", "kind"}
        named -= {"response_time_ns", "response_time_ms"}
        assert named
        assert state.HasField("position_mm") == ("position_mm" in named)
    carried = [s.HasField("position_mm") for s in seen["state"]]
    assert any(carried)
    assert not all(carried)
    assert all(f.HasField("status") == (f.kind == Kind.RESPONSE) for f in seen["frames"])


def test_times_never_decrease_within_the_file_nor_within_a_topic(tmp_path: Path) -> None:
    sent = talk("mightyzap", 2.0)
    # a clock that was set back, and one that jumps
    sent[60:] = [Chunk(c.data, (c.t_ns or 0) - 3 * NS, c.clock) for c in sent[60:]]
    sent[300:] = [Chunk(c.data, (c.t_ns or 0) + 9 * NS, c.clock) for c in sent[300:]]
    record(tmp_path / "run.mcap", "mightyzap", sent)
    found = heads(tmp_path / "run.mcap")
    assert [m.log_time for m in found] == sorted(m.log_time for m in found)
    for channel in {m.channel_id for m in found}:
        mine = [m for m in found if m.channel_id == channel]
        assert [m.publish_time for m in mine] == sorted(m.publish_time for m in mine)
        assert [m.sequence for m in mine] == list(range(len(mine)))
    assert list(chunks(tmp_path / "run.mcap")) == sent


def test_buses_that_are_converted_one_after_the_other_keep_their_times(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sniffer.mcapfile.sink.FULL", 1000)
    sink = McapSink(tmp_path / "run.mcap", {}, flush_ns=0)
    # a hundred times as slow as it is said: on the busiest machine it is heard faster than that
    buses = {
        name: [
            dataclasses.replace(c, t_ns=START_NS + 100 * ((c.t_ns or 0) - START_NS))
            for c in talk("mightyzap", 6.0, seed, 0, name)
        ]
        for seed, name in enumerate("ab")
    }
    decoders = {name: Decoder("mightyzap") for name in buses}
    for part in range(3):
        for name, sent in buses.items():
            group = [c for c in sent if ((c.t_ns or 0) - START_NS) // (200 * NS) == part]
            sink.raw(name, group)
            sink.write(name, PROTOCOLS["mightyzap"], decoders[name].feed(*group))
    sink.close()
    with (tmp_path / "run.mcap").open("rb") as stream:
        reader = make_reader(stream)
        for _, channel, message in reader.iter_messages(topics=["/a/raw", "/b/raw"]):
            assert message.log_time == buses[channel.topic[1]][message.sequence].t_ns
        summary = reader.get_summary()
    assert summary is not None
    assert len(summary.chunk_indexes) >= 3


@pytest.mark.skipif(RERUN is None, reason="the rerun program is not installed")
def test_rerun_reads_a_recording_and_finds_no_problem(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    sink = McapSink(path, {})
    buses = [(n, talk(n, 2.0, bus=n), Decoder(n)) for n in PROTOCOLS]
    for i in range(0, max(len(c) for _, c, _ in buses), 64):
        for name, sent, decoder in buses:
            sink.raw(name, sent[i : i + 64])
            sink.write(name, decoder.protocol, decoder.feed(*sent[i : i + 64]))
    for name, _, decoder in buses:
        sink.write(name, decoder.protocol, decoder.close())
    sink.close()
    told = rerun("info", str(path))
    assert "Summary                  embedded" in told
    assert "Overlapping time ranges  no" in told
    checked = rerun("check", "--full", str(path))
    assert "PROBLEM" not in checked
    assert checked.count("\nok ") == len(messages(path))


def rerun(*arguments: str) -> str:
    command = [str(RERUN), "mcap", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_frames_are_listed_as_they_were_recorded_and_the_session_is_told(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    batches = record(path, "mightyzap", talk("mightyzap", rate=0.0))
    frames = list(recorded(path))
    assert [f.offset for f in frames] == [b.base + s for b in batches for s in b.frames.start]
    assert {f.op for f in frames} >= {"load_data", "store_data"}
    assert {f.kind for f in frames} == {"request", "response"}
    assert session(path) == {"tool": "test", "protocol.bus0": "mightyzap", "baud.bus0": "57600"}
    assert open_source(path).format == "mcap"
    with path.open("rb") as stream:
        attached = {a.name: a.data for a in make_reader(stream).iter_attachments()}
    table = "registers/mightyzap-l12.toml"
    assert attached[table] == schema_path(table).read_bytes()
    assert (
        attached["messages/recording.proto"]
        == schema_path("messages", "recording.proto").read_bytes()
    )


def test_a_silent_stretch_has_a_row_of_statistics_at_each_end(tmp_path: Path) -> None:
    sent = talk("mightyzap", 1.0, rate=0)
    later = [Chunk(c.data, (c.t_ns or 0) + 60 * NS, c.clock) for c in sent]
    record(tmp_path / "run.mcap", "mightyzap", sent + later)
    rows: list[Stats] = messages(tmp_path / "run.mcap")["/bus0/stats"]
    start = START_NS // NS
    seconds = [r.t_ns // NS - start for r in rows]
    assert [s for s, r in zip(seconds, rows, strict=True) if not r.frames] == [1, 59]
    busy = rows[0]
    assert busy.bus_load_percent == pytest.approx(busy.bytes * 10 / 57600 * 100, rel=1e-3)


def test_large_groups_are_cut_into_chunks_of_about_a_megabyte(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent = talk("mightyzap", 2.0, rate=0) * 30
    sent = [Chunk(c.data) for c in sent]
    record(tmp_path / "run.mcap", "mightyzap", sent, size=len(sent), flush_ns=NS * 3600)
    with (tmp_path / "run.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert len(summary.chunk_indexes) > 2
    assert max(c.uncompressed_size for c in summary.chunk_indexes) < 1_100_000
    sizes = [sum(len(c.data) for c in group) for group in groups(tmp_path / "run.mcap")]
    assert sizes[0] < 300_000

    def alone(*args: Any, **options: Any) -> Container:
        return Container(*args, **{**options, "beside": False})

    monkeypatch.setattr("sniffer.mcapfile.sink.Container", alone)
    record(tmp_path / "alone.mcap", "mightyzap", sent, size=len(sent), flush_ns=NS * 3600)
    beside = (tmp_path / "run.mcap").read_bytes()
    assert beside == (tmp_path / "alone.mcap").read_bytes(), "packed beside or not"


def test_an_mcap_of_somebody_else_is_refused_with_its_topics(tmp_path: Path) -> None:
    path = tmp_path / "robot.mcap"
    for chunked in (True, False):
        writer = Writer(str(path), use_chunking=chunked)
        writer.start()
        channel = writer.register_channel("/imu", "json", writer.register_schema("Imu", "", b""))
        writer.add_message(channel, 1, b"{}", 1)
        writer.finish()  # type: ignore[no-untyped-call]
        with pytest.raises(InputError, match=r"no recording of this tool.*/imu"):
            list(chunks(path))
    path.write_bytes(b"no mcap at all")
    with pytest.raises(InputError, match=r"robot\.mcap"):
        list(chunks(path))
    with pytest.raises(InputError, match="cannot be read"):
        list(chunks(tmp_path / "missing.mcap"))


def test_a_file_that_is_there_is_replaced_only_where_allowed(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(b"precious")
    with pytest.raises(OutputError, match="is there already"):
        McapSink(path, {}, overwrite=False)
    assert path.read_bytes() == b"precious"
    McapSink(path, {}).close()
    assert list(chunks(path)) == []
    with pytest.raises(OutputError, match="no folder"):
        McapSink(tmp_path / "none" / "run.mcap", {})
