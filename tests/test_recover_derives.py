"""What a killed recorder had no time to make of its last bytes: ``recover`` makes it of them."""

from __future__ import annotations

import random
import re
import threading
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest
from mcap.reader import make_reader

import sniffer
from bench.survives import KINDS, Victim, kill
from sniffer.decoding.decoder import Decoder
from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.ground.model import Chunk, DamagedInputError, InputError, OutputError
from sniffer.mcapfile import recover as recovering
from sniffer.mcapfile import tail
from sniffer.mcapfile.joints import RosJoint, joints_in
from sniffer.mcapfile.recover import recover
from sniffer.mcapfile.ros2 import ANOMALIES, JOINTS
from sniffer.mcapfile.sink import McapSink
from sniffer.mcapfile.source import groups, session
from sniffer.messages.recording_pb2 import Stats
from tests.lists import each_in_turn, thinned, walks_a_list
from tests.recordings import messages, talk
from tests.terminals import LINUX_ONLY, PATIENCE_S

if TYPE_CHECKING:
    from pathlib import Path

DERIVED = ("frames", "transactions", "state", "gaps", "anomalies", "log", "stats")


def anew(path: Path, out: Path) -> Path:
    """Decode the raw bytes of a recording, as far as it goes, into another one."""
    facts = session(path)
    bauds = {key: value for key, value in facts.items() if key.startswith("baud.")}
    sink = McapSink(out, bauds, joints=joints_in(facts))
    pipeline = Pipeline(Options().with_facts(facts), [sink])
    try:
        for group in groups(path):
            pipeline.feed(group)
    except DamagedInputError:
        pass
    pipeline.close()
    pipeline.finish()
    return out


def derived(path: Path) -> dict[str, list[bytes]]:
    """Return what was made of the raw bytes: by topic the messages, in any order."""
    found = messages(path)
    return {
        topic: sorted(bytes(m.SerializeToString(deterministic=True)) for m in rows)
        for topic, rows in found.items()
        if topic.rpartition("/")[2] in DERIVED
    }


def but_for_late_anomalies(path: Path) -> tuple[dict[str, list[bytes]], dict[str, int]]:
    """Return the same without the anomalies of each second, and how many they are in all.

    One that is known late counts in the oldest second that is not written (``Seconds.count``): in
    which of two depends on when a live recorder wrote.
    """
    found, totals = derived(path), {}
    for topic in [topic for topic in found if topic.endswith("/stats")]:
        rows = [Stats.FromString(row) for row in found[topic]]
        totals[topic] = sum(row.anomalies for row in rows)
        for row in rows:
            row.ClearField("anomalies")
        found[topic] = sorted(bytes(row.SerializeToString(deterministic=True)) for row in rows)
    return found, totals


def in_words_of_ros(path: Path) -> dict[str, list[tuple[int, bytes]]]:
    """Return what ROS 2 is told: by topic the times and messages, in any order."""
    out: dict[str, list[tuple[int, bytes]]] = {}
    with path.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages([JOINTS, ANOMALIES]):
            out.setdefault(channel.topic, []).append((message.publish_time, message.data))
    return {topic: sorted(rows) for topic, rows in out.items()}


def recorded(path: Path, **options: Any) -> list[int]:
    """Record two buses live, all they say; return how long the file was after each round."""
    sizes: list[int] = []
    buses = {"b0": "mightyzap", "b1": "lss"}
    facts = {f"protocol.{bus}": name for bus, name in buses.items()}
    facts |= {f"baud.{bus}": "115200" for bus in buses}
    sink = McapSink(path, {"tool": "test", **facts}, live=True, flush_ns=0, **options)
    decoders = {bus: Decoder(name, baud=115200) for bus, name in buses.items()}
    said = {bus: talk(name, 1.5, 3, bus=bus) for bus, name in buses.items()}
    for n in range(0, max(map(len, said.values())), 25):
        for bus, chunks in said.items():
            sink.raw(bus, chunks[n : n + 25])
        sink.flush()
        for bus, chunks in said.items():
            sink.write(bus, decoders[bus].protocol, decoders[bus].feed(*chunks[n : n + 25]))
        sink.flush()
        sizes.append(sink.size)
    sink.close()
    return sizes


