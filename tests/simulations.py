"""Simulations in processes of their own, whoever listens to them, and what their truth says."""

from __future__ import annotations

import contextlib
import json
import os
import select
import time
from typing import TYPE_CHECKING, Any, Final

from tests.commands import started

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

DEADLINE_S: Final = 180
"""Long enough for a busy machine; nothing waits so long where all is well."""


class Running:
    """A simulation in a process of its own; ``ports`` are the paths it printed, in order."""

    def __init__(self, *arguments: str | Path, ports: int = 1) -> None:
        out, their_out = os.pipe()
        err, their_err = os.pipe()
        self.process = started("simulate", *arguments, out=their_out, err=their_err)
        os.close(their_out)
        os.close(their_err)
        self._out, self._err = (os.fdopen(fd, encoding="utf-8") for fd in (out, err))
        lines = [self._out.readline().split() for _ in range(ports)]
        assert all(lines), self.end()
        self.ports = [words[-1] for words in lines]

    def end(self, number: int | None = None) -> str:
        """Let it end, by a signal if need be; return what it complained of."""
        if number is not None:
            self.process.send_signal(number)
        self.process.wait(timeout=DEADLINE_S)
        err = self._err.read()
        assert "Traceback" not in err, err
        return err

    def close(self) -> None:
        """Kill it, unless it has ended."""
        self.process.kill()
        self.process.wait()
        self._out.close()
        self._err.close()


@contextlib.contextmanager
def running(*arguments: str | Path, ports: int = 1) -> Iterator[Running]:
    it = Running(*arguments, ports=ports)
    try:
        yield it
    finally:
        it.close()


class Ear:
    """Whoever has a port open: reads raw bytes, and can talk."""

    def __init__(self, path: str) -> None:
        self.fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        self.data = bytearray()
        self.reads: list[tuple[int, int]] = []
        """When each read ended, in Unix ns, and how many bytes there were by then."""

    def listen(self, *, until: int | None = None, seconds: float = DEADLINE_S) -> bytes:
        """Read until so many bytes are there, the port hangs up, or time is over."""
        deadline = time.monotonic() + seconds
        while until is None or len(self.data) < until:
            left = deadline - time.monotonic()
            if left <= 0 or not select.select([self.fd], [], [], left)[0]:
                break
            try:
                more = os.read(self.fd, 65536)
            except OSError:  # hung up
                break
            if not more:
                break
            self.data += more
            self.reads.append((time.time_ns(), len(self.data)))
        return bytes(self.data)

    def ask(self, *parts: bytes, answer: int) -> bytes:
        """Say something, piece by piece; return so many bytes of answer."""
        before = len(self.data)
        for part in parts:
            os.write(self.fd, part)
            if part is not parts[-1]:
                time.sleep(0.01)
        return self.listen(until=before + answer)[before:]

    def close(self) -> None:
        os.close(self.fd)


@contextlib.contextmanager
def ear(path: str) -> Iterator[Ear]:
    it = Ear(path)
    try:
        yield it
    finally:
        it.close()


def told(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def framed(path: Path) -> list[dict[str, Any]]:
    return [row for row in told(path) if row["type"] == "frame"]


def heard(rows: list[dict[str, Any]]) -> bytes:
    """Return the bytes that were on the port; their offsets join."""
    out = b""
    for row in rows:
        if row["offset"] is not None:
            assert row["offset"] == len(out)
            out += bytes.fromhex(row["wire"])
    return out
