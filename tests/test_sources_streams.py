"""Pipes, files read again, groups, memory: how inputs stream."""

from __future__ import annotations

import io
import os
import random
import sys
import threading
import tracemalloc
import types
from typing import TYPE_CHECKING

import pytest

from sniffer.ground.model import Chunk, InputError
from sniffer.sources import open_source
from tests.inputs import (
    BUS,
    SAMPLES,
    hexdump,
    read,
    xxd,
)

if TYPE_CHECKING:
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

    small, large = peak(5), peak(50)
    assert large < 1.25 * small
