"""Recording live: what it costs, how late the stamps are, and that no byte is lost.

``python -m bench.live --buses 8 --baud 921600 --seconds 10 [--view board]`` measures once, and
tells in JSON. ``python -m bench.live_results`` measures everything and puts it into RESULTS.md.

A line's bytes are written a millisecond's worth at a time (``bench.lines``). A stamp belongs to the
last byte of a read, and that byte was written in a call whose beginning and end are known: how late
the stamp is lies between the two. A byte that waited in the kernel without being the last of a read
is counted too: for every write, how long it took until its bytes had been read.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import fcntl
import json
import os
import struct
import subprocess
import sys
import tempfile
import termios
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bench.lines import WAIT_S, Said, Writer, protocol_of
from sniffer.mcapfile.source import groups, session

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

VIEWS: Final = {
    "quiet": ("--quiet",),
    "raw": ("--quiet", "--topics", "raw"),
    "line": (),
    "log": ("--log",),
    "board": (),
    "dead viewer": ("--quiet", "--rerun-connect", "rerun+http://127.0.0.1:9/proxy"),
}
"""What is shown beside the recording, or left out of it: raw bytes alone, a line a second, a line a
frame to /dev/null, the board on a terminal, and a Rerun viewer at an address where none is."""

SETTLES_S: Final = 0.7
"""What the recorder is given when its file is there, until it is measured."""

TAIL_S: Final = 0.3
"""The recorder's work is counted for so long behind the last byte."""

SCREEN: Final = struct.pack("4H", 40, 120, 0, 0)


@dataclass(frozen=True, slots=True)
class Load:
    """What is measured."""

    buses: int = 8
    baud: int = 921600
    seconds: float = 10.0
    view: str = "quiet"


@dataclass(frozen=True, slots=True)
class Figures:
    """What came of it; times in ms, work in percent of one core.

    ``stamp_most`` and ``stamp_least`` bound how late a stamp is, ``waited`` is how long until what
    was written had been read: p50, p99 and at worst. ``others`` is what all other programs of the
    machine took meanwhile.
    """

    status: int
    written: int
    recorded: int
    same: bool
    cpu: float
    reader: float
    beside: float
    """What processes of the recorder took that show it elsewhere."""
    stamp_most: Sequence[float]
    stamp_least: Sequence[float]
    waited: Sequence[float]
    peak_mb: float
    file_mb: float
    seconds: float
    writer_cpu: float
    writer_blocked_ms: float
    writer_late: Sequence[float]
    load: float
    others: float


def measure(load: Load) -> Figures:
    """Record what a writer says; return the figures."""
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        run = folder / "run.mcap"
        average = os.getloadavg()[0]
        writer = Writer(folder, load.buses, load.baud, load.seconds)
        stack.callback(writer.close)
        ports = [f"b{n}={port}={protocol_of(n)}@{load.baud}" for n, port in enumerate(writer.ports)]
        command = [sys.executable, "-m", "sniffer", "record", *ports, "-o", str(run)]
        recorder = stack.enter_context(shown(command, load.view))
        until(run.exists, recorder)
        time.sleep(SETTLES_S)
        before = Work.of(recorder.pid, writer.pid)
        writer.say()
        said = writer.said()
        time.sleep(TAIL_S)
        work = Work.of(recorder.pid, writer.pid).since(before)
        peak = memory_kb(recorder.pid, "VmHWM") / 1e3
        recorder.terminate()
        status = recorder.wait(WAIT_S)
        facts = session(run)
        offset = int(facts["clock_wall_ns"]) - int(facts["clock_monotonic_ns"])
        heard, stamps = reads_of(run, offset)
        sizes = {n: int(said.log[said.log[:, 0] == n][-1, 1]) for n in range(load.buses)}
        kept = {f"b{n}": size for n, size in sizes.items()}
        most, least, waited = lateness(said, stamps)
        percent = 100 / said.seconds
        return Figures(
            status=status,
            written=said.size,
            recorded=sum(heard.values()),
            same=heard == kept,
            cpu=work.recorder * percent,
            reader=work.reader * percent,
            beside=work.beside * percent,
            stamp_most=spread(most),
            stamp_least=spread(least),
            waited=spread(waited),
            peak_mb=peak,
            file_mb=run.stat().st_size / 1e6,
            seconds=said.seconds,
            writer_cpu=work.writer * percent,
            writer_blocked_ms=said.blocked_s * 1e3,
            writer_late=said.late_ms,
            load=average,
            others=max(0.0, work.others) * 100 / (said.seconds + TAIL_S),
        )


@contextlib.contextmanager
def shown(command: Sequence[str], view: str) -> Iterator[subprocess.Popen[bytes]]:
    """Run the recorder, with a terminal where it is to draw on one."""
    screen: int | None = None
    errors: Any = subprocess.DEVNULL
    with contextlib.ExitStack() as stack:
        if view == "board":
            master, errors = os.openpty()
            fcntl.ioctl(errors, termios.TIOCSWINSZ, SCREEN)
            stack.callback(os.close, errors)
            screen = master
        process = subprocess.Popen(
            [*command, *VIEWS[view]],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=errors,
            env={**os.environ, "TERM": "xterm-256color"},
        )
        if screen is not None:
            threading.Thread(target=_empty, args=(screen,), daemon=True).start()
        try:
            yield process
        finally:
            process.kill()
            process.wait()


