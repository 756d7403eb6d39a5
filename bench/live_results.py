"""Everything about live recordings that RESULTS.md tells, measured in turns: medians of rounds."""

from __future__ import annotations

import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bench.lines import WAIT_S, Writer
from bench.live import SETTLES_S, Figures, Load, Work, busy_s, measure, until
from bench.results import LIVE, put

if TYPE_CHECKING:
    from collections.abc import Sequence

ROUNDS: Final = 3
QUIET: Final = 0.2
"""What others may take of a core before a measurement begins."""

LOOK_S: Final = 1.0
PATIENCE_S: Final = 15.0
SECONDS: Final = 8.0

LOADS: Final = (
    Load(1, 57600, SECONDS),
    Load(1, 921600, SECONDS),
    Load(8, 115200, SECONDS),
    Load(8, 921600, SECONDS),
    Load(8, 921600, SECONDS, "raw"),
    Load(8, 921600, SECONDS, "line"),
    Load(8, 921600, SECONDS, "board"),
    Load(8, 921600, SECONDS, "log"),
    Load(8, 921600, SECONDS, "dead viewer"),
    Load(64, 921600, SECONDS),
)
SHOWN: Final = {
    "quiet": "nothing",
    "raw": "nothing, and raw bytes alone recorded (`--topics raw`)",
    "line": "a line a second",
    "board": "the board on a terminal",
    "log": "a line a frame, to /dev/null",
    "dead viewer": "Rerun, at an address where no viewer is",
}


def wait_for_quiet() -> bool:
    """Wait, but not for ever, until the machine has nothing else to do; tell whether it has."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        before = busy_s()
        time.sleep(LOOK_S)
        if busy_s() - before < QUIET * LOOK_S:
            return True
    return False


def naive() -> float:
    """Return what a loop of pySerial's ``read(1)`` takes for one fast line, in percent of a core.

    Raises:
        RuntimeError: it has lost bytes.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        writer = Writer(folder, 1, 921600, SECONDS)
        out = folder / "heard.txt"
        loop = subprocess.Popen(
            [sys.executable, "-m", "bench.naive", writer.ports[0], "921600", str(out)]
        )
        try:
            until(out.exists, loop)
            time.sleep(SETTLES_S)
            before = Work.of(loop.pid, writer.pid)
            writer.say()
            said = writer.said()
            work = Work.of(loop.pid, writer.pid).since(before)
            time.sleep(0.3)
            loop.terminate()
            loop.wait(WAIT_S)
            heard = int(out.read_text(encoding="ascii"))
        finally:
            loop.kill()
            loop.wait()
            writer.close()
        if heard != said.size:
            raise RuntimeError(f"the loop has heard {heard} of {said.size} bytes")
        return 100 * work.recorder / said.seconds


def write() -> None:
    """Measure all of it, and put it into RESULTS.md."""
    found: dict[Load, list[Figures]] = {load: [] for load in LOADS}
    loops: list[float] = []
    for _ in range(ROUNDS):
        for load, figures in found.items():
            wait_for_quiet()
            figures.append(measure(load))
            sys.stderr.write(f"{_row(load, figures[-1:])}\n")
        loops.append(naive())
        sys.stderr.write(f"read(1): {loops[-1]:.0f} %\n")
    put(_lines(found, loops), title=f"{LIVE}: what")


def _lines(found: dict[Load, list[Figures]], loops: Sequence[float]) -> list[str]:
    one = next(figures for load, figures in found.items() if load.buses == 1 and load.baud > 57600)
    fast = statistics.median(loops)
    beside = [f.others for figures in found.values() for f in figures]
    loads = [f.load for figures in found.values() for f in figures]
    held = statistics.median(f.writer_late[0] for figures in found.values() for f in figures)
    cores = len(os.sched_getaffinity(0))
    blocked = max(f.writer_blocked_ms for figures in found.values() for f in figures)
    return [
        f"{LIVE}: what recording costs, and how late stamps are",
        "",
        (
            f"`python -m bench.live_results`; medians of {ROUNDS} runs of {SECONDS:.0f} s in "
            f"turns; Python {platform.python_version()}, {platform.machine()}, "
            f"{platform.system()}. Lines under full load, no pause between two frames, on ptys; a "
            "process of its own writes a millisecond's bytes at a time. *Core* is what the "
            "recorder takes, in percent of one core, *reader* the part of its other threads. "
            "*Stamp late* is from the beginning of the write with a read's last byte to its stamp "
            f"(the end of the write is {_gap(found):.3f} ms closer), *unread* from a write's "
            "beginning until its last byte is stamped: p50 / p99 / worst."
        ),
        "",
        "| lines | shown | lost | core % | reader % | stamp late ms | unread ms | peak MB |",
        "|---|---|---|---|---|---|---|---|",
        *(_row(load, figures) for load, figures in found.items()),
        "",
        (
            f"pySerial's `read(1)` in a loop that stamps each byte and does nothing else takes "
            f"{fast:.0f} % for one line at 921600: {fast / _median(one, 'cpu'):.1f} times what "
            "recording and decoding it takes."
        ),
        "",
        (
            f"Beside this, other programs took {min(beside):.0f} to {max(beside):.0f} % of a core "
            f"(load average {min(loads):.1f} to {max(loads):.1f}, {cores} cores). The recorder "
            f"held the writer up by {blocked:.0f} ms at most; of the slices 99 % were written no "
            f"later than {held:.1f} ms after their time (median of the runs: what is late here "
            "comes in larger lumps)."
        ),
        "",
    ]


def _gap(found: dict[Load, list[Figures]]) -> float:
    gaps = [
        most - least
        for figures in found.values()
        for f in figures
        for most, least in [(f.stamp_most[0], f.stamp_least[0])]
    ]
    return statistics.median(gaps)


def _median(figures: Sequence[Figures], name: str) -> float:
    return statistics.median(float(getattr(f, name)) for f in figures)


def _three(figures: Sequence[Figures], name: str) -> str:
    columns = zip(*(getattr(f, name) for f in figures), strict=True)
    return " / ".join(f"{statistics.median(column):.1f}" for column in columns)


def _row(load: Load, figures: Sequence[Figures]) -> str:
    lost = sum(f.written - f.recorded for f in figures)
    if not all(f.same and f.status == 0 for f in figures) and not lost:
        raise RuntimeError(f"{load}: other bytes than were said")
    core = f"{_median(figures, 'cpu'):.1f}"
    if (beside := _median(figures, "beside")) >= 0.5:
        core += f" + {beside:.1f} beside"
    return (
        f"| {load.buses} at {load.baud} | {SHOWN[load.view]} | {lost} | {core} | "
        f"{_median(figures, 'reader'):.1f} | {_three(figures, 'stamp_most')} | "
        f"{_three(figures, 'waited')} | {_median(figures, 'peak_mb'):.0f} |"
    )


if __name__ == "__main__":
    write()
