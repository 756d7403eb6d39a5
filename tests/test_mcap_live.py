"""Recordings that are written while the bus talks: little at a time, and for hours."""

from __future__ import annotations

import os
import random
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import ChunkIndex
from mcap.writer import Writer
from mcap_protobuf.schema import register_schema

from sniffer.decoding.decoder import Decoder
from sniffer.ground.model import (
    NS,
    Chunk,
    Clock,
    DamagedInputError,
    Direction,
    Mark,
    MarkKind,
    OutputError,
)
from sniffer.mcapfile.held import ANOMALIES, FRAMES, MOST, Arrivals, Seconds
from sniffer.mcapfile.index import PIECE, ChunkIndexes, ChunkNote, as_bytes
from sniffer.mcapfile.raw import HeldChunks, RawEncoder, spoken
from sniffer.mcapfile.rows import LOG_AT, Heads
from sniffer.mcapfile.sink import McapSink
from sniffer.mcapfile.source import chunks, session
from sniffer.mcapfile.turns import TURN
from sniffer.messages import INCIDENTS, TOPICS
from sniffer.messages.recording_pb2 import RawChunk
from tests.recordings import START_NS, heads, messages, talk
from tests.test_mcap import RERUN, rerun

if TYPE_CHECKING:
    from pathlib import Path


def live(path: Path, sent: list[Chunk], size: int = 20, **options: Any) -> McapSink:
    """Record as a live recorder does, up to but not including the end."""
    sink = McapSink(path, {"tool": "test"}, live=True, **options)
    decoder = Decoder("mightyzap")
    for i in range(0, len(sent), size):
        sink.raw("bus0", sent[i : i + size])
        sink.write("bus0", decoder.protocol, decoder.feed(*sent[i : i + size]))
        sink.flush()
    sink.write("bus0", decoder.protocol, decoder.close())
    return sink


def so_far(path: Path) -> list[Chunk]:
    """Return the chunks of a file that is being written."""
    out: list[Chunk] = []
    try:
        for chunk in chunks(path):
            out.append(chunk)  # noqa: PERF402 - what comes before the error is to be kept
    except DamagedInputError:
        return out
    raise AssertionError(f"{path} is finished")


