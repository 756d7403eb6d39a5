"""``python -m bench.parts`` (``make bench-parts``): one capture by several processes, beside one.

Raw bytes of a bus under full load, one byte in a thousand altered, each output in turns in one run.
``overhead`` is what the processes took in all, beside what one takes: warm-ups, starts, joining.
"""

from __future__ import annotations

import argparse
import resource
import statistics
import sys
import tempfile
import time
from multiprocessing import forkserver
from pathlib import Path
from typing import Final, NamedTuple

from bench.streams import STREAMS
from sniffer.decoding.options import Options
from sniffer.jobs.convert import convert

SIZE_MB: Final = 100
ROUNDS: Final = 3
OUTPUTS: Final = (".jsonl", ".parquet")


class Took(NamedTuple):
    """Seconds by the wall, and of processors."""

    wall_s: float
    cpu_s: float


def main() -> None:
    """Print how much faster several processes are, for each output."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--size", type=float, default=SIZE_MB, help="MB of the capture")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    parser.add_argument("--protocol", default="mightyzap", choices=sorted(STREAMS))
    parser.add_argument("--outputs", nargs="*", default=OUTPUTS)
    told = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "capture.bin"
        source.write_bytes(STREAMS[told.protocol](int(told.size * 1e6)))
        for suffix in told.outputs:
            rounds = [
                [
                    _took(source, told.protocol, Path(folder) / f"out{suffix}", n)
                    for n in (1, told.jobs)
                ]
                for _ in range(told.rounds)
            ]
            faster = statistics.median(one.wall_s / many.wall_s for one, many in rounds)
            more = statistics.median(many.cpu_s / one.cpu_s - 1 for one, many in rounds)
            speed = statistics.median(told.size / one.wall_s for one, _ in rounds)
            sys.stdout.write(
                f"{told.protocol} {told.size:g} MB {suffix}: {speed:.1f} MB/s by one process, "
                f"{faster:.2f} times as fast by {told.jobs}, overhead {more:.1%}\n"
            )


def _took(source: Path, protocol: str, out: Path, jobs: int) -> Took:
    began, spent = time.perf_counter(), _spent()
    convert(source, [out], Options(protocol=protocol), overwrite=True, jobs=jobs)
    took = time.perf_counter() - began
    _end_server()
    return Took(took, _spent() - spent)


def _end_server() -> None:
    """End the process that began the others: only then what they spent counts as ours."""
    # there is no public way; without it processes look as if they cost nothing
    stop = getattr(getattr(forkserver, "_forkserver", None), "_stop", None)
    if stop is None:
        sys.exit("what processes spend cannot be told here")
    stop()


def _spent() -> float:
    """Return the seconds of processors that this process and those it has ended took."""
    who = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN
    return sum(r.ru_utime + r.ru_stime for r in map(resource.getrusage, who))


if __name__ == "__main__":
    main()
