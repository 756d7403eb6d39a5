"""Recording live: fully loaded buses on ptys, what it costs and how late the stamps are.

``python -m bench.live [--buses 8] [--seconds 10] [--baud 921600]``. A writer process plays
simulated traffic to the ptys in slices of a millisecond, as USB adapters deliver it; ``sniffer
record`` listens. Compared afterwards: every byte, and when it was written with when it was stamped.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import resource
import subprocess
import sys
import tempfile
import time
import tty
from pathlib import Path
from typing import Any, Final

import numpy as np

from sniffer.simulation import BUSES, simulate
from sniffer.sources.mcap import groups, session

SLICE_S: Final = 0.001


def traffic(protocol: str, baud: int, seconds: float, seed: int) -> bytes:
    """Return what a bus says when its controller asks as fast as it can."""
    frames = simulate(protocol, seed=seed, baud=baud, rate_hz=100_000, duration_s=seconds)
    return b"".join(f.wire for f in frames)


def play(buses: int, seconds: float, baud: int, out: Path) -> None:
    """Write to ptys at full rate; leave behind when each byte was written, and the paths."""
    names = list(BUSES)
    streams, masters, slaves = [], [], []
    for i in range(buses):
        part = traffic(names[i % len(names)], baud, 2.0, i)
        need = int(baud / 10 * seconds)
        streams.append((part * (need // len(part) + 1))[:need])
        master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        masters.append(master)
        slaves.append(slave)
    paths = [os.ttyname(s) for s in slaves]
    print(json.dumps({"ports": paths, "protocols": [names[i % len(names)] for i in range(buses)]}))
    sys.stdout.flush()
    sys.stdin.readline()  # until somebody listens
    done = [0] * buses
    log: list[tuple[int, int, int]] = []
    began = time.monotonic()
    late = 0.0
    while any(d < len(s) for d, s in zip(done, streams, strict=True)):
        due = int((time.monotonic() - began) * baud / 10)
        for i, (master, stream) in enumerate(zip(masters, streams, strict=True)):
            end = min(due, len(stream))
            if end > done[i]:
                try:
                    done[i] += os.write(master, stream[done[i] : end])
                except BlockingIOError:
                    late = max(late, (due - done[i]) * 10 / baud)
                    continue
                log.append((i, done[i], time.monotonic_ns()))
        time.sleep(SLICE_S)
    table = np.array(log, np.int64)
    np.save(out, table)
    took = time.monotonic() - began
    print(json.dumps({"bytes": sum(done), "seconds": took, "blocked_s": late}))
    sys.stdout.flush()
    sys.stdin.readline()


def measure(buses: int, seconds: float, baud: int, *more: str) -> dict[str, Any]:
    """Record what a writer plays; return the figures."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        log, run = folder / "log.npy", folder / "run.mcap"
        arguments = ["--play", str(log), "--buses", str(buses)]
        arguments += ["--seconds", str(seconds), "--baud", str(baud)]
        writer = subprocess.Popen(
            [sys.executable, "-m", "bench.live", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert writer.stdin is not None
        assert writer.stdout is not None
        told = json.loads(writer.stdout.readline())
        ports = [
            f"b{i}={port}={protocol}@{baud}"
            for i, (port, protocol) in enumerate(zip(told["ports"], told["protocols"], strict=True))
        ]
        recorder = subprocess.Popen(
            [sys.executable, "-m", "sniffer", "record", *ports, "--idle", "2", "-o", str(run), *more]
        )
        while not run.exists():
            time.sleep(0.05)
        time.sleep(0.7)
        used = _cpu(recorder.pid)
        writer.stdin.write("\n")
        writer.stdin.flush()
        end = json.loads(writer.stdout.readline())
        time.sleep(0.2)
        used = _cpu(recorder.pid) - used
        status = recorder.wait(60)
        writer.stdin.write("\n")
        writer.stdin.flush()
        writer.wait(10)
        peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
        facts = session(run)
        offset = int(facts["clock_wall_ns"]) - int(facts["clock_monotonic_ns"])
        late, size = _lateness(run, np.load(log), buses, offset)
        return {
            "buses": buses,
            "status": status,
            "bytes_written": end["bytes"],
            "bytes_recorded": size,
            "cpu_percent": 100 * used / end["seconds"],
            "lateness_ms": [float(x) for x in np.percentile(late, [50, 99, 100]) / 1e6],
            "file_bytes": run.stat().st_size,
            "peak_kb": peak,
            "writer_blocked_s": end["blocked_s"],
        }


def _cpu(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _lateness(run: Path, log: Any, buses: int, offset: int) -> tuple[Any, int]:
    """Return for each chunk how much later it was stamped than its last byte was written."""
    ends: dict[str, list[tuple[int, int]]] = {f"b{i}": [] for i in range(buses)}
    at = dict.fromkeys(ends, 0)
    for group in groups(run):
        for chunk in group:
            at[chunk.bus] += len(chunk.data)
            ends[chunk.bus].append((at[chunk.bus], chunk.t_ns or 0))
    late = []
    for i in range(buses):
        mine = log[log[:, 0] == i]
        stamps = np.array(ends[f"b{i}"], np.int64).reshape(-1, 2)
        k = np.searchsorted(mine[:, 1], stamps[:, 0], "left")
        late.append(stamps[:, 1] - offset - mine[np.minimum(k, len(mine) - 1), 2])
    return np.concatenate(late), sum(at.values())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--buses", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--baud", type=int, default=921600)
    parser.add_argument("--play", type=Path)
    chosen, more = parser.parse_known_args()
    if chosen.play is not None:
        play(chosen.buses, chosen.seconds, chosen.baud, chosen.play)
    else:
        random.seed(0)
        print(json.dumps(measure(chosen.buses, chosen.seconds, chosen.baud, *more)))


if __name__ == "__main__":
    main()
