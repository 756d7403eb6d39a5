"""Hours of recording in minutes: the real recorder, decoders and file; a clock that never sleeps.

``python -m bench.hours [--hours 1] [--buses 1] [--baud 57600]``. What the recorder does takes as
long as it takes; where it would sleep until its next round, the clock is put forward instead. So
every read, round, decoding pass and second of the statistics of an hour happens, as on a line that
is loaded all the time; only the reader thread and the kernel are left out.
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
import tempfile
import time
import tracemalloc
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np

from bench.lines import PART_S, SLICE_S, protocol_of, traffic
from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.ground.model import NS
from sniffer.mcapfile import sink, turns
from sniffer.mcapfile.rotation import RotatingMcap
from sniffer.ports.unmark import Unmarker
from sniffer.tap import recorder
from sniffer.tap.events import Read
from sniffer.tap.stops import Stops
from sniffer.tap.tap import PortSpec, Tap

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.decoding.sink import Sink
    from sniffer.ground.model import Mark
    from sniffer.ports import Port
    from sniffer.tap.reader import Anchor, Listener

START_NS: Final = 1_795_215_306 * NS
SAMPLE_S: Final = 10.0
"""How often the memory is looked at."""

SLICE_NS: Final = int(SLICE_S * NS)
HOUR_S: Final = 3600.0


class Leaping:
    """Stands for the module ``time``: it goes on while work is done, and leaps over sleep."""

    def __init__(self) -> None:
        self.skipped_ns = 0
        self._began = time.monotonic_ns()

    def monotonic_ns(self) -> int:
        return time.monotonic_ns() + self.skipped_ns

    def monotonic(self) -> float:
        return self.monotonic_ns() / NS

    def sleep(self, seconds: float) -> None:
        self.skipped_ns += int(seconds * NS)

    def now(self) -> int:
        """Return Unix time, as an ``Anchor`` does."""
        return self.monotonic_ns() - self._began + START_NS


class Line:
    """A line under full load, read once a millisecond; it says the same again and again."""

    def __init__(self, number: int, baud: int) -> None:
        data = traffic(protocol_of(number), baud, PART_S, number)
        cuts = [n * baud // 10_000 for n in range(int(PART_S / SLICE_S) + 1)]
        parts = (data[a:b] for a, b in itertools.pairwise(cuts))
        self._reads = [part.replace(b"\xff", b"\xff\xff") for part in parts]
        self._number = number
        self._coming = self._all()
        self._next = next(self._coming)

    def _all(self) -> Iterator[Read]:
        for n, data in enumerate(itertools.cycle(self._reads), 1):
            yield Read(self._number, START_NS + n * SLICE_NS, data)

    def until(self, now_ns: int) -> Iterator[Read]:
        while self._next.t_ns <= now_ns:
            yield self._next
            self._next = next(self._coming)


class Queued:
    """Stands for the listener: hands over what was said since."""

    died = None

    def __init__(self, lines: Sequence[Line], clock: Leaping) -> None:
        self._lines = lines
        self._clock = clock

    @property
    def heard_ns(self) -> int:
        return self._clock.now()

    def drain(self) -> list[Read]:
        now = self._clock.now()
        return [read for line in self._lines for read in line.until(now)]

    def stop(self) -> None:
        """Do nothing: no thread runs."""


class Escaped:
    """Stands for the port of a line."""

    marks_errors = True
    counts_errors = False

    def __init__(self, baud: int) -> None:
        self.baud = baud
        self._unmarker = Unmarker(widen=False)

    def unmark(self, raw: bytes) -> tuple[bytes, tuple[Mark, ...]]:
        return self._unmarker.take(raw)

    def counters(self) -> None:
        return None


@dataclass(slots=True)
class Hours:
    """What was seen: memory by time, work, and what was recorded."""

    seconds: float = 0.0
    cpu_s: float = 0.0
    bytes: int = 0
    file_mb: float = 0.0
    rounds: int = 0
    rss_mb: list[tuple[float, float]] = field(default_factory=list)

    @property
    def growth_mb(self) -> float:
        """The slope of the second half, in MB an hour."""
        late = np.array([row for row in self.rss_mb if row[0] >= self.seconds / 2])
        return float(np.polyfit(late[:, 0], late[:, 1], 1)[0] * HOUR_S) if len(late) > 2 else 0.0


def run(
    seconds: float,
    buses: int,
    baud: int,
    *,
    more: Sequence[Sink] = (),
    folder: Path | None = None,
    **options: Any,
) -> Hours:
    """Record so long; return what was seen."""
    with tempfile.TemporaryDirectory(dir=folder) as name:
        lines = [Line(n, baud) for n in range(buses)]
        clock, seen = Leaping(), Hours()
        for module in (recorder, sink, turns):
            module.time = clock  # type: ignore[attr-defined]
        try:
            names = [f"b{n}" for n in range(buses)]
            protocols = {bus: protocol_of(n) for n, bus in enumerate(names)}
            told = {f"protocol.{bus}": p for bus, p in protocols.items()}
            facts = told | {f"baud.{bus}": str(baud) for bus in names}
            file = RotatingMcap(Path(name) / "run.mcap", facts, now=clock.monotonic_ns, **options)
            pipeline = Pipeline(
                Options(
                    protocols=protocols, bauds=dict.fromkeys(names, baud), latency_ns=2_000_000
                ),
                [file, *more],
                live=True,
            )
            due = 0.0

            def look(it: recorder.Recorder) -> None:
                nonlocal due
                seen.rounds += 1
                seen.seconds = (clock.now() - START_NS) / NS
                if seen.seconds >= due:
                    due += SAMPLE_S
                    seen.rss_mb.append((seen.seconds, resident_mb()))

            taps = [
                Tap(PortSpec(bus, bus, protocols[bus], baud), cast("Port", Escaped(baud)))
                for bus in names
            ]
            it = recorder.Recorder(
                cast("Listener", Queued(lines, clock)),
                taps,
                cast("Anchor", clock),
                pipeline,
                file,
                Stops(duration_ns=int(seconds * NS)),
                on_round=look,
                latency_ns=2_000_000,
            )
            used = time.process_time()
            it.run()
            seen.cpu_s = time.process_time() - used
            pipeline.close()
            pipeline.finish()
            seen.bytes = sum(tap.bytes for tap in taps)
            seen.file_mb = file.size / 1e6
        finally:
            for module in (recorder, sink, turns):
                module.time = time  # type: ignore[attr-defined]
        return seen


def resident_mb() -> float:
    """Return what this process holds in memory."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * 4096 / 1e6


def main() -> None:
    """Run as the arguments say."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--buses", type=int, default=1)
    parser.add_argument("--baud", type=int, default=57600)
    parser.add_argument("--grown", action="store_true", help="tell what holds what has grown")
    given = parser.parse_args()
    seconds = given.hours * HOUR_S
    if given.grown:
        tracemalloc.start(12)
    seen = run(seconds, given.buses, given.baud)
    told = {
        "seconds": seen.seconds,
        "bytes": seen.bytes,
        "cpu_percent": 100 * seen.cpu_s / seen.seconds,
        "file_mb": seen.file_mb,
        "rounds": seen.rounds,
        "first_mb": seen.rss_mb[0][1],
        "last_mb": seen.rss_mb[-1][1],
        "growth_mb_per_hour": seen.growth_mb,
    }
    sys.stdout.write(json.dumps(told) + "\n")


if __name__ == "__main__":
    main()
