"""Pipes, files read again, groups, memory: how inputs stream."""

from __future__ import annotations

import io
import json
import os
import random
import subprocess
import sys
import threading
import tracemalloc
import types
import zlib
from typing import TYPE_CHECKING, Final

import pytest

from sniffer.ground.model import Chunk, InputError
from sniffer.sources import open_source
from tests.commands import COMMAND, environment
from tests.golden import CAPTURES
from tests.inputs import (
    BUS,
    SAMPLES,
    hexdump,
    read,
    xxd,
)
from tests.terminals import PATIENCE_S

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path


def test_standard_input_is_recognised_without_reading_it_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Endless(io.RawIOBase):
        given = 0

        def readable(self) -> bool:
            return True

        def readinto(self, buffer: bytearray) -> int:  # type: ignore[override]
            self.given += len(buffer)
            buffer[:] = b"ff00\n" * (len(buffer) // 5) + b"\n" * (len(buffer) % 5)
            return len(buffer)

    endless = Endless()
    stdin = types.SimpleNamespace(closed=False, buffer=endless)
    monkeypatch.setattr(sys, "stdin", stdin)
    source = open_source("-")
    assert source.format == "hex"
    assert source.describe() == "standard input: plain hex, no times"
    group = next(iter(source))
    assert 250_000 < sum(len(chunk.data) for chunk in group) < 400_000
    assert endless.given < 3_000_000
    with pytest.raises(InputError, match="only once"):
        list(source)


def test_a_pipe_with_a_name_is_read_once_from_its_first_byte(tmp_path: Path) -> None:
    if not hasattr(os, "mkfifo"):
        pytest.skip("no named pipes here")
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    data = xxd(BUS * 5000)
    writer = threading.Thread(target=pipe.write_bytes, args=(data,))
    writer.start()
    assert read(pipe) == BUS * 5000
    writer.join()


def test_a_file_can_be_read_again() -> None:
    with open_source(SAMPLES / "xxd.txt", bus="arm") as source:
        assert list(source) == list(source) == [[Chunk(BUS, bus="arm")]]
        assert source.describe().endswith("xxd.txt: an xxd dump, no times")


def test_groups_hold_many_chunks_and_about_256_kib() -> None:
    line = b"(1.000000001) bus0 RX#" + b"ff" * 64 + b"\n"
    groups = list(open_source(line * 10_000))
    assert [len(group) for group in groups] == [4096, 4096, 1808]
    assert [len(group) for group in open_source(b"(1.5) a RX#ff\n" * 40_000)] == [32768, 7232]


def test_a_recording_is_given_to_the_mcap_source_by_its_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stub = types.ModuleType("sniffer.mcapfile.source")
    stub.chunks = lambda path: iter([Chunk(str(path).encode())])  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, stub.__name__, stub)
    monkeypatch.setattr("sniffer.mcapfile.source", stub, raising=False)
    path = tmp_path / "run.mcap"
    path.write_bytes(b"\x89MCAP0\r\n")
    assert open_source(path).format == "mcap"
    assert read(path) == str(path).encode()
    assert open_source(path.read_bytes()).format == "mcap"


def test_memory_does_not_grow_with_the_file(tmp_path: Path) -> None:
    once = hexdump(random.Random(3).randbytes(240_000))  # about 1.2 MB of text

    def peak(times: int) -> int:
        path = tmp_path / f"{times}.txt"
        with path.open("wb") as file:
            for _ in range(times):
                file.write(once)
        tracemalloc.start()
        size = sum(len(chunk.data) for group in open_source(path) for chunk in group)
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert size == 240_000 * times
        return most

    small, large = peak(3), peak(12)
    assert large < 1.25 * small


class Slow:
    """A named pipe into which somebody writes now and then."""

    def __init__(self, folder: Path) -> None:
        if not hasattr(os, "mkfifo"):
            pytest.skip("no named pipes here")
        self.path = folder / "slow"
        os.mkfifo(self.path)
        self._file = os.open(self.path, os.O_RDWR)  # which waits for no reader

    def write(self, data: bytes) -> None:
        assert os.write(self._file, data) == len(data)

    def end(self) -> None:
        os.close(self._file)


FORMS: Final[Mapping[str, Callable[[int, bytes], bytes]]] = {
    "candump": lambda at, data: b"(1.5) bus0 #%s\n" % data.hex().encode(),
    "hex": lambda at, data: data.hex(" ").encode() + b"\n",
    "jsonl": lambda at, data: (
        b'{"type": "gap", "offset": %d, "hex": "%s"}\n' % (at, data.hex().encode())
    ),
    "od": lambda at, data: b"%07o %s\n" % (at, data.hex(" ").encode()),
    "bin": lambda at, data: data,
}


@pytest.mark.parametrize(
    ("form", "packed"), [*((form, False) for form in FORMS), ("candump", True)]
)
def test_what_comes_slowly_is_handed_on_before_more_comes(
    form: str, packed: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sniffer.sources.opening.GATHER_S", 0.02)
    monkeypatch.setattr("sniffer.sources.opening.SILENT_S", 0.02)
    packing = zlib.compressobj(wbits=31)
    slow = Slow(tmp_path)

    def say(at: int) -> bytes:
        data = BUS[at : at + 16]
        text = FORMS[form](at, data)
        slow.write(packing.compress(text) + packing.flush(zlib.Z_SYNC_FLUSH) if packed else text)
        return data

    said = [say(0)]
    with open_source(slow.path, form) as source:
        groups = iter(source)
        heard = [next(groups)]
        for at in (16, 32):
            said.append(say(at))
            heard.append(next(groups))
        assert [b"".join(chunk.data for chunk in group) for group in heard] == said
        slow.write(packing.flush() if packed else b"")
        slow.end()
        assert list(groups) == []


def test_a_pipe_that_is_never_silent_is_read_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sniffer.sources.opening.GATHER_S", 60)
    monkeypatch.setattr("sniffer.sources.opening.GATHER_MOST_S", 0.05)
    slow, enough = Slow(tmp_path), threading.Event()

    def talk() -> None:
        while not enough.wait(0.005):
            slow.write(b"(1.5) bus0 #FF\n")

    talker = threading.Thread(target=talk)
    talker.start()
    try:
        with open_source(slow.path) as source:
            assert source.format == "candump"
            assert next(iter(source))
    finally:
        enough.set()
        talker.join()
        slow.end()


@pytest.mark.parametrize("protocol", ["mightyzap", "auto"])
def test_a_log_that_grows_in_a_pipe_is_decoded_as_it_grows(protocol: str) -> None:
    lines = (CAPTURES / "mightyzap_clean.log").read_bytes().splitlines(keepends=True)
    begun = {"mightyzap": 2, "auto": 150}[protocol]  # one exchange, or enough to tell
    command = [*COMMAND, "decode", "-", "--protocol", protocol, "--format", "jsonl"]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment()
    ) as running:
        assert running.stdin is not None
        assert running.stdout is not None
        give_up = threading.Timer(PATIENCE_S, running.kill)
        give_up.start()
        seen = 0
        for some in (lines[:begun], lines[begun : begun + 8]):
            running.stdin.write(b"".join(some))
            running.stdin.flush()
            seen += len(some) - 1  # a last request waits for its answer
            while seen > 0:
                line = running.stdout.readline()
                assert line, "it ends, or says nothing for long"
                seen -= json.loads(line)["type"] == "frame"
        running.stdin.close()
        running.stdout.read()
        assert running.wait() == 0
        give_up.cancel()
