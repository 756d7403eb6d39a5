"""``python -m bench.small``: what is done often, or waited for, in turns with a fixed loop.

Figures are the processor's time. A loop of additions is measured beside each, so that runs on
machines of other speeds can be compared: what counts is the last column.
"""

from __future__ import annotations

import io
import os
import pty
import select
import signal
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import pyarrow as pa

from bench.results import put
from bench.streams import STREAMS
from sniffer.decoding.decoder import Decoder
from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.ground.model import Chunk, Clock
from sniffer.ground.timing import byte_time_ns
from sniffer.protocols import PROTOCOLS
from sniffer.selection.selection import Selection
from sniffer.sinks.relations import RELATIONS
from sniffer.sinks.tables import parquet_writer

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from sniffer.ground.model import Batch
    from sniffer.protocols.base import BusProtocol

TITLE: Final = "## What is done often"
ROUNDS: Final = 7
SMALL: Final = 10_000
LARGE: Final = 4_000_000
BLOCK: Final = 1 << 18
MILLION: Final = 12_500_000
"""Bytes of a stream of a million frames."""

ADDITIONS: Final = 1_000_000
LINE: Final = 48
"""Bytes of a log's line."""

TABLES: Final = ("samples", "frames", "transactions", "anomalies")
PATIENCE_S: Final = 60

SELECTIONS: Final = {
    "servo_id = 3": "frames",
    "servo_id IN (1, 2, 3) AND op = 'load_data'": "transactions",
    "register = 'present_position' AND value > 12": "samples",
}


def loop() -> float:
    """Return what the fixed loop takes."""
    began = time.process_time()
    total = 0
    for n in range(ADDITIONS):
        total += n
    return time.process_time() - began


def beside(act: Callable[[], object]) -> tuple[float, float]:
    """Return the least time of an act, and how many times that of the loop beside it."""
    act()
    took, loops = [], []
    for _ in range(ROUNDS):
        loops.append(loop())
        began = time.process_time()
        act()
        took.append(time.process_time() - began)
    return min(took), min(took) / min(loops)


def log(name: str, data: bytes) -> list[Chunk]:
    """Return a stream as the lines of a log, each with its time."""
    byte_ns = byte_time_ns(PROTOCOLS[name].baud)
    ends = range(LINE, len(data) + LINE, LINE)
    return [Chunk(data[e - LINE : e], e * byte_ns * 6 // 5, Clock.FILE) for e in ends]


def decoded(chunks: Sequence[Chunk], protocol: str, sinks: Sequence[Any] = ()) -> None:
    """Decode chunks through the pipeline."""
    pipeline = Pipeline(Options(protocol=protocol), list(sinks))
    pipeline.feed(chunks)
    pipeline.close()
    pipeline.finish()


class FourTables:
    """A sink that packs the tables of a capture into memory."""

    def __init__(self) -> None:
        self._parts: dict[str, list[Any]] = {name: [] for name in TABLES}

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing."""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Add the rows of a batch."""
        for name, parts in self._parts.items():
            parts.append(RELATIONS[name].build(bus, protocol, batch))

    def close(self) -> None:
        """Pack them."""
        for parts in self._parts.values():
            whole = pa.concat_tables(parts).unify_dictionaries()
            with parquet_writer(io.BytesIO(), whole.schema) as writer:
                writer.write_table(whole)


def captures() -> Iterator[str]:
    """Yield a row for each way in which a small capture is decoded."""
    for name in STREAMS:
        data = STREAMS[name](2 * SMALL)[SMALL // 3 :][:SMALL]
        for form, chunks in (("no times", [Chunk(data)]), ("a log", log(name, data))):
            for protocol in ("auto", name):
                took, times = beside(lambda c=chunks, p=protocol: decoded(c, p))  # type: ignore[misc]
                told = "found" if protocol == "auto" else "named"
                yield f"| 10 kB of {name}, {form}, {told} | {took * 1e3:.1f} ms | {times:.2f} |"


def tables() -> Iterator[str]:
    """Yield a row for the four tables of each protocol, and how that compares with decoding."""
    for name in STREAMS:
        data = STREAMS[name](LARGE)
        chunks = [Chunk(data[a : a + BLOCK]) for a in range(0, LARGE, BLOCK)]

        def core(name: str = name, chunks: Sequence[Chunk] = chunks) -> None:
            decoder = Decoder(name)
            for chunk in chunks:
                decoder.feed(chunk)
            decoder.close()

        def whole(name: str = name, chunks: Sequence[Chunk] = chunks) -> None:
            pipeline = Pipeline(Options(protocol=name), [FourTables()])
            for chunk in chunks:
                pipeline.feed([chunk])
            pipeline.close()
            pipeline.finish()

        alone, _ = beside(core)
        took, times = beside(whole)
        told = f"{LARGE / took / 1e6:.1f} MB/s, {took / alone:.2f} times decoding alone"
        yield f"| four tables of {name}, packed | {told} | {times / LARGE * 1e6:.2f} a MB |"


def selections() -> Iterator[str]:
    """Yield a row for what a selection costs of a batch of some ten rows."""
    chunks = log("mightyzap", STREAMS["mightyzap"](4 * SMALL))
    decoder = Decoder("mightyzap")
    batches = [decoder.feed(*chunks[k : k + 4]) for k in range(0, len(chunks), 4)]
    batches = [b for b in batches if len(b.frames)]
    for text, table in SELECTIONS.items():
        selection = Selection.parse(text)

        def select(selection: Selection = selection, table: str = table) -> None:
            for batch in batches:
                selection.rows("bus0", PROTOCOLS["mightyzap"], batch)(table)

        took, times = beside(select)
        n = len(batches)
        each = statistics.mean(
            selection.rows("", PROTOCOLS["mightyzap"], b)(table).size for b in batches
        )
        told = f"{took / n * 1e6:.1f} us for {each:.0f} {table}"
        yield f'| `--where "{text}"` | {told} | {times / n * 1e3:.2f} thousandths |'


def first_screen() -> Iterator[str]:
    """Yield a row for the work until a million frames show their first lines."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "million.bin"
        path.write_bytes(STREAMS["mightyzap"](MILLION))
        took = [_until_shown(path) for _ in range(3)]
    times = min(took) / min(loop() for _ in range(ROUNDS))
    yield f"| `sniffer open`, a million frames, first screen | {min(took):.2f} s | {times:.1f} |"


def _until_shown(path: Path) -> float:
    pid, screen = pty.fork()
    if not pid:
        os.environ["TERM"] = "xterm-256color"
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # as where it is installed
        os.execv(sys.executable, [sys.executable, "-m", "sniffer", "open", str(path)])
    said = b""
    until = time.monotonic() + PATIENCE_S
    try:
        while b"line 1 of" not in said:
            if time.monotonic() > until:
                raise TimeoutError("the first screen did not come")
            if select.select([screen], [], [], 0.01)[0]:
                said += os.read(screen, 1 << 16)
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    finally:
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
        os.close(screen)


def small_rows() -> list[str]:
    """Measure all of it; return the section."""
    lines = [
        TITLE,
        "",
        "The processor's time, the least of some rounds; *loops* is how many times that of adding",
        f"{ADDITIONS // 1_000_000} M numbers in a loop of Python, measured in turns with it.",
        "",
        "| | | loops |",
        "|---|---|---|",
    ]
    for rows in (captures, tables, selections, first_screen):
        for row in rows():
            sys.stderr.write(f"{row}\n")
            lines.append(row)
    return [*lines, ""]


if __name__ == "__main__":
    put(small_rows(), title=TITLE)
