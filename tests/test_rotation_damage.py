"""A recording in several files whose recorder was killed, or whose disk filled up."""

from __future__ import annotations

import contextlib
import os
import random
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.ground.model import Chunk, Clock, DamagedInputError, OutputError
from sniffer.jobs.compare import compare
from sniffer.mcapfile import rotation
from sniffer.mcapfile.container import Container
from sniffer.mcapfile.ends import End
from sniffer.mcapfile.recover import recover
from sniffer.mcapfile.rotation import RotatingMcap
from sniffer.mcapfile.source import chunks, session
from sniffer.messages import MAGIC
from tests.disks import disk
from tests.recordings import messages, talk
from tests.terminals import PATIENCE_S
from tests.test_rotation import ended, record, spoken, streams

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_where_the_next_file_cannot_be_begun_the_one_before_is_finished(
    tmp_path: Path,
) -> None:
    traffic = spoken()
    (tmp_path / "run-0002.mcap").symlink_to("/dev/full")
    seen: list[RotatingMcap] = []

    def note(file: RotatingMcap, number: int) -> None:
        seen.append(file)
        if number == 10:
            file.rotate()

    with pytest.raises(OutputError) as error:
        record(tmp_path / "run.mcap", traffic, note, overwrite=True)
    told, file = str(error.value), seen[0]
    assert told.startswith(f"{tmp_path / 'run-0002.mcap'}: cannot be written (No space left")
    for call in (file.flush, lambda: file.raw("arm", []), lambda: file.turn({})):
        with pytest.raises(OutputError, match=re.escape(told)):
            call()
    file.close()
    path = tmp_path / "run.mcap"
    assert file.files == (path,)
    for bus, (said, _) in streams([path]).items():
        sent = b"".join(c.data for group in traffic[: len(seen)] for c in group if c.bus == bus)
        assert said == sent, "what is undecided belongs to it: no file goes on with it"
    assert compare(path, Options(), say=pytest.fail).buses


RECORDER = """
import resource, sys, time
from pathlib import Path
from sniffer.ground.model import OutputError
from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.mcapfile.rotation import RotatingMcap
from tests.recordings import talk

path, room, speed = Path(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])
if room:
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))
reads = talk("mightyzap", 8.0, rate=0)
file = RotatingMcap(path, {"tool": "test"}, rotate_bytes=52_000, flush_ns=100_000_000)
pipeline = Pipeline(Options(protocol="mightyzap"), [file], live=True)
began, first, sent = time.monotonic_ns(), reads[0].t_ns, 0
try:
    while reads:
        time.sleep(0.02 / speed)
        now = (time.monotonic_ns() - began) * speed
        # never much at once, however long it was kept from running
        due = [c for c in reads if c.t_ns - first <= now][:40]
        reads = reads[len(due):]
        sent += sum(len(c.data) for c in due)
        print("handed", sent, flush=True)
        pipeline.feed(due)
        file.flush()
        print("flushed", sent, flush=True)
        file.turn(pipeline.decided())
except OutputError as error:
    print(error)
file.close()
"""


def flushed_and_handed(told: Sequence[str]) -> tuple[int, int]:
    """Return how many bytes the recorder has surely written, and how many it had at all."""
    flushed, handed = (
        max((int(line.split()[1]) for line in told if line.startswith(word)), default=0)
        for word in ("flushed", "handed")
    )
    return flushed, handed


def parts(folder: Path, names: str = "run-*.mcap") -> list[Path]:
    return sorted(folder.glob(names), key=lambda path: path.stem)


