"""Recordings that were cut off, damaged or killed: what holds is not lost."""

from __future__ import annotations

import io
import random
import signal
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.schema import register_schema

from sniffer.ground.model import NS, Chunk, Clock, DamagedInputError, InputError
from sniffer.mcapfile.recover import recover
from sniffer.mcapfile.sink import McapSink
from sniffer.mcapfile.source import chunks, groups, recorded, session
from sniffer.messages.recording_pb2 import RawChunk
from tests.lists import thinned, walks_a_list
from tests.recordings import START_NS, heads, keep, messages, read, record, talk
from tests.test_mcap import RERUN, rerun

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, list[Chunk]]:
    """A recording of a dozen chunks in four flushes, and what is in it."""
    path = tmp_path_factory.mktemp("small") / "run.mcap"
    sent = [
        Chunk(bytes([k]) * 9, START_NS + k, Clock.READ, "ab"[k % 2]) if k % 3 else Chunk(b"-" * k)
        for k in range(12)
    ]
    keep(path, [sent[i : i + 3] for i in range(0, 12, 3)], flush_ns=0)
    return path.read_bytes(), list(chunks(path))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, list[Chunk]]:
    """A recording with everything in it, in many flushes, and its raw chunks."""
    path = tmp_path_factory.mktemp("whole") / "run.mcap"
    sent = talk("mightyzap")
    record(path, "mightyzap", sent, size=20, flush_ns=0)
    return path.read_bytes(), sent


@walks_a_list
def test_a_recording_cut_anywhere_yields_a_prefix_and_says_that_it_is_cut(
    small: tuple[bytes, list[Chunk]],
) -> None:
    data, sent = small
    found = 0
    end = 0
    for size in thinned(range(len(data)), 29):
        got, error = read(data[:size])
        assert got == sent[: len(got)]
        assert len(got) >= found, "a longer file holds more"
        found = len(got)
        if error is None:
            end = end or size
            assert got == sent
        else:
            assert isinstance(error, DamagedInputError)
            assert not end, "behind the end mark there is only the index"
            assert "cut recording" in str(error)
    assert found == len(sent)


@walks_a_list
def test_a_full_recording_cut_at_many_places_yields_a_prefix(
    whole: tuple[bytes, list[Chunk]],
) -> None:
    data, sent = whole
    for size in thinned(random.Random(1).sample(range(len(data)), 300), 7):
        got, error = read(data[:size])
        assert got == sent[: len(got)]
        assert error is None or isinstance(error, DamagedInputError)
        with pytest.raises(DamagedInputError) if error else io.BytesIO():
            list(recorded(io.BytesIO(data[:size])))
        assert session(io.BytesIO(data[:size])).get("tool") in (None, "test")


@walks_a_list
@pytest.mark.parametrize("which", ["small", "whole"])
def test_bits_that_flip_never_yield_anything_else_than_a_prefix(
    which: str, request: pytest.FixtureRequest
) -> None:
    data, sent = request.getfixturevalue(which)
    for seed in thinned(range(700), 7):
        rng = random.Random(seed)
        bad = bytearray(data)
        for _ in range(rng.choice([1, 1, 1, 5])):
            bad[rng.randrange(8, len(bad))] ^= 1 << rng.randrange(8)
        got, error = read(bytes(bad))
        assert got == sent[: len(got)]
        assert isinstance(error, DamagedInputError | None)
        assert error is not None or got == sent


