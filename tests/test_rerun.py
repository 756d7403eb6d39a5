"""What people see in Rerun: read back from the file, and looked at in a real viewer."""

from __future__ import annotations

import io
import math
import struct
import subprocess
import sys
import time
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest
import rerun as rr
from PIL import Image
from rerun.chunk import RrdReader

from sniffer.decoding.decoder import Decoder
from sniffer.ground.colours import PALETTE, Colours
from sniffer.ground.model import Chunk, Clock, OutputError
from sniffer.sinks.rerun.gauges import MARKS
from sniffer.sinks.rerun.sink import RerunSink
from tests.commands import sniffer
from tests.streams.mightyzap import packet
from tests.terminals import PATIENCE_S

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.model import Batch
    from tests.viewer import HeadlessViewer

LOAD, STORE, SYMMETRIC_STORE = 0xF2, 0xF3, 0x73
START_NS: Final = 1_795_000_000_000_000_000
TICK_NS: Final = 2_000_000_000
OVERLOAD: Final = 0x20


class Bus:
    """Talk with arrival times: ``chunks`` is what a logic analyser would have seen."""

    def __init__(self) -> None:
        self.chunks: list[Chunk] = []
        self.now_ns = START_NS

    def say(self, data: bytes, pause_ns: int = 200_000) -> None:
        self.now_ns += pause_ns + len(data) * 40_000
        self.chunks.append(Chunk(data, self.now_ns, Clock.SAMPLE))

    def ask(self, servo: int, address: int, reply: bytes, status: int = 0) -> None:
        self.say(packet(servo, LOAD, bytes([address, len(reply)])))
        self.say(packet(servo, status, reply))