@pytest.mark.parametrize(("flush_ns", "turn"), [(0, TURN), (0, 1), (10**12, TURN)])
def test_raw_bytes_are_in_the_file_with_each_flush_and_the_rest_follows_in_turns(
    flush_ns: int, turn: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for limit in ("TURN", "WRITTEN"):
        monkeypatch.setattr(f"sniffer.mcapfile.turns.{limit}", turn)
    path, sent = tmp_path / "run.mcap", talk("mightyzap", 2.0)
    sink = live(path, sent, flush_ns=flush_ns)
    assert so_far(path) == sent
    assert sink.size == path.stat().st_size
    sink.close()
    assert list(chunks(path)) == sent
    assert sink.size == path.stat().st_size
    once = McapSink(tmp_path / "once.mcap", {})
    decoder = Decoder("mightyzap")
    once.raw("bus0", sent)
    once.write("bus0", decoder.protocol, decoder.feed(*sent))
    once.write("bus0", decoder.protocol, decoder.close())
    once.close()
    found, wanted = messages(path), messages(tmp_path / "once.mcap")
    for topic in wanted:
        assert len(found[topic]) == len(wanted[topic])
    for topic in ("raw", "frames", "transactions"):
        assert found[f"/bus0/{topic}"] == wanted[f"/bus0/{topic}"]
    times = {f.offset: f.t_end_ns for f in found["/bus0/frames"]}
    by_channel: dict[int, list[int]] = {}
    for head in heads(path):
        by_channel.setdefault(head.channel_id, []).append(head.log_time)
    assert all(log == sorted(log) for log in by_channel.values())
    assert len(times) > 100
    if RERUN is not None:
        assert "PROBLEM" not in rerun("check", "--full", str(path))


def test_a_chunk_is_the_same_record_by_the_short_way_of_live_recordings() -> None:
    mark = Mark(MarkKind.FRAMING, 0, 1, 2)
    sent = [
        Chunk(bytes(size), t_ns, Clock.READ, direction=Direction.RX, marks=marks)
        for size in (0, 3, 200, 20_000)
        for t_ns in (START_NS, None)
        for marks in ((), (mark,))
    ]
    n = len(sent)
    log, rank = np.full(n, START_NS), np.arange(n)
    length = np.array([len(c.data) for c in sent])
    timed = np.array([c.t_ns is not None for c in sent])
    t_ns = np.where(timed, log, 0)
    around = Heads(np.full(n, 7, np.uint16), np.zeros(n, np.uint32), log, log, rank)
    held = HeldChunks(sent, around, t_ns, timed, 5 + np.cumsum(length) - length, length)
    encoded: dict[int, bytes] = {}
    for part in RawEncoder().encode([held]):
        encoded.update(zip(part.heads.rank.tolist(), map(bytes, part.data), strict=True))
    told = spoken(sent, 7, 5, START_NS, (0, 0))
    assert told.arrived[-1] == (5 + int(length.sum()), START_NS, False)
    for i, (log_ns, channel, record) in enumerate(told.rows):
        assert (log_ns, channel) == (START_NS, 7)
        assert record[:LOG_AT] + bytes(8) + record[LOG_AT + 8 :] == encoded[i]


def test_a_live_recording_indexes_something_of_each_chunk_and_readers_find_all_of_it(
    tmp_path: Path,
) -> None:
    path, sent = tmp_path / "run.mcap", talk("mightyzap", 2.0)
    live(path, sent, flush_ns=0).close()
    indexed: set[str] = set()
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        for chunk in summary.chunk_indexes:
            topics = {summary.channels[c].topic for c in chunk.message_index_offsets}
            assert topics, "the library of TypeScript refuses a file that has such a chunk"
            indexed |= {topic.rpartition("/")[2] for topic in topics}
        counts = summary.statistics.channel_message_counts
        for channel in summary.channels.values():
            rows = list(reader.iter_messages(topics=[channel.topic]))
            assert len(rows) == counts[channel.id], channel.topic
            assert [m.log_time for _, _, m in rows] == sorted(m.log_time for _, _, m in rows)
    assert indexed == set(TOPICS) - {INCIDENTS}, "nobody diagnosed it"


def test_topics_that_were_not_asked_for_are_not_written(tmp_path: Path) -> None:
    path, sent = tmp_path / "run.mcap", talk("mightyzap", 1.0)
    live(path, sent, flush_ns=0, topics=["state"]).close()
    topics = {topic.rpartition("/")[2] for topic in messages(path)}
    assert topics == {"raw", "state"}
    assert session(path)["topics"] == "raw,state"
    assert list(chunks(path)) == sent


def test_log_times_of_frames_are_those_of_their_bytes_although_they_are_written_later(
    tmp_path: Path,
) -> None:
    path, sent = tmp_path / "run.mcap", talk("mightyzap", 1.0, rate=0)
    live(path, sent, size=1, flush_ns=10**12).close()
    ends: list[tuple[int, int]] = []
    at = 0
    for chunk in sent:
        at += len(chunk.data)
        ends.append((at, chunk.t_ns or 0))
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    (frames,) = (c.id for c in summary.channels.values() if c.topic == "/bus0/frames")
    logged = [m.log_time for m in heads(path) if m.channel_id == frames]
    for frame, log in zip(messages(path)["/bus0/frames"], logged, strict=True):
        arrived = next(t for end, t in ends if end >= frame.offset + frame.length)
        assert log == arrived


def test_what_is_known_late_of_a_second_that_is_written_counts_in_one_that_is_not() -> None:
    counted = Seconds()
    counted.count(FRAMES, np.array([5, 6, 9]) * NS, np.array([9, 9, 9]))
    rows = counted.over(final=False)
    counted.count(ANOMALIES, np.array([5, 6]) * NS)
    rows += counted.over(final=True)
    assert [(s.t_ns // NS, s.frames, s.anomalies) for s in rows] == [
        *((5, 1, 0), (6, 1, 0)),
        *((7, 0, 0), (8, 0, 0)),  # a silence
        (9, 1, 2),
    ]
    counted.count(ANOMALIES, np.array([5]) * NS)
    assert [(s.t_ns // NS, s.anomalies) for s in counted.over(final=True)] == [(10, 1)]


def test_a_flush_with_nothing_to_write_writes_nothing(tmp_path: Path) -> None:
    sink = live(tmp_path / "run.mcap", talk("mightyzap"), flush_ns=0, durable=True)
    sink.flush()
    size, told = sink.size, (tmp_path / "run.mcap").stat()
    for _ in range(1000):
        sink.flush()
    assert sink.size == size
    assert (tmp_path / "run.mcap").stat().st_mtime_ns == told.st_mtime_ns
    sink.close()


def test_a_durable_recording_is_on_the_disk_with_each_flush(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced: list[int] = []
    real = os.fsync

    def watched(descriptor: int) -> None:
        synced.append(os.fstat(descriptor).st_size)
        real(descriptor)

    monkeypatch.setattr("sniffer.mcapfile.container._sync", watched)
    path, sent = tmp_path / "run.mcap", talk("mightyzap")
    sink = live(path, sent, flush_ns=10**12, durable=True)
    assert synced[-1] == path.stat().st_size
    assert len(synced) == len({*synced}) == -(-len(sent) // 20) + 1
    sink.close()
    assert synced[-1] == path.stat().st_size


def test_a_file_that_goes_on_with_a_stream_begins_at_its_offset(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    sink = McapSink(path, {"tool": "test"}, starts={"b/1": 1000}, live=True)
    sink.raw("b/1", [Chunk(b"abc", START_NS, Clock.READ, "b/1")])
    sink.raw("b/1", [Chunk(b"de", START_NS + 1, Clock.READ, "b/1")])
    sink.raw("c", [Chunk(b"f", START_NS + 2, Clock.READ, "c")])
    sink.close()
    assert [c.data for c in chunks(path)] == [b"abc", b"de", b"f"]
    found = messages(path)
    assert [m.offset for m in found["/b/1/raw"]] == [1000, 1003]
    assert [m.offset for m in found["/c/raw"]] == [0]
    assert session(path)["offset.b/1"] == "1000"


def test_a_mark_of_a_kind_that_nobody_knows_yet_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    writer = Writer(str(path))
    writer.start()
    schema = register_schema(writer, RawChunk)
    channel = writer.register_channel("/arm/raw", "protobuf", schema)
    raw = RawChunk(data=b"abcd")
    raw.marks.add(start=1, length=2, count=3).kind = 99  # type: ignore[assignment]
    raw.marks.add(start=1, length=2, count=3).kind = 4  # type: ignore[assignment]
    writer.add_message(channel, 0, raw.SerializeToString(), 0)
    writer.finish()  # type: ignore[no-untyped-call]
    mark = Mark(MarkKind.OVERRUN, 1, 2, 3)
    assert list(chunks(path)) == [Chunk(b"abcd", bus="arm", marks=(mark,))]


def test_the_index_of_an_hour_takes_little_memory(tmp_path: Path) -> None:
    rng = random.Random(1)
    sink = McapSink(tmp_path / "run.mcap", {"tool": "test"}, live=True)
    ticks = 4 * PIECE
    for tick in range(ticks):
        for bus in range(8):
            at = START_NS + tick * 50_000_000 + bus
            reads = [Chunk(b"12345678", at, Clock.READ, f"bus{bus}")] * rng.randint(1, 9)
            sink.raw(f"bus{bus}", reads)
        sink.flush()
    held = sink._file._summary.chunks.held
    sink.close()
    assert held / ticks * 20 * 3600 < 2_500_000
    with (tmp_path / "run.mcap").open("rb") as stream:
        summary = make_reader(stream, validate_crcs=True).get_summary()
    assert summary is not None
    assert len(summary.chunk_indexes) == ticks
    assert summary.statistics is not None
    assert summary.statistics.message_count == len(heads(tmp_path / "run.mcap"))


def test_the_index_records_are_those_that_the_library_writes() -> None:
    rng, at = random.Random(1), 100
    index, wanted = ChunkIndexes(), bytearray()
    for _ in range(2 * PIECE + 100):
        channels = sorted(rng.sample(range(1, 400), rng.choice([1, 3, 3, 40])))
        counts = [rng.randrange(1, 1 << rng.randrange(1, 20)) for _ in channels]
        length, size = rng.randrange(1 << 20), rng.randrange(1 << 22)
        first = rng.randrange(1 << rng.choice([62, 64])) & ~7  # harmed recordings have any time
        name = rng.choice(["zstd", "zstd", "lz4", ""])
        places, here = {}, at + length
        for channel, count in zip(channels, counts, strict=True):
            places[channel] = here
            here += 15 + 16 * count
        told = ChunkIndex(
            *(length, at, name, length // 2, first + 7, here - at - length, places, first, size)
        )
        wanted += as_bytes(told)
        numbers = np.array(channels, np.uint16), np.array(counts)
        note = ChunkNote(
            at, length, first, first + 7, name, length // 2, size, *numbers, numbers[1]
        )
        index.add(note)
        at = here + rng.choice([0, 0, 300])
    assert b"".join(index) == wanted


def test_arrivals_of_a_bus_that_nobody_understands_are_forgotten() -> None:
    arrivals = Arrivals()
    for k in range(40):
        end = np.arange(10_000) + 10_000 * k + 1
        arrivals.add(end, end * 7, np.ones(len(end), bool))
    assert len(arrivals._end) <= MOST
    ends, otherwise = np.array([5, 399_990]), np.array([1, 2])
    assert arrivals.of(ends, otherwise).tolist() == [1, 7 * 399_990]


def test_a_live_recording_that_cannot_be_synced_says_so(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    os.mkfifo(path)
    reader = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    try:
        with pytest.raises(OutputError, match=r"run\.mcap: cannot be written"):
            McapSink(path, {}, durable=True)
    finally:
        os.close(reader)