def _empty(screen: int) -> None:
    """Read what is drawn, as a terminal does."""
    with contextlib.suppress(OSError):  # nobody draws any more
        while os.read(screen, 1 << 16):
            pass
    os.close(screen)


def until(is_so: Any, process: subprocess.Popen[bytes]) -> None:
    """Wait until something is so.

    Raises:
        RuntimeError: it does not become so.
    """
    deadline = time.monotonic() + WAIT_S
    while not is_so():
        if process.poll() is not None or time.monotonic() > deadline:
            raise RuntimeError(f"the recorder does not record: {process.args!r}")
        time.sleep(0.02)


@dataclass(frozen=True, slots=True)
class Work:
    """Seconds that processors worked; ``machine`` is all that they did.

    ``reader`` are those of all threads of the recorder but the first, ``beside`` its children's.
    """

    recorder: float
    reader: float
    beside: float
    writer: float
    machine: float

    @property
    def others(self) -> float:
        """What nobody did who belongs to the measurement."""
        return self.machine - self.recorder - self.beside - self.writer

    @classmethod
    def of(cls, recorder: int, writer: int) -> Work:
        """Return what was done so far."""
        threads = Path(f"/proc/{recorder}/task").iterdir()
        # a thread's name does not reach the system; the main thread has the number of the process
        reader = sum(_ran_s(thread) for thread in threads if thread.name != str(recorder))
        beside = sum(_used_s(pid) for pid in descendants(recorder))
        return cls(_used_s(recorder), reader, beside, _used_s(writer), busy_s())

    def since(self, before: Work) -> Work:
        """Return what was done meanwhile."""
        pairs = zip(dataclasses.astuple(self), dataclasses.astuple(before), strict=True)
        return Work(*(now - then for now, then in pairs))


def busy_s() -> float:
    """Return how long all processors have worked, in seconds."""
    fields = Path("/proc/stat").read_text(encoding="ascii").split("\n", 1)[0].split()[1:]
    return sum(int(fields[n]) for n in (0, 1, 2, 5, 6)) / os.sysconf("SC_CLK_TCK")


def _ran_s(thread: Path) -> float:
    return int((thread / "schedstat").read_text(encoding="ascii").split()[0]) / 1e9


def _used_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def descendants(pid: int) -> list[int]:
    """Return the processes that a process has started, and those that they have."""
    out: list[int] = []
    for task in Path(f"/proc/{pid}/task").iterdir():
        for child in (task / "children").read_text(encoding="ascii").split():
            out += [int(child), *descendants(int(child))]
    return out


def memory_kb(pid: int, what: str) -> int:
    """Return a line of a process's memory, in kB."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="utf-8")
    return next(int(x.split()[1]) for x in status.splitlines() if x.startswith(what + ":"))


def reads_of(run: Path, offset: int) -> tuple[dict[str, int], dict[int, Any]]:
    """Return the bytes of each bus, and by line the end and the monotonic time of each read."""
    size: dict[str, int] = {}
    ends: dict[int, list[tuple[int, int]]] = {}
    for group in groups(run):
        for chunk in group:
            if chunk.data:
                size[chunk.bus] = size.get(chunk.bus, 0) + len(chunk.data)
                row = (size[chunk.bus], (chunk.t_ns or 0) - offset)
                ends.setdefault(int(chunk.bus[1:]), []).append(row)
    return size, {line: np.array(rows, np.int64) for line, rows in ends.items()}


def lateness(said: Said, stamps: dict[int, Any]) -> tuple[Any, Any, Any]:
    """Return for each read the bounds of its lateness, and for each write how long it waited."""
    most, least, waited = [], [], []
    for line, reads in stamps.items():
        writes = said.log[said.log[:, 0] == line]
        k = np.minimum(np.searchsorted(writes[:, 1], reads[:, 0], "left"), len(writes) - 1)
        most.append(reads[:, 1] - writes[k, 2])
        least.append(reads[:, 1] - writes[k, 3])
        k = np.minimum(np.searchsorted(reads[:, 0], writes[:, 1], "left"), len(reads) - 1)
        waited.append(reads[k, 1] - writes[:, 2])
    return np.concatenate(most), np.concatenate(least), np.concatenate(waited)


def spread(times_ns: Any) -> tuple[float, ...]:
    """Return p50, p99 and the worst, in ms."""
    return tuple(float(x) for x in np.percentile(times_ns, [50, 99, 100]) / 1e6)


def main() -> None:
    """Measure what the arguments say."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--buses", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--baud", type=int, default=921600)
    parser.add_argument("--view", choices=list(VIEWS), default="quiet")
    given = parser.parse_args()
    load = Load(given.buses, given.baud, given.seconds, given.view)
    sys.stdout.write(json.dumps(dataclasses.asdict(measure(load))) + "\n")


if __name__ == "__main__":
    main()