@walks_a_list
def test_a_file_cut_anywhere_has_all_records_of_its_bytes_again(tmp_path: Path) -> None:
    whole = tmp_path / "whole.mcap"
    sizes = recorded(whole)
    data = whole.read_bytes()
    rng = random.Random(5)
    cuts = [rng.randrange(sizes[1], sizes[-1]) for _ in range(12)]
    made = 0
    for n, size in enumerate(thinned(cuts, 2, ends=1)):
        path = tmp_path / f"cut{n}.mcap"
        path.write_bytes(data[:size])
        report = recover(path, path)
        made += report.derived
        assert derived(path) == derived(anew(path, tmp_path / f"anew{n}.mcap")), n
    assert made, "some of them had bytes of which nothing was made"


def test_what_is_said_of_a_servo_with_a_name_is_not_there_twice(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    said, decoder = talk("mightyzap", 3.0, 3), Decoder("mightyzap", baud=115200)
    facts = {"protocol.bus0": "mightyzap", "baud.bus0": "115200", "name.1": "elbow"}
    sink = McapSink(path, facts, live=True, flush_ns=0)
    for n in range(0, len(said), 25):
        sink.raw("bus0", said[n : n + 25])
        sink.write("bus0", decoder.protocol, decoder.feed(*said[n : n + 25]))
        sink.flush()
    before = sink.size
    sink.close()
    path.write_bytes(path.read_bytes()[:before])
    recover(path, path)
    log = [m.message for m in messages(path)["/bus0/log"]]
    assert any("servo 1 elbow " in line for line in log)
    assert not any(re.search(r"servo 1 (?!elbow)", line) for line in log)


@each_in_turn(2, "joints", [(), (RosJoint("b1", 1, "knee", sign=-1, offset=0.25),)])
def test_what_ros_is_told_is_made_again(joints: tuple[RosJoint, ...], tmp_path: Path) -> None:
    whole = tmp_path / "whole.mcap"
    sizes = recorded(whole, joints=joints)
    assert joints_in(session(whole)) == joints
    data = whole.read_bytes()
    rng = random.Random(6)
    made = 0
    for n in range(4):
        path = tmp_path / f"cut{n}.mcap"
        path.write_bytes(data[: rng.randrange(sizes[1], sizes[-1])])
        recover(path, path)
        found, wanted = (in_words_of_ros(p) for p in (path, anew(path, tmp_path / "anew.mcap")))
        assert found == wanted, n
        made += len(found.get(JOINTS, []))
    assert made
    plain = tmp_path / "plain.mcap"
    sniffer.convert(whole, [plain])
    assert joints_in(session(plain)) is None, "what is made of it has none, unless it is asked for"
    before = in_words_of_ros(whole)
    assert recover(whole, whole).derived == 0
    assert in_words_of_ros(whole) == before


def test_a_recording_too_long_to_be_held_gets_only_what_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = tmp_path / "whole.mcap"
    sizes = recorded(whole)
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole.read_bytes()[: sizes[-2] - 1])
    monkeypatch.setattr(tail, "HELD", 60_000)
    assert recover(path, path).derived
    wanted = derived(anew(path, tmp_path / "anew.mcap"))
    assert derived(path) == wanted
    ros = tmp_path / "ros.mcap"
    sizes = recorded(whole, joints=())
    ros.write_bytes(whole.read_bytes()[: sizes[-2] - 1])
    assert recover(ros, ros).derived
    assert in_words_of_ros(ros) == in_words_of_ros(anew(ros, tmp_path / "anew.mcap"))


def test_what_a_recording_was_not_asked_for_is_not_made(tmp_path: Path) -> None:
    whole = tmp_path / "whole.mcap"
    recorded(whole, topics=["raw"])
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole.read_bytes()[:-5000])
    assert recover(path, path).derived == 0
    assert {topic.rpartition("/")[2] for topic in messages(path)} == {"raw"}


