"""``python -m bench`` (``make bench``): every figure in one run, as ratios, into bench/RESULTS.md.

Medians of several rounds; what is compared is measured in turns, so that a machine whose speed
drifts moves both sides.
"""

from __future__ import annotations

import argparse
import os
import platform
import re
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

from bench.one_by_one import one_by_one
from bench.results import NOTES, RESULTS, live
from bench.small import small_rows
from bench.streams import STREAMS, hostile
from bench.tshark import tshark_rows
from sniffer.decoding.decoder import Decoder
from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.decoding.reference import Reference
from sniffer.ground.model import Batch, Chunk
from sniffer.protocols import PROTOCOLS
from sniffer.sinks import open_sink

if TYPE_CHECKING:
    from collections.abc import Callable

    from sniffer.decoding.pairing import Paired
    from sniffer.ground.framing import Block

BLOCK = 1 << 18
SIZES = {"mightyzap": 20_000_000, "wck": 5_000_000, "rs30x": 5_000_000, "lss": 5_000_000}
SLOW = 150_000
ROUNDS = 5


class FramesOnly(Decoder):
    """The decoder without values and anomalies: frames with fields, times and gaps.

    Which request an answer belongs to is among it: it decides where a block may be cut.
    """

    def _records(self, block: Block, batch: Batch, paired: Paired) -> Batch:
        return batch


def timed(act: Callable[..., int], *given: object, rounds: int = ROUNDS) -> tuple[float, int]:
    """Return the median time of ``act(*given)`` in seconds, and what it returned."""
    took, n = [], 0
    for _ in range(rounds):
        began = time.perf_counter()
        n = act(*given)
        took.append(time.perf_counter() - began)
    return statistics.median(took), n


def blocks(make: type[Decoder], name: str, data: bytes) -> int:
    """Decode in blocks with a new decoder; return the number of frames."""
    decoder = make(name)
    parts = (decoder.feed(Chunk(data[a : a + BLOCK])) for a in range(0, len(data), BLOCK))
    return sum(len(b.frames) for b in parts) + len(decoder.close().frames)


def as_objects(name: str, data: bytes) -> int:
    """Decode with the reference, whole."""
    return len(Reference(PROTOCOLS[name]).decode([Chunk(data)]).frames)


def grammar_framing(name: str, data: bytes) -> int:
    """Frame with the construct grammar alone, interpreted, one parse an offset that may begin."""
    protocol = PROTOCOLS[name]
    n = at = 0
    while at < len(data):
        found = protocol.slow_parse(data, at, len(data))
        if found is None:
            at += 1
            continue
        n += len(found)
        at = found[-1][1]
    return n


_LINE = re.compile(rb"([#*])(\d{1,3})([A-Z]+)(-?\d+)?((?:[A-Z]+\d+)*)\r")


def regex_and_tuples(data: bytes) -> int:
    """Decode LSS the way a script would: one regular expression, a tuple a line."""
    out = [
        (m.start(), m[1] == b"#", int(m[2]), m[3].decode(), int(m[4]) if m[4] else None, m[5])
        for m in _LINE.finditer(data)
    ]
    return len(out)


