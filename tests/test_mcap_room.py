"""Recordings that ran out of room, or were stopped within a write: what was written holds."""

from __future__ import annotations

import random
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from sniffer.ground.model import DamagedInputError
from sniffer.mcapfile.recover import recover
from sniffer.mcapfile.source import chunks
from tests.lists import each_in_turn
from tests.recordings import read

if TYPE_CHECKING:
    from pathlib import Path

CROWDED = """
import random, resource, sys
from pathlib import Path
from sniffer.decoding.decoder import Decoder
from sniffer.messages.recording_pb2 import RawChunk
from sniffer.ground.model import Chunk, Clock, OutputError
from sniffer.mcapfile.sink import McapSink

resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), int(sys.argv[2])))
rng = random.Random(1)
decoder = Decoder("mightyzap")
sink = McapSink(Path(sys.argv[1]), {}, flush_ns=0)
try:
    for k in range(1000):
        chunk = Chunk(rng.randbytes(1000), k * 10_000_000, Clock.READ)
        sink.raw("bus0", [chunk])
        sink.write("bus0", decoder.protocol, decoder.feed(chunk))
except OutputError as error:
    print(error)
    try:
        sink.raw("bus0", [chunk])
    except OutputError as again:
        print(again)
sink.close()
"""


@each_in_turn(2, "room", [100_000, 123_456])
def test_a_full_disk_is_told_once_and_what_was_written_stays_readable(
    room: int, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    command = [sys.executable, "-c", CROWDED, str(path), str(room)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    first, again = done.stdout.splitlines()
    assert first == again
    assert first.startswith(f"{path}: cannot be written (File too large)")
    assert first.endswith("what was recorded before is kept")
    assert done.stderr == ""
    got, _ = read(path.read_bytes())
    rng = random.Random(1)
    assert [c.data for c in got] == [rng.randbytes(1000) for _ in got]
    assert len(got) > 20
    recover(path, path)
    assert list(chunks(path)) == got


STOPPED = """
import random, resource, signal, sys
from pathlib import Path
from sniffer.ground.model import Chunk, Clock, OutputError
from sniffer.mcapfile.sink import McapSink

def stop(*_):
    raise KeyboardInterrupt

# the system writes a part, and then a signal comes
signal.signal(signal.SIGXFSZ, stop)
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, resource.RLIM_INFINITY))
rng = random.Random(1)
sink = McapSink(Path(sys.argv[1]), {}, live=True)
try:
    for k in range(1000):
        sink.raw("bus0", [Chunk(rng.randbytes(1000), k * 10_000_000, Clock.READ)])
        sink.flush()
except KeyboardInterrupt:
    print("stopped")
resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
try:
    sink.raw("bus0", [Chunk(b"more", 0, Clock.READ)])
except OutputError as error:
    print(error)
sink.close()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="limits are the system's")
def test_ctrl_c_within_a_write_leaves_no_part_of_a_record(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    command = [sys.executable, "-c", STOPPED, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    assert done.stdout.splitlines() == [
        "stopped",
        f"{path}: interrupted; what was recorded before is kept",
    ]
    got, error = read(path.read_bytes())
    assert isinstance(error, DamagedInputError)
    rng = random.Random(1)
    assert [c.data for c in got] == [rng.randbytes(1000) for _ in got]
    assert len(got) > 20
    report = recover(path, path)
    assert report.bytes_lost == 0
    assert "no byte was lost" in str(report) or "nothing was lost" in str(report)
    assert list(chunks(path)) == got