def test_a_whole_recording_gets_nothing_more(tmp_path: Path) -> None:
    whole = tmp_path / "whole.mcap"
    recorded(whole)
    before = derived(whole)
    assert recover(whole, whole).derived == 0
    assert derived(whole) == before


def test_a_bus_may_be_called_like_a_topic(tmp_path: Path) -> None:
    whole = tmp_path / "whole.mcap"
    facts = {"tool": "test", "protocol.plots": "lss"}
    sink = McapSink(whole, facts, live=True, flush_ns=0, topics=["frames"])
    decoder, said = Decoder("lss"), talk("lss", 1.5, 2, bus="plots")
    for half in (said[: len(said) // 2], said[len(said) // 2 :]):
        sink.raw("plots", half)
        sink.write("plots", decoder.protocol, decoder.feed(*half))
        sink.flush()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes())
    sink.write("plots", decoder.protocol, decoder.close())
    sink.close()
    recover(cut, cut)
    assert derived(cut) == derived(whole), "none is missing, and none there twice"


@LINUX_ONLY
def test_killed_in_full_flight_its_records_are_whole_after_recover(tmp_path: Path) -> None:
    def ready(victim: Victim) -> bool:
        try:
            return any(map(messages_so_far, victim.files))
        except InputError:  # a file that has only just been made
            return False

    (left,) = kill(tmp_path, KINDS[1:2], 7, ready, PATIENCE_S)
    (path,) = left.files
    report = recover(path, path)
    assert report.why
    again = anew(path, tmp_path / "anew.mcap")
    found, anomalies = but_for_late_anomalies(path)
    assert (found, anomalies) == but_for_late_anomalies(again)
    assert len(found["/b0/frames"]) > 100


def messages_so_far(path: Path) -> bool:
    """Tell whether a file that is being written has some raw bytes."""
    try:
        return any(chunk.data for group in groups(path) for chunk in group)
    except DamagedInputError:
        return False


def test_of_two_protocols_on_one_wire_a_mended_recording_names_both(tmp_path: Path) -> None:
    zap, lss = (talk(name, 1.5, 3, bus="b0") for name in ("mightyzap", "lss"))
    behind_ns = (zap[-1].t_ns or 0) - (lss[0].t_ns or 0) + 1_000_000_000
    said = [*zap, *(replace(c, t_ns=(c.t_ns or 0) + behind_ns) for c in lss)]
    path = tmp_path / "cut.mcap"
    sink = McapSink(path, {"tool": "test", "baud.b0": "115200"}, live=True)
    sink.raw("b0", said)
    sink.flush()
    size = sink.size  # killed here: nothing was made of the bytes, and nobody said what they are
    sink.close()
    path.write_bytes(path.read_bytes()[:size])
    assert recover(path, path).derived
    assert session(path)["protocol.b0"] == "lss+mightyzap"
    found = derived(path)
    assert {topic.split("/")[1] for topic in found} == {"b0.lss", "b0.mightyzap"}
    assert found == derived(anew(path, tmp_path / "anew.mcap"))


def test_a_recording_that_is_still_written_is_not_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its recorder went on in a file that had no name any more: bytes were in neither."""
    monkeypatch.setattr(recovering, "STILL_S", 0.5)
    path = tmp_path / "run.mcap"
    sink = McapSink(path, {}, live=True)
    sink.raw("bus0", [Chunk(b"\xff\xff\xff\x01\x02\xf1\x0b", 1_000_000_000)])
    sink.flush()

    def go_on() -> None:
        time.sleep(recovering.STILL_S / 2)
        with path.open("ab") as file:
            file.write(bytes(9))

    writer = threading.Thread(target=go_on)
    writer.start()
    before = path.stat().st_ino
    with pytest.raises(OutputError, match="is being written: end its recorder first"):
        recover(path, path)
    writer.join()
    assert path.stat().st_ino == before
    assert recover(path, tmp_path / "other.mcap").messages
    sink.close()
