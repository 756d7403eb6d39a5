"""What a recorder takes beside the plain way to listen, both in one run.

``python -m bench.beside --buses 8 --seconds 10`` records full lines at 921600 while a loop of
pySerial's ``read(1)`` stamps one more (``bench.naive``). Machines and hours differ, so only the
ratio of the two counts. Tells in JSON, with the processor time of each thread of the recorder: the
worker first, then as they were started: the diagnosis is last.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final

from bench.lines import WAIT_S, Writer, protocol_of
from bench.live import SETTLES_S, TAIL_S, Work, lateness, reads_of, shown, spread, until
from sniffer.mcapfile.source import session

BAUD: Final = 921600


def beside(buses: int, seconds: float) -> dict[str, Any]:
    """Run both; return the figures: seconds of a processor, ratios, ms.

    Raises:
        RuntimeError: one of them has other bytes than were said.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run, heard = folder / "run.mcap", folder / "heard.txt"
        (folder / "one").mkdir()
        many = Writer(folder, buses, BAUD, seconds)
        one = Writer(folder / "one", 1, BAUD, seconds)
        ports = [f"b{n}={port}={protocol_of(n)}@{BAUD}" for n, port in enumerate(many.ports)]
        command = [sys.executable, "-m", "sniffer", "record", *ports, "-o", str(run)]
        plain = [sys.executable, "-m", "bench.naive", one.ports[0], str(BAUD), str(heard)]
        loop = subprocess.Popen(plain)
        try:
            with shown(command, "quiet") as recorder:
                until(run.exists, recorder)
                until(heard.exists, loop)
                time.sleep(SETTLES_S)
                before, loop_before = Work.of(recorder.pid, many.pid), Work.of(loop.pid, one.pid)
                threads = _threads(recorder.pid)
                one.say()
                many.say()
                said, one_said = many.said(), one.said()
                time.sleep(TAIL_S)
                work = Work.of(recorder.pid, many.pid).since(before)
                loop_work = Work.of(loop.pid, one.pid).since(loop_before)
                took = {t: ran - threads.get(t, 0.0) for t, ran in _threads(recorder.pid).items()}
                recorder.terminate()
                recorder.wait(WAIT_S)
            loop.terminate()
            loop.wait(WAIT_S)
            facts = session(run)
            offset = int(facts["clock_wall_ns"]) - int(facts["clock_monotonic_ns"])
            sizes, stamps = reads_of(run, offset)
            plainly = int(heard.read_text(encoding="ascii"))
            if sum(sizes.values()) != said.size or plainly != one_said.size:
                raise RuntimeError("other bytes than were said")
            most, _, waited = lateness(said, stamps)
            return {
                "recorder_s": work.recorder,
                "loop_s": loop_work.recorder,
                "ratio": work.recorder / loop_work.recorder,
                "threads_s": [round(took[t], 2) for t in sorted(took)],
                "reads_per_s": sum(map(len, stamps.values())) / said.seconds,
                "stamp_late_ms": spread(most),
                "unread_ms": spread(waited),
                "file_per_raw": run.stat().st_size / said.size,
            }
        finally:
            loop.kill()
            loop.wait()
            many.close()
            one.close()


def _threads(pid: int) -> dict[int, float]:
    """Return how long each thread of a process has run, in seconds."""
    tasks = Path(f"/proc/{pid}/task").iterdir()
    return {
        int(task.name): int((task / "schedstat").read_text(encoding="ascii").split()[0]) / 1e9
        for task in tasks
    }


def main() -> None:
    """Measure what the arguments say."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--buses", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=10)
    given = parser.parse_args()
    sys.stdout.write(json.dumps(beside(given.buses, given.seconds)) + "\n")


if __name__ == "__main__":
    main()