def talk(servos: Sequence[int] = (1, 2), ticks: int = 60, limp: int = -1) -> list[Chunk]:
    """Sines with goals sent to all at once, some overload, one damaged reply; one may hang limp."""
    bus = Bus()
    bus.say(packet(servos[0], STORE, b"\x80\x01"))
    bus.say(packet(servos[0], 0))
    for tick in range(ticks):
        bus.now_ns = max(bus.now_ns, START_NS + tick * TICK_NS)
        at = [2000 + 1000 * math.sin(tick / 9 + servo) for servo in servos]
        goals = b"".join(struct.pack("<BH", s, int(x)) for s, x in zip(servos, at, strict=True))
        bus.say(packet(254, SYMMETRIC_STORE, b"\x86\x02" + goals))
        for servo, x in zip(servos, at, strict=True):
            overload = OVERLOAD if servo == servos[-1] and 20 <= tick < 40 else 0
            place = 300 if servo == limp else int(x) - 90
            motion = struct.pack("<HHHBB", place, 1100, 300, 118 + servo % 3, 30 + servo % 9)
            bus.ask(servo, 0x8C, motion, overload)
            bus.ask(servo, 0x96, bytes([tick // 10 % 2]), overload)
        if tick == 30:
            bus.say(packet(servos[0], LOAD, b"\x8c\x02"))
            bus.say(packet(servos[0], 0, b"\x10\x10")[:-1] + b"\x00")
    return bus.chunks


def write(path: Path, chunks: Sequence[Chunk], bus: str = "bus0") -> list[Batch]:
    """Decode into a file, in several passes as the command does; return the batches."""
    decoder, sink = Decoder("mightyzap", baud=250_000), RerunSink(path)
    batches = [decoder.feed(*chunks[k : k + 100]) for k in range(0, len(chunks), 100)]
    batches.append(decoder.close())
    for batch in batches:
        sink.write(bus, decoder.protocol, batch)
    sink.close()
    return batches


def read(path: Path) -> tuple[dict[str, list[tuple[Any, ...]]], dict[str, dict[str, Any]]]:
    """Return what a .rrd holds by entity: rows of (time in ns, value, ...), and what is static."""
    rows: dict[str, list[tuple[Any, ...]]] = defaultdict(list)
    static: dict[str, dict[str, Any]] = defaultdict(dict)
    for chunk in RrdReader(str(path)).stream():
        batch = chunk.to_record_batch()
        columns = {n: batch.column(n).to_pylist() for n in batch.schema.names if ":" in n}
        if chunk.is_static:
            static[chunk.entity_path] |= {name: values[0] for name, values in columns.items()}
        else:
            times = batch.column("time").cast("int64").to_pylist()
            values = ([v[0] for v in columns[name]] for name in sorted(columns))
            rows[chunk.entity_path] += zip(times, *values, strict=True)
    return rows, static


def is_register(entity: str) -> bool:
    """Tell whether an entity holds what a servo stated, not what was reckoned."""
    reckoned = ("response_time", "following_error", "missing_answers", "bus_load")
    return not entity.endswith(reckoned) and "/marks/" not in entity


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Batch]]:
    path = tmp_path_factory.mktemp("rerun") / "two servos.rrd"
    return path, write(path, talk())


def test_what_is_read_back_equals_the_samples(recording: tuple[Path, list[Batch]]) -> None:
    path, batches = recording
    registers = Decoder("mightyzap").protocol.registers
    expected = defaultdict(list)
    for batch in batches:
        s = batch.samples
        for i in range(len(s)):
            register = registers[s.register[i]]
            if not register.values:
                entity = f"/bus0/servo/{s.servo_id[i]}/{register.name}"
                expected[entity].append((int(s.t_ns[i]), float(s.value[i])))
    rows, _ = read(path)
    assert len(expected) == 2 * 6
    lines = {e for e in rows if isinstance(rows[e][0][1], float) and not e.endswith("/held")}
    assert {e for e in lines if is_register(e)} == expected.keys()
    for entity, samples in expected.items():
        assert rows[entity] == samples


def test_response_times_are_those_of_answered_requests(
    recording: tuple[Path, list[Batch]],
) -> None:
    path, batches = recording
    expected = []
    for batch in batches:
        t = batch.transactions
        known = (t.outcome == 0) & (t.response_time_ns >= 0)
        mine = known & (batch.frames.servo_id[t.response] == 1)
        expected += [ns / 1e6 for ns in t.response_time_ns[mine].tolist()]
    rows, _ = read(path)
    assert [ms for _, ms in rows["/bus0/servo/1/response_time"]] == expected
    assert min(expected) == pytest.approx(0.2)


def test_a_packet_without_a_value_adds_no_zero(tmp_path: Path) -> None:
    bus = Bus()
    for _ in range(5):
        bus.ask(1, 0x92, b"\x78")  # voltage
        bus.ask(1, 0x8C, b"\x10")  # half a position, and no voltage
        bus.ask(1, 0x8C, b"\x10\x08")
    bus.say(packet(1, STORE, b"\x16\x09"))  # a resolution that the manual does not have
    bus.ask(1, 0x8C, b"\x10\x08")
    write(tmp_path / "a.rrd", bus.chunks)
    rows, _ = read(tmp_path / "a.rrd")
    assert [v for _, v in rows["/bus0/servo/1/present_voltage"]] == pytest.approx([12.0] * 5)
    positions = [v for _, v in rows["/bus0/servo/1/present_position"]]
    assert len(positions) == 5
    assert min(positions) > 10


def test_states_and_alarms_are_kept_only_where_they_change(
    recording: tuple[Path, list[Batch]],
) -> None:
    rows, static = read(recording[0])
    assert [state for _, state in rows["/bus0/servo/2/alarms"]] == ["none", "overload", "none"]
    assert [state for _, state in rows["/bus0/servo/1/alarms"]] == ["none"]
    assert [state for _, state in rows["/bus0/servo/1/moving"]] == ["completed", "moving"] * 3
    assert [state for _, state in rows["/bus0/servo/1/force_on"]] == ["on"]
    assert static["/bus0/servo/2/alarms"]["StateConfiguration:values"] == ["none", "overload"]


def test_anomalies_are_logged_with_their_severity(recording: tuple[Path, list[Batch]]) -> None:
    path, batches = recording
    anomalies = [a for batch in batches for a in batch.anomalies]
    rows, _ = read(path)
    assert [(a.t_ns, a.code) for a in anomalies] == [
        (t, text.split()[1].rstrip(":")) for t, _, text in rows["/bus0/anomalies"]
    ]
    levels = {text.split()[1].rstrip(":"): level for _, level, text in rows["/bus0/anomalies"]}
    assert levels["bad-checksum"] == "ERROR"
    assert levels["device-recovered"] == "INFO"


def test_a_servo_has_one_colour_in_all_plots(recording: tuple[Path, list[Batch]]) -> None:
    _, static = read(recording[0])
    colours: dict[tuple[int, bool], set[int]] = defaultdict(set)
    names: dict[tuple[int, bool], set[str]] = defaultdict(set)
    for entity, style in static.items():
        if "SeriesLines:colors" in style and is_register(entity):
            key = int(entity.split("/")[3]), "goal" in entity
            colours[key] |= set(style["SeriesLines:colors"])
            names[key] |= set(style["SeriesLines:names"])
    assert names[2, False] == {"servo 2"}
    assert names[2, True] == {"servo 2 goal"}
    assert {key: len(found) for key, found in colours.items()} == dict.fromkeys(names, 1)
    assert len({next(iter(found)) for found in colours.values()}) == 4


def test_two_dozen_servos_have_as_many_colours() -> None:
    many, few = Colours(), Colours()
    assert len({many.of(servo) for servo in range(1, 25)}) == len(PALETTE) == 24
    assert (few.of(25), few.of(1), few.of(25)) == (PALETTE[0], PALETTE[1], PALETTE[0])


def test_the_viewer_opens_at_the_first_error_without_complaint(
    recording: tuple[Path, list[Batch]], headless_viewer: HeadlessViewer
) -> None:
    state = headless_viewer.show(recording[0])
    assert headless_viewer.complaints() == []
    assert {view.name for view in state.views} == {
        *("Position [mm]", "Speed [raw]", "Load [raw]", "Voltage [V]", "Temperature [°C]"),
        *("Response time [ms]", "States", "Anomalies", "Following error [mm]", "Bus load [%]"),
        "Largest following error in each second [mm]",
        *(f"servo {n}: {what} [mm]" for n in (1, 2) for what in ("position", "following error")),
    }
    plot = Image.open(io.BytesIO(headless_viewer.picture("Position [mm]"))).convert("RGB")
    pixels = np.asarray(plot).astype(int)
    for servo in (1, 2):
        drawn = np.abs(pixels - PALETTE[servo - 1]).sum(axis=2) < 30
        columns = np.flatnonzero(drawn[:, 150:].any(axis=0)) + 150  # right of the legend
        assert columns[-1] > 0.9 * plot.width
        assert 0.1 * plot.width < len(columns) < 0.9 * plot.width  # steps, not ink
    marks = np.abs(pixels - MARKS["error"][0]).sum(axis=2) < 30
    ((left, right),) = [np.flatnonzero(marks[:, 150:].any(axis=0))[[0, -1]] + 150]
    assert 0.2 * plot.width < left <= right < 0.5 * plot.width


def test_many_servos_have_a_tab_for_all_and_tabs_for_a_few(
    tmp_path: Path, headless_viewer: HeadlessViewer
) -> None:
    write(tmp_path / "many.rrd", talk(range(1, 9), ticks=16, limp=5))
    state = headless_viewer.show(tmp_path / "many.rrd")
    assert headless_viewer.complaints() == []
    names = [view.name for view in state.views]
    assert [names.count(name) for name in ("Position [mm]", "Speed [raw]")] == [1, 2]
    # the curves of so many cannot be told apart: who hangs limp is named, and of times the largest
    assert names.count("Largest following error in each second [mm], most: servo 5") == 1
    assert names.count("Largest response time in each second [ms]") == 1
    assert names.count("Response time [ms]") == 2
    for servo in range(1, 9):
        assert names.count(f"servo {servo}: following error [mm]") == 1


def test_a_live_view_grows_when_a_quantity_appears(headless_viewer: HeadlessViewer) -> None:
    client = headless_viewer.client
    if client.get_state().recordings:
        client.close("all")
    live = rr.RecordingStream("sniffer live test")
    live.connect_grpc(client.url)
    sink, decoder, bus = RerunSink(recording=live), Decoder("mightyzap", baud=250_000), Bus()
    expected = {"Position [mm]", "Response time [ms]"}
    for address, reply, appears in ((0x8C, b"\x10\x08", set()), (0x92, b"\x78", {"Voltage [V]"})):
        bus.ask(1, address, reply)
        bus.say(packet(1, STORE, b"\x86\x10\x08"))
        bus.say(packet(1, 0))
        sink.write("bus0", decoder.protocol, decoder.feed(*bus.chunks))
        bus.chunks.clear()
        live.flush()
        expected |= appears
        deadline = time.monotonic() + PATIENCE_S
        while (seen := {view.name for view in client.get_state().views}) != expected:
            assert time.monotonic() < deadline, seen
            client.take_screenshot(max_size=64)
    sink.close()
    live.disconnect()


@pytest.mark.parametrize("told", ["2=left knee", "names.toml"])
def test_servos_are_called_by_the_names_that_are_told_and_recorded(
    told: str, tmp_path: Path
) -> None:
    path = tmp_path / "talk.bin"
    path.write_bytes(b"".join(chunk.data for chunk in talk(ticks=5)))
    (tmp_path / "names.toml").write_text('[names]\n2 = "left knee"\n')
    name = str(tmp_path / told) if told.endswith(".toml") else told
    recorded, plots = tmp_path / "talk.mcap", tmp_path / "talk.rrd"
    assert sniffer("decode", path, "--quiet", "--name", name, "-o", recorded).status == 0
    assert sniffer("view", recorded, "-o", plots).status == 0
    rows, static = read(plots)
    entity = "/bus0/servo/2_left_knee/present_position"
    assert entity in rows, sorted(rows)
    assert static[entity]["SeriesLines:names"] == ["left knee (2)"]


@pytest.mark.parametrize("told", ["300=knee", "3=", "knee", "3=a\tb"])
def test_a_name_that_cannot_be_is_refused_in_a_line(told: str, tmp_path: Path) -> None:
    done = sniffer("decode", "-", "--name", told)
    assert done.status == 2
    assert "ID=NAME" in done.err


def test_an_input_without_times_counts_from_zero(tmp_path: Path) -> None:
    write(tmp_path / "a.rrd", [Chunk(chunk.data) for chunk in talk(ticks=3)])
    rows, _ = read(tmp_path / "a.rrd")
    assert 0 < rows["/bus0/servo/1/present_position"][0][0] < 1_000_000_000
    assert "/bus0/servo/1/response_time" not in rows


@pytest.mark.parametrize("data", [b"\x00" * 40, packet(1, LOAD, b"\x00\x04") * 2])
def test_an_input_without_values_makes_a_file_that_opens(
    data: bytes, tmp_path: Path, headless_viewer: HeadlessViewer
) -> None:
    write(tmp_path / "a.rrd", [Chunk(data)])
    headless_viewer.show(tmp_path / "a.rrd")
    assert headless_viewer.complaints() == []


def test_no_input_at_all_makes_an_empty_file(tmp_path: Path) -> None:
    write(tmp_path / "a.rrd", [])
    assert read(tmp_path / "a.rrd")[0] == {}


def test_each_file_has_a_layout_of_its_own_in_a_viewer_that_stays_open(tmp_path: Path) -> None:
    names = set()
    for folder in (tmp_path / "a", tmp_path / "b"):
        folder.mkdir()
        write(folder / "run.rrd", talk(ticks=2))
        names.add(RrdReader(str(folder / "run.rrd")).recordings()[0].application_id)
    assert len(names) == 2


def test_a_file_that_cannot_be_written_is_an_output_error(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="no folder"):
        RerunSink(tmp_path / "none" / "a.rrd")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full, a disk that is full")
def test_a_full_disk_is_an_output_error() -> None:
    with pytest.raises(OutputError, match="No space left"):
        write(Path("/dev/full"), talk(ticks=2))


def test_rerun_is_not_imported_before_a_sink_is_made() -> None:
    ours = "sniffer.sinks.rerun.sink, sniffer.viewers.viewer"
    code = f"import sys, {ours}; sys.exit('rerun' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("name", ["run.v1", "r\u00fcn (2)", "x" * 200])
def test_the_name_of_an_output_draws_no_warning_of_the_viewer(name: str, tmp_path: Path) -> None:
    path = tmp_path / "talk.bin"
    path.write_bytes(b"".join(chunk.data for chunk in talk()))
    done = sniffer("decode", path, "--quiet", "-o", tmp_path / f"{name}.rrd")
    assert (done.status, done.err) == (0, "")
