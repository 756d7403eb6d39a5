"""Fully loaded lines on ptys: a process that says prepared bytes in slices, and notes when.

Every millisecond each line gets the bytes that its baud rate had time for, as a USB adapter
delivers them. Prepared, so that who speaks needs little of the machine that the listener runs on.
"""

from __future__ import annotations

import argparse
import array
import contextlib
import gc
import itertools
import json
import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.simulation import BUSES, simulate
from sniffer.simulation.play.ports import Pty
from sniffer.simulation.render import raw

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

SLICE_S: Final = 0.001
PART_S: Final = 2.0
"""So much of a bus is simulated; then it says the same again."""

NAMES: Final = tuple(BUSES)
WAIT_S: Final = 180.0


def traffic(protocol: str, baud: int, seconds: float, seed: int) -> bytes:
    """Return what a fully loaded line says in so many seconds, with no pause anywhere."""
    frames = simulate(protocol, seed=seed, baud=baud, full=True, duration_s=min(seconds, PART_S))
    part = raw(frames)
    need = int(baud / 10 * seconds)
    return (part * (need // len(part) + 1))[:need]


def protocol_of(line: int) -> str:
    """Return what the lines speak, in turn."""
    return NAMES[line % len(NAMES)]


class Line:
    """A pty and what is to be said on it."""

    def __init__(self, data: bytes, baud: int) -> None:
        self.data = data
        self.port = Pty()
        self.done = 0
        """Bytes written."""
        self.behind_s = 0.0
        """By how much the reader held the line up at worst."""
        self._bytes_per_s = baud / 10

    def say(self, elapsed_s: float) -> bool:
        """Write what is due; tell whether anything was written."""
        due = min(int(elapsed_s * self._bytes_per_s), len(self.data))
        if due <= self.done:
            return False
        taken = self.port.write(self.data[self.done : due])
        self.done += taken
        if self.done < due:
            self.behind_s = max(self.behind_s, (due - self.done) / self._bytes_per_s)
        return taken > 0

    @property
    def is_over(self) -> bool:
        """Tell whether all has been said."""
        return self.done >= len(self.data)


def ticks(seconds: float) -> Iterator[tuple[float, float]]:
    """Sleep from slice to slice; yield the time since the beginning, and how late that is."""
    began = time.monotonic()
    for n in itertools.count(1):
        planned = n * SLICE_S
        time.sleep(max(0.0, began + planned - time.monotonic()))
        elapsed = time.monotonic() - began
        yield elapsed, elapsed - planned
        if elapsed > seconds:
            return


@dataclass(frozen=True, slots=True)
class Said:
    """What was said: ``log`` has a row a write: line, bytes by then, when it began and ended."""

    log: Any
    size: int
    seconds: float
    cpu_s: float
    blocked_s: float
    """By how much the reader held up a line at worst."""
    late_ms: tuple[float, float]
    """How late a slice was, through no fault of the reader: p99 and at worst."""


class Writer:
    """The process; ``say`` lets it speak, ``end`` tells what became of it."""

    def __init__(self, folder: Path, lines: int, baud: int, seconds: float) -> None:
        self._log = folder / "said.npy"
        command = [sys.executable, "-m", "bench.lines", str(self._log)]
        self._process = subprocess.Popen(
            [*command, str(lines), str(baud), str(seconds)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.pid = self._process.pid
        self.ports: Sequence[str] = self._told()

    def say(self) -> None:
        """Begin."""
        assert self._process.stdin is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()

    def said(self) -> Said:
        """Wait until all is said; the lines do not hang up before ``close``."""
        told = self._told()
        return Said(np.load(self._log), **{**told, "late_ms": tuple(told["late_ms"])})

    def close(self) -> None:
        """Let the lines hang up."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.communicate("", timeout=5)
        self._process.kill()
        self._process.wait()

    def _told(self) -> Any:
        assert self._process.stdout is not None
        return json.loads(self._process.stdout.readline())


def play(log: Path, lines: Sequence[Line], seconds: float) -> dict[str, Any]:
    """Say it all; return the figures."""
    notes, late = array.array("q"), array.array("d")
    gc.disable()
    used = time.process_time()
    elapsed = 0.0
    for elapsed, behind in ticks(3 * seconds + 5):
        late.append(behind)
        for n, line in enumerate(lines):
            began = time.monotonic_ns()
            if line.say(elapsed):
                notes.extend((n, line.done, began, time.monotonic_ns()))
        if all(line.is_over for line in lines):
            break
    used = time.process_time() - used
    np.save(log, np.array(notes, np.int64).reshape(-1, 4))
    worst = np.percentile(np.array(late), [99, 100]) * 1e3
    return {
        "size": sum(line.done for line in lines),
        "seconds": elapsed,
        "cpu_s": used,
        "blocked_s": max(line.behind_s for line in lines),
        "late_ms": worst.tolist(),
    }


def _tell(what: Any) -> None:
    sys.stdout.write(json.dumps(what) + "\n")
    sys.stdout.flush()


def main() -> None:
    """Open the lines, wait to be told to begin, speak, and wait to be told to hang up."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("log", type=Path)
    parser.add_argument("lines", type=int)
    parser.add_argument("baud", type=int)
    parser.add_argument("seconds", type=float)
    given = parser.parse_args()
    lines = []
    kept: dict[tuple[str, int], bytes] = {}
    for n in range(given.lines):
        kind = (protocol_of(n), n % 8)  # more would only take longer to prepare
        if kind not in kept:
            kept[kind] = traffic(kind[0], given.baud, given.seconds, kind[1])
        lines.append(Line(kept[kind], given.baud))
    _tell([line.port.name for line in lines])
    if not sys.stdin.readline():
        return
    with contextlib.suppress(PermissionError):
        os.nice(-5)  # whoever is late here makes the recorder look late
    _tell(play(given.log, lines, given.seconds))
    sys.stdin.readline()


if __name__ == "__main__":
    main()
