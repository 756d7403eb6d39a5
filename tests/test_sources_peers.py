"""Logs that the tools write while they run: bytes that are known, times held against the clock."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
import tty
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Final

import pytest
import serial

from sniffer.ground.model import Clock, Direction, MarkKind, SnifferError
from tests.inputs import chunks
from tests.terminals import heard, wait
from tests.toollogs import ANSWER, ASK, MS, RX, TX

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from sniffer.ground.model import Chunk

pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo-terminals")

PATIENCE_S: Final = 20
EXCHANGES: Final = 6


def _until(what: str, path: Path, process: subprocess.Popen[bytes], size: int = 0) -> None:
    end = time.monotonic() + PATIENCE_S
    while not path.exists() or path.stat().st_size < size:
        assert process.poll() is None, f"{what} ended"
        assert time.monotonic() < end, f"{what} does not write {path}"
        time.sleep(0.005)


def _said(log: Path) -> bytes:
    """Return the bytes of a log that grows, as far as it can be read."""
    with suppress(SnifferError):
        return b"".join(chunk.data for chunk in chunks(log))
    return b""


@contextmanager
def _opened(*paths: Path) -> Iterator[list[int]]:
    ports = [os.open(path, os.O_RDWR | os.O_NOCTTY) for path in paths]
    try:
        yield ports
    finally:
        for port in ports:
            os.close(port)


def _passed(sender: int, receiver: int, data: bytes) -> tuple[int, int]:
    """Send bytes; return the times between which somebody in the middle had them."""
    begun = time.time_ns()
    os.write(sender, data)
    assert heard(receiver, len(data)) == data
    return begun, time.time_ns()


def _zone(t_ns: int) -> int:
    """Return a time as its wall clock shows it here, taken for UTC."""
    return t_ns + time.localtime(t_ns // 10**9).tm_gmtoff * 10**9


@pytest.mark.skipif(not shutil.which("socat"), reason="socat is not installed")
@pytest.mark.parametrize("options", [["-x"], ["-x", "-v"]], ids=" ".join)
def test_what_socat_writes_is_read_with_its_times_and_directions(
    options: list[str], tmp_path: Path
) -> None:
    left, right, log = (tmp_path / name for name in ("left", "right", "log"))
    sides = [f"PTY,link={path},raw,echo=0" for path in (left, right)]
    said: list[tuple[bytes, Direction, int, int]] = []
    with log.open("wb") as file:
        socat = subprocess.Popen(["socat", *options, *sides], stderr=file)
        try:
            for path in (left, right):
                _until("socat", path, socat)
            with _opened(left, right) as (controller, servo):
                for _ in range(EXCHANGES):
                    said.append((ASK, TX, *_passed(controller, servo, ASK)))
                    said.append((ANSWER, RX, *_passed(servo, controller, ANSWER)))
                    time.sleep(0.005)
        finally:
            socat.terminate()
            socat.wait()
    got = chunks(log)
    assert [(c.data, c.direction) for c in got] == [(data, wire) for data, wire, _, _ in said]
    for chunk, (_, wire, begun, over) in zip(got, said, strict=True):
        assert chunk.clock == Clock.FILE
        assert chunk.t_ns is not None
        assert _zone(begun) - 1000 <= chunk.t_ns <= _zone(over)  # it shows whole microseconds
        assert [m.kind for m in chunk.marks] == ([MarkKind.SENT] if wire == TX else [])


@pytest.mark.skipif(not shutil.which("jpnevulator"), reason="jpnevulator is not installed")
@pytest.mark.parametrize("options", [[], ["--ascii"], ["--byte-count"]], ids=str)
def test_what_jpnevulator_writes_is_read_with_the_time_of_each_first_byte(
    options: list[str], tmp_path: Path
) -> None:
    sender, port = os.openpty()
    tty.setraw(port)
    log = tmp_path / "log"
    command = ["jpnevulator", "--read", "--timing-print", "--timing-delta=40000", *options]
    tool = subprocess.Popen([*command, f"--tty={os.ttyname(port)}", f"--file={log}"])
    blocks: list[int] = []
    over: list[int] = []
    try:
        _until("jpnevulator", log, tool)
        for _ in range(3):
            time.sleep(0.12)
            begun = time.time_ns()
            os.write(sender, ASK + ANSWER)  # at once: it stamps what comes 40 ms later anew
            blocks.append(begun)
            whole = (ASK + ANSWER) * len(blocks)
            wait(lambda: _said(log) == whole, "jpnevulator does not write it")  # noqa: B023
            over.append(time.time_ns())
    finally:
        tool.terminate()
        tool.wait()
        os.close(sender)
        os.close(port)
    got = chunks(log)
    assert b"".join(c.data for c in got) == (ASK + ANSWER) * 3
    stamped = [c for c in got if c.t_ns is not None]
    assert [c.data for c in stamped] == [ASK[:1]] * 3
    for chunk, begun, known in zip(stamped, blocks, over, strict=True):
        assert chunk.t_ns is not None
        assert _zone(begun) - 1000 <= chunk.t_ns <= _zone(known)


def test_what_spy_of_pyserial_writes_is_read_with_its_times_and_directions(tmp_path: Path) -> None:
    servo, port = os.openpty()
    tty.setraw(port)
    log = tmp_path / "log"
    long = bytes(range(40))
    before = time.time_ns()
    url = f"spy://{os.ttyname(port)}?file={log}"
    said: list[tuple[bytes, Direction, int, int]] = []

    def called(data: bytes, wire: Direction) -> None:
        if wire == RX:
            os.write(servo, data)
        begun = time.time_ns()
        if wire == RX:
            assert host.read(len(data)) == data
        else:
            host.write(data)
            host.flush()
            assert heard(servo, len(data)) == data
        said.append((data, wire, begun, time.time_ns()))

    with serial.serial_for_url(url, timeout=PATIENCE_S) as host:
        opened = time.time_ns()
        for _ in range(EXCHANGES):
            called(ASK, TX)
            called(ANSWER, RX)
            host.reset_input_buffer()
            time.sleep(0.003)
        called(long, TX)
        vars(host)["formatter"].output.close()
    os.close(servo)
    os.close(port)
    got: list[Chunk] = chunks(log)
    assert [(c.data, c.direction) for c in got] == [(data, wire) for data, wire, _, _ in said]
    for chunk, (_, _, begun, over) in zip(got, said, strict=True):
        assert chunk.t_ns is not None
        coarse = next(m.count for m in chunk.marks if m.kind == MarkKind.COARSE)
        assert coarse == MS
        assert begun - opened <= chunk.t_ns
        assert chunk.t_ns - coarse <= over - before