def test_a_recorder_that_is_killed_between_files_loses_nothing_that_was_flushed(
    tmp_path: Path,
) -> None:
    command = [sys.executable, "-c", RECORDER, str(tmp_path / "run.mcap"), "0", "1"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as recorder:
        assert recorder.stdout is not None
        told = [recorder.stdout.readline()]
        deadline = time.monotonic() + PATIENCE_S
        while len(parts(tmp_path)) < 3 and time.monotonic() < deadline:
            time.sleep(0.01)
        recorder.send_signal(signal.SIGKILL)
        told += recorder.stdout.read().splitlines()
    least, most = flushed_and_handed(told)
    files = [path for path in parts(tmp_path) if path.stat().st_size]  # it may be just begun
    with pytest.raises(DamagedInputError):
        list(chunks(files[-1]))
    for path in files[1:]:  # the one before it may not have been finished
        recover(path, path)
    said = joined(files, "bus0")
    assert least <= len(said) <= most
    assert b"".join(c.data for c in talk("mightyzap", 8.0, rate=0)).startswith(said)
    for path in files[:-1]:
        assert compare(path, Options(), say=pytest.fail).equal


def test_wherever_in_a_change_a_recorder_is_killed_no_byte_is_in_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever is written is noted: a killed recorder has written the beginning of that."""
    written: list[tuple[str, bytes, int]] = []
    flushed = 0
    put = Container._put

    def note(self: Container, data: bytes, *, checked: bool = True) -> None:
        written.append((self.path.name, data, flushed))
        put(self, data, checked=checked)

    monkeypatch.setattr(Container, "_put", note)
    # a busy machine would end a file in many steps, some of them in flushes: not looked at here
    monkeypatch.setattr("sniffer.mcapfile.rotation.STEP_NS", 1 << 62)
    traffic = talk("wck", 0.4, rate=0.1)
    said = b"".join(chunk.data for chunk in traffic)
    file = RotatingMcap(tmp_path / "run.mcap", {"tool": "test"}, flush_ns=0)
    pipeline = Pipeline(Options(protocol="wck"), [file], live=True)
    turns: list[int] = []
    for number, chunk in enumerate(traffic):
        pipeline.feed([chunk])
        file.flush()
        flushed += len(chunk.data)
        began = len(written)
        if number in (20, 40):
            file.rotate()
        file.turn(pipeline.decided())
        turns += range(began + 1, len(written) + 1)
    assert len(turns) > 20
    left = tmp_path / "left"
    left.mkdir()
    for count in turns:
        for name in {name for name, _, _ in written[:count]}:
            of_it = [data for of, data, _ in written[:count] if of == name]
            (left / name).write_bytes(b"".join(of_it))
            recover(left / name, left / name)
        least = written[count - 1][2]
        files = sorted(left.iterdir(), key=lambda path: path.stem)
        assert joined(files, "bus0") == said[:least]
    pipeline.close()
    pipeline.finish()


def test_while_a_long_file_is_ended_what_comes_is_in_the_next_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rotation, "STEP_NS", 0)
    file = RotatingMcap(tmp_path / "run.mcap", {"tool": "test"})
    for n in range(1100):
        file.raw("bus0", [Chunk(b"0123456789", n, Clock.READ)])
        file.flush()
    file.rotate()
    file.turn({"bus0": 10_995})
    first, second = file.files
    steps = 0
    while not first.read_bytes().endswith(MAGIC):
        steps += 1
        assert ended(first) == {"bus0": End(10_995, 1099)}
        file.raw("bus0", [Chunk(bytes([steps]), 3000 + steps, Clock.READ)])
        file.flush()
        assert [chunk.data for chunk in readable(second)][-1] == bytes([steps])
        assert file.size == sum(path.stat().st_size for path in file.files)
    assert steps >= 3
    assert len(messages(first)["/bus0/raw"]) == 1100, "the index is sound"
    file.rotate()
    file.turn({})
    file.rotate()
    file.turn({})
    file.close()
    assert len(file.files) == 4
    assert all(path.read_bytes().endswith(MAGIC) for path in file.files)


def joined(files: Sequence[Path], bus: str) -> bytes:
    """Return what a bus said, as far as files are whole: what stands in two is the same in both."""
    said = b""
    for path in files:
        begin = int(session(path).get(f"offset.{bus}", "0"))
        data = b"".join(chunk.data for chunk in readable(path) if chunk.bus == bus)
        assert begin <= len(said), f"bytes are missing before {path.name}"
        twice = min(len(said) - begin, len(data))
        assert data[:twice] == said[begin : begin + twice], path.name
        said += data[len(said) - begin :]
    return said


def test_a_disk_that_fills_up_leaves_every_file_readable(tmp_path: Path) -> None:
    command = [sys.executable, "-c", RECORDER, str(tmp_path / "run.mcap"), "60000", "8"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=600)
    assert "cannot be written (File too large)" in done.stdout.splitlines()[-1]
    assert "Traceback" not in done.stderr
    said = joined([path for path in parts(tmp_path) if readable(path)], "bus0")
    least, most = flushed_and_handed(done.stdout.splitlines())
    assert 0 < least <= len(said) <= most, "what a flush has returned from is on the disk"
    assert b"".join(c.data for c in talk("mightyzap", 8.0, rate=0)).startswith(said)


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere names are UTF-8")
def test_names_that_are_no_utf_8_are_told_as_far_as_they_can_be(tmp_path: Path) -> None:
    path = tmp_path / os.fsdecode(b"caf\xe9.mcap")
    file = RotatingMcap(path, {"source": os.fsdecode(b"/dev/tty\xe9"), "tool": "caf\u00e9"})
    file.raw("arm", [Chunk(b"1234", 1, Clock.READ, "arm")])
    file.rotate()
    file.turn({})
    file.turn({})
    file.close()
    assert file.files == (path, tmp_path / os.fsdecode(b"caf\xe9-0002.mcap"))
    facts = session(file.path)
    assert facts["previous"] == r"caf\udce9.mcap"
    assert facts["source"] == r"/dev/tty\udce9"
    assert facts["tool"] == "caf\u00e9"


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    with disk(tmp_path / "disk", "256k") as folder:
        yield folder


def test_no_file_follows_one_that_did_not_get_its_last_bytes(small_disk: Path) -> None:
    """The oldest file is deleted, so the disk has room again: but not for what is missing."""
    rng = random.Random(1)
    file = RotatingMcap(small_disk / "run.mcap", {"tool": "test"}, rotate_bytes=60_000, keep=1)
    file.raw("bus0", [Chunk(rng.randbytes(100_000))])
    file.flush()
    file.raw("bus0", [Chunk(rng.randbytes(160_000)), Chunk(rng.randbytes(1_000))])
    with pytest.raises(OutputError, match="No space left"):
        file.turn({"bus0": 260_000})
    file.close()
    files = parts(small_disk)
    assert [part.name for part in files] == ["run-0001.mcap"]
    assert sum(len(chunk.data) for chunk in readable(files[0])) >= 100_000


def test_a_file_that_did_not_get_what_was_undecided_is_not_begun(small_disk: Path) -> None:
    rng = random.Random(1)
    file = RotatingMcap(small_disk / "run.mcap", {"tool": "test"}, rotate_bytes=60_000)
    data = rng.randbytes(140_000)
    file.raw("bus0", [Chunk(data)])
    file.flush()
    with pytest.raises(OutputError, match=r"run-0002\.mcap: cannot be written \(No space left"):
        file.turn({"bus0": 1_000})
    assert [part.name for part in parts(small_disk)] == ["run-0001.mcap"]
    assert file.files == (small_disk / "run-0001.mcap",)
    assert b"".join(chunk.data for chunk in chunks(file.path)) == data


def readable(path: Path) -> list[Chunk]:
    out: list[Chunk] = []
    with contextlib.suppress(DamagedInputError):
        out.extend(chunks(path))
    return out


def test_a_file_that_is_deleted_while_it_is_written_is_followed_by_a_new_one(
    tmp_path: Path,
) -> None:
    file = RotatingMcap(tmp_path / "run.mcap", {"tool": "test"})
    file.raw("bus0", [Chunk(b"lost")])
    file.flush()
    (tmp_path / "run.mcap").unlink()
    file.turn({"bus0": 4})
    file.raw("bus0", [Chunk(b"kept")])
    file.turn({"bus0": 8})
    file.raw("bus0", [Chunk(b"too")])
    file.close()
    assert file.deleted == (tmp_path / "run.mcap",)
    assert file.files == (tmp_path / "run-0002.mcap",)
    assert not file.is_lost
    kept = b"".join(chunk.data for chunk in chunks(tmp_path / "run-0002.mcap"))
    assert kept.endswith(b"too")