def core_rows(lines: list[str]) -> None:
    lines += [
        "## The core",
        "",
        "Frames a second. *Grammar* is interpreted construct framing alone; *objects* is the",
        "reference decoder whole (framing, pairing, values, one object a frame).",
        "",
        (
            "| protocol | MB | frames | frames, fields, times, gaps | whole core | MB/s whole | "
            "/ grammar (frames) | / grammar (whole) | / objects (whole) |"
        ),
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name, size in SIZES.items():
        data = STREAMS[name](size)
        part = data[:SLOW]
        slow, n_slow = timed(grammar_framing, name, part, rounds=3)
        objects, n_objects = timed(as_objects, name, part, rounds=3)
        frames, n = timed(blocks, FramesOnly, name, data)
        whole, _ = timed(blocks, Decoder, name, data)
        grammar, object_rate = n_slow / slow, n_objects / objects
        lines.append(
            f"| {name} | {len(data) / 1e6:.0f} | {n} | {n / frames / 1e6:.2f} M | "
            f"{n / whole / 1e6:.2f} M | {len(data) / whole / 1e6:.0f} | "
            f"{n / frames / grammar:.0f}x | {n / whole / grammar:.0f}x | "
            f"{n / whole / object_rate:.0f}x |"
        )
        say(lines[-1])
    data = STREAMS["lss"](SIZES["lss"])
    script, n_script = timed(regex_and_tuples, data)
    frames, n = timed(blocks, FramesOnly, "lss", data)
    ratio = n / frames / (n_script / script)
    told = (
        "LSS against one regular expression that makes a tuple a line "
        f"({n_script / script / 1e6:.2f} M lines/s): frames {ratio:.1f}x."
    )
    lines += ["", told, ""]
    say(told)


def damage_rows(lines: list[str]) -> None:
    """Measure what damage costs: every gap and anomaly is an object, and tells its numbers."""
    lines += [
        "## What damage costs (20 MB mightyZAP, whole core)",
        "",
        "| corrupt bytes | gaps | anomalies | M frames/s | / grammar |",
        "|---|---|---|---|---|",
    ]
    for share in (0.0, 0.0001, 0.001):
        data = STREAMS["mightyzap"](SIZES["mightyzap"], share)
        slow, n_slow = timed(grammar_framing, "mightyzap", data[:SLOW], rounds=3)
        whole, n = timed(blocks, Decoder, "mightyzap", data)
        decoder = Decoder("mightyzap")
        parts = [decoder.feed(Chunk(data[a : a + BLOCK])) for a in range(0, len(data), BLOCK)]
        gaps = sum(len(b.gaps) for b in parts)
        told = sum(len(b.anomalies) for b in parts)
        ratio = (n / whole) / (n_slow / slow)
        lines.append(f"| {share:.2%} | {gaps} | {told} | {n / whole / 1e6:.2f} | {ratio:.0f}x |")
        say(lines[-1])
    lines.append("")


def hostile_rows(lines: list[str]) -> None:
    lines += [
        "## Hostile input, whole core, MB/s",
        "",
        "| protocol | noise | one byte | headers | header-heavy | nested |",
        "|---|---|---|---|---|---|",
    ]
    for name in SIZES:
        cells = []
        for data in hostile(name, 2_000_000).values():
            took, _ = timed(blocks, Decoder, name, data, rounds=3)
            cells.append(f"{len(data) / took / 1e6:.1f}")
        lines.append(f"| {name} | {' | '.join(cells)} |")
        say(lines[-1])
    lines.append("")


def to_file(data: bytes, path: Path) -> int:
    """Run the stream through the pipeline into a file."""
    pipeline = Pipeline(Options(protocol="mightyzap"), [open_sink(path, {"tool": "bench"})])
    for a in range(0, len(data), BLOCK):
        pipeline.feed([Chunk(data[a : a + BLOCK])])
    pipeline.close()
    pipeline.finish()
    return len(data)


def file_rows(lines: list[str]) -> None:
    data = STREAMS["mightyzap"](SIZES["mightyzap"])
    core, _ = timed(blocks, Decoder, "mightyzap", data, rounds=3)
    lines += [
        "## Raw file to file (20 MB mightyZAP)",
        "",
        "| output | s | / core alone |",
        "|---|---|---|",
        f"| none (core) | {core:.2f} | 1.0 |",
    ]
    with tempfile.TemporaryDirectory() as folder:
        for suffix in (".parquet", ".mcap", ".rrd", ".jsonl"):
            path = Path(folder) / f"out{suffix}"
            took, _ = timed(to_file, data, path, rounds=3)
            lines.append(f"| {suffix} | {took:.2f} | {took / core:.1f} |")
            say(lines[-1])
        one, part = timed(one_by_one, data[:1_000_000], Path(folder) / "slow.mcap", rounds=3)
        bulk, n = timed(to_file, data, Path(folder) / "bulk.mcap", rounds=3)
    told = (
        f"The same records with one protobuf message and one writer call each: "
        f"{part / one / 1e6:.2f} MB/s; in bulk {n / bulk / 1e6:.1f} MB/s: "
        f"{(n / bulk) / (part / one):.1f}x."
    )
    lines += ["", told, ""]
    say(told)


SMALL = Path(__file__).parent.parent / "sample_captures" / "mightyzap_clean.log"

STARTS = {
    "python -c pass": ["-c", "pass"],
    "python -c 'import numpy'": ["-c", "import numpy"],
    "python -c 'import sniffer'": ["-c", "import sniffer"],
    "sniffer --help": ["-m", "sniffer", "--help"],
    "sniffer decode SMALL --quiet": ["-m", "sniffer", "decode", str(SMALL), "--quiet"],
}
"""What a user waits for, and beside it what cannot be waited less for."""


def start_rows(lines: list[str]) -> None:
    """Measure the work of starting: user and system time, the machine may be busy."""
    # as where it is installed: modules are not compiled anew with each start
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    took = dict.fromkeys(STARTS, 0.0)
    rounds: list[dict[str, float]] = []
    for _ in range(ROUNDS):
        for name, arguments in STARTS.items():
            before = _of_children()
            subprocess.run(
                [sys.executable, *arguments],
                env=environment,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                check=True,
            )
            took[name] = _of_children() - before
        rounds.append(dict(took))
    bare, numpy = list(STARTS)[:2]
    lines += [
        "## Start",
        "",
        f"Work of a whole process; SMALL is a log of {SMALL.stat().st_size // 1000} kB.",
        "",
        "| | s | / bare interpreter | / interpreter with numpy |",
        "|---|---|---|---|",
    ]
    for name in STARTS:
        s, least, reckons = (statistics.median(r[n] for r in rounds) for n in (name, bare, numpy))
        lines.append(f"| `{name}` | {s:.2f} | {s / least:.1f} | {s / reckons:.1f} |")
        say(lines[-1])
    lines.append("")


def _of_children() -> float:
    """Return the seconds of a processor that processes took which have ended; finer than ticks."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def say(line: str) -> None:
    sys.stderr.write(line + "\n")


def main() -> None:
    """Measure everything and write the results."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    versions = f"Python {platform.python_version()}, {platform.machine()}, {platform.system()}"
    lines = [
        "# What was measured",
        "",
        f"`make bench`, one run, medians; {versions}. Use the ratios, not the absolute figures.",
        "Streams: `bench/streams.py`, one byte in a thousand corrupted.",
        "",
    ]
    core_rows(lines)
    damage_rows(lines)
    hostile_rows(lines)
    file_rows(lines)
    lines += tshark_rows()
    start_rows(lines)
    lines += small_rows()
    # what is measured on live recordings has programs of its own, and stays
    parts = ["\n".join(lines).rstrip() + "\n", *live(), NOTES.read_text(encoding="utf-8")]
    RESULTS.write_text("\n".join(parts), encoding="utf-8")


if __name__ == "__main__":
    main()