@walks_a_list
def test_a_bit_that_flips_in_the_head_of_a_record_hides_no_record(
    small: tuple[bytes, list[Chunk]],
) -> None:
    data, sent = small
    at = 8
    while data[at] != Opcode.DATA_END:
        for bit in thinned(range(72), 5, ends=8):
            bad = bytearray(data)
            bad[at + bit // 8] ^= 1 << bit % 8
            got, error = read(bytes(bad))
            assert got == sent[: len(got)]
            assert isinstance(error, DamagedInputError)
        at += 9 + int.from_bytes(data[at + 1 : at + 9], "little")


def test_zeros_behind_the_last_record_are_told_from_data(whole: tuple[bytes, list[Chunk]]) -> None:
    data, _ = whole
    got, error = read(data[: len(data) // 2] + bytes(4096))
    assert got
    assert isinstance(error, DamagedInputError)
    got, error = read(data[:8] + bytes(4096))
    assert "zeros" in str(error)


def test_bytes_that_are_missing_in_the_middle_are_noticed(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    writer = Writer(str(path))
    writer.start()
    schema = register_schema(writer, RawChunk)
    channel = writer.register_channel("/arm/raw", "protobuf", schema)
    for offset in (0, 4, 12):
        data = RawChunk(offset=offset, data=b"abcd").SerializeToString()
        writer.add_message(channel, offset, data, offset)
    writer.finish()  # type: ignore[no-untyped-call]
    got, error = read(path.read_bytes())
    assert got == [Chunk(b"abcd", bus="arm")] * 2
    assert "bytes 8 to 12 of arm are missing" in str(error)


@pytest.mark.parametrize("share", [0.3, 0.7, 0.99, 1.0])
def test_a_cut_recording_is_made_whole_again(
    share: float, whole: tuple[bytes, list[Chunk]], tmp_path: Path
) -> None:
    data, sent = whole
    path = tmp_path / "run.mcap"
    path.write_bytes(data[: int(len(data) * share)])
    before, error = read(path.read_bytes())
    report = recover(path, path)
    assert [p.name for p in tmp_path.iterdir()] == ["run.mcap"]
    assert list(chunks(path)) == before == sent[: len(before)]
    assert sum(map(len, messages(path).values())) == report.messages == len(heads(path))
    assert report.bytes_kept + report.bytes_lost == int(len(data) * share)
    assert (report.bytes_lost > 0) == (error is not None) == ("were lost" in str(report))
    assert session(path)["tool"] == "test"
    with path.open("rb") as stream:
        assert len(list(make_reader(stream).iter_attachments())) >= 3
    if share == 1.0:
        assert path.read_bytes() == data
    if RERUN is not None:
        assert "Summary                  embedded" in rerun("info", str(path))
        assert "PROBLEM" not in rerun("check", "--full", str(path))


@pytest.fixture(scope="module")
def torn(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, int, list[Chunk]]:
    """A recording with a large chunk at its end, where that begins, and what is in both."""
    path = tmp_path_factory.mktemp("torn") / "run.mcap"
    rng = random.Random(1)
    sent = [
        Chunk(rng.randbytes(9) * 30, START_NS + k, Clock.READ, "ab"[k % 2]) for k in range(2000)
    ]
    sink = McapSink(path, {"tool": "test"}, live=True)
    for part in (sent[:10], sent[10:]):
        for bus in "ab":
            sink.raw(bus, [c for c in part if c.bus == bus])
        sink.flush()
    begin = path.stat().st_size
    sink.close()
    data = path.read_bytes()
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    last = max(summary.chunk_indexes, key=lambda c: c.chunk_start_offset)
    assert begin == last.chunk_start_offset + last.chunk_length + last.message_index_length
    return data, last.chunk_start_offset, list(chunks(path))


def test_of_a_chunk_that_breaks_off_the_whole_messages_are_kept(
    torn: tuple[bytes, int, list[Chunk]], tmp_path: Path
) -> None:
    data, begin, sent = torn
    path = tmp_path / "run.mcap"
    end = len(data)
    before, steps = 0, set[int]()
    for size in [*range(begin, begin + 80), *range(begin + 80, end, 499)]:
        got, _ = read(data[:size])
        assert got == sent[: len(got)]
        assert len(got) >= max(before, 10)
        before = len(got)
        if before not in steps:
            path.write_bytes(data[:size])
            report = recover(path, path)
            assert list(chunks(path)) == got
            assert report.messages == len(got)
            assert report.bytes_kept + report.bytes_lost == size
        steps.add(before)
    assert before == len(sent)
    assert len(steps) > 4, "the compressed stream gives what it has in blocks"


@walks_a_list
@pytest.mark.parametrize("which", ["small", "whole"])
def test_a_recording_cut_at_any_place_of_its_chunks_is_recovered(
    which: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    data, sent = request.getfixturevalue(which)
    path = tmp_path / "run.mcap"
    summary = make_reader(io.BytesIO(data)).get_summary()
    assert summary is not None
    last = max(summary.chunk_indexes, key=lambda c: c.chunk_start_offset)
    begin, end = last.chunk_start_offset, last.chunk_start_offset + last.chunk_length
    places = {*range(0, len(data), 97 if which == "small" else 997)}
    places |= {*range(begin, end + 60, 1 if which == "small" else 97)}
    found = 0
    for size in thinned(sorted(places), 7):
        path.write_bytes(data[:size])
        try:
            recover(path, path)
        except InputError:
            assert not found
            continue
        got = list(chunks(path))
        assert got == sent[: len(got)]
        assert len(got) >= found
        found = len(got)
    assert found == len(sent)


def test_what_is_no_recording_at_all_is_not_recovered(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    for data in (b"", b"\x89MCAP0\r\n", b"something else"):
        path.write_bytes(data)
        with pytest.raises(InputError, match=r"run\.mcap"):
            recover(path, path)
        assert path.read_bytes() == data
        assert len(list(tmp_path.iterdir())) == 1


RECORDER = """
import sys, time
from pathlib import Path
from sniffer.decoding.decoder import Decoder
from sniffer.messages.recording_pb2 import RawChunk
from sniffer.ground.model import Chunk, Clock
from sniffer.mcapfile.sink import McapSink
from tests.recordings import talk

reads = talk("mightyzap", 3.0)
decoder = Decoder("mightyzap")
sink = McapSink(Path(sys.argv[1]), {})
began, first, sent = time.monotonic_ns(), reads[0].t_ns, 0
while reads:
    time.sleep(0.02)
    now = time.monotonic_ns() - began
    due = [c for c in reads if c.t_ns - first <= now]
    reads = reads[len(due):]
    sent += sum(len(c.data) for c in due)
    called = time.monotonic_ns()
    sink.raw("bus0", due)
    print(called, time.monotonic_ns(), sent, flush=True)
    sink.write("bus0", decoder.protocol, decoder.feed(*due))
"""


def test_a_recorder_that_is_killed_loses_no_more_than_a_tenth_of_a_second(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    command = [sys.executable, "-c", RECORDER, str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as recorder:
        assert recorder.stdout is not None
        told: list[list[int]] = []
        while not told or told[-1][0] - told[0][0] < NS:
            told.append([int(word) for word in recorder.stdout.readline().split()])
        recorder.send_signal(signal.SIGKILL)
        rest = recorder.stdout.read().splitlines()
    told += [[int(word) for word in line.split()] for line in rest]
    called, _, total = told[-1]
    # what was handed over that long before the sink was called last
    must = max(sent for _, over, sent in told if over <= called - 100_000_000)
    kept, error = read(path.read_bytes())
    assert isinstance(error, DamagedInputError)
    assert 0 < must <= sum(len(c.data) for c in kept) <= total
    assert recover(path, path).messages > 0


def test_a_recording_that_grows_while_it_is_read_is_not_called_cut(
    whole: tuple[bytes, list[Chunk]], tmp_path: Path
) -> None:
    data, _ = whole
    path = tmp_path / "run.mcap"
    path.write_bytes(data[: len(data) // 2])
    coming = groups(path, hasty=True)
    next(coming)
    with path.open("ab") as file:
        file.write(data[len(data) // 2 : -len(data) // 4])
    with pytest.raises(DamagedInputError, match="it is being written"):
        list(coming)
