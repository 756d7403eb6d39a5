"""``python -m bench.fleet`` (``make bench-fleet``): what a data set costs, into bench/FLEET.md.

What is compared is measured in one run on the same captures. Where nothing is compared it is the
processor's time, and a fixed loop says how fast the machine was.
"""

from __future__ import annotations

import argparse
import os
import platform
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bench.streams import STREAMS
from sniffer.decoding.options import Options
from sniffer.fleet.dataset import CaptureList, commit
from sniffer.fleet.engines import cores
from sniffer.fleet.inputs import find_captures
from sniffer.fleet.recipe import decoder_name, write_recipe
from sniffer.fleet.rows import OK, CaptureRow, CaptureTask
from sniffer.fleet.run import decode_fleet, tasks_of
from sniffer.fleet.store import Store
from sniffer.fleet.task import decode_batch

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

FLEET: Final = Path(__file__).parent / "FLEET.md"

SMALL: Final = 10_000
"""Bytes of a small capture."""

TOGETHER: Final = 8
"""Small captures of a batch; a run has up to 64."""

PIECE: Final = 50_000_000
"""Bytes of which a huge capture is made: over and over the same."""

ADDITIONS: Final = 10_000_000


@dataclass(frozen=True)
class Amounts:
    """How much is measured."""

    captures: int = 200
    size: int = 5_000_000
    small: int = 100
    done: int = 10_000
    table: int = 20_000_000
    huge: int = 1_000_000_000
    rounds: int = 3


QUICK: Final = Amounts(
    captures=8, size=300_000, small=12, done=300, table=400_000, huge=95_000_000, rounds=1
)


def main() -> None:
    """Measure, and write FLEET.md; a quick run is printed."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="small amounts, printed")
    parser.add_argument("--captures", type=int, help="how many captures of 5 MB")
    parser.add_argument("--huge", type=int, metavar="MB", help="how large a huge capture is")
    parser.add_argument("--rounds", type=int, help="how often each is measured")
    parser.add_argument("--only", choices=PARTS, nargs="+", help="rows that are printed, alone")
    told = parser.parse_args()
    amounts = QUICK if told.quick else Amounts()
    amounts = replace(
        amounts,
        captures=told.captures or amounts.captures,
        huge=told.huge * 1_000_000 if told.huge else amounts.huge,
        rounds=told.rounds or amounts.rounds,
    )
    page = "\n".join(_page(amounts, told.only or tuple(PARTS))) + "\n"
    if told.quick or told.only:
        sys.stdout.write(page)
    else:
        FLEET.write_text(page, encoding="utf-8")


def _page(amounts: Amounts, parts: Sequence[str]) -> Iterator[str]:
    yield "# What a data set of captures costs"
    yield ""
    yield (
        f"`make bench-fleet`, one run; Python {platform.python_version()}, {platform.machine()}, "
        f"{platform.system()}, {cores()} cores, on which {ADDITIONS // 1_000_000} M additions in a "
        f"loop take {_loop():.2f} s. Streams: `bench/streams.py`, one byte in a thousand altered, "
        "without times. Times are the processor's where nothing else is said."
    )
    yield ""
    yield "| | measured | aim |"
    yield "|---|---|---|"
    with tempfile.TemporaryDirectory() as folder:
        for part in parts:
            yield from PARTS[part](Path(folder), amounts)


def _loop() -> float:
    began = time.process_time()
    total = 0
    for n in range(ADDITIONS):
        total += n
    return time.process_time() - began


def written(folder: Path, count: int, size: int) -> Path:
    """Write captures of all protocols in turn, each with other bytes."""
    streams = {name: STREAMS[name](2 * size + 100 * count) for name in STREAMS}
    names = list(streams)
    for nth in range(count):
        robot = folder / f"robot=r{nth % 10}"
        robot.mkdir(parents=True, exist_ok=True)
        at = 37 * nth
        data = streams[names[nth % len(names)]][at : at + size]
        (robot / f"{nth:05d}.bin").write_bytes(data)
    return folder


def _workers(place: Path, amounts: Amounts) -> Iterator[str]:
    """Measure one worker against two on captures of one size."""
    inputs = written(place / "big", amounts.captures, amounts.size)
    told = _one_and_two(inputs, place / "data", amounts.captures * amounts.size, amounts.rounds)
    yield f"| 1 to 2 workers, {amounts.captures} x {amounts.size / 1e6:g} MB | {told} | >= 1.8x |"


def _huge(place: Path, amounts: Amounts) -> Iterator[str]:
    """Measure one worker against two on one capture, which they decode together."""
    inputs = place / "huge.bin"
    with inputs.open("wb") as file:
        while file.tell() < amounts.huge:
            file.write(STREAMS["mightyzap"](min(amounts.huge, PIECE)))
    told = _one_and_two(inputs, place / "together", inputs.stat().st_size, amounts.rounds)
    inputs.unlink()
    yield f"| 1 to 2 workers, one capture of {amounts.huge / 1e6:g} MB | {told} | >= 1.7x |"


def _one_and_two(inputs: Path, data: Path, size: int, rounds: int) -> str:
    """Measure one worker against two, in turns, each into a data set of its own."""
    took: dict[int, list[float]] = {1: [], 2: []}
    for _ in range(rounds):
        for workers, times in took.items():
            done = decode_fleet([inputs], data, workers=workers)
            if not done.is_whole or done.failures:
                sys.exit(f"not all captures were decoded: {done}")
            times.append(done.seconds)
            shutil.rmtree(data)
    ratio = statistics.median(took[1]) / statistics.median(took[2])
    rate = size / 1e6 / statistics.median(took[2])
    return f"{ratio:.2f}x ({rate:.1f} MB/s with two)"


def _tasks(inputs: Path, dataset: Path, protocol: str = "auto") -> list[CaptureTask]:
    store = Store.of(dataset)
    recipe = write_recipe(Options(protocol=protocol), None, "auto")
    found = find_captures([inputs], store).captures
    return tasks_of(found, store, recipe, decoder_name(recipe), lambda capture: "r")


def _took(tasks: list[CaptureTask], together: int = 1) -> list[float]:
    """Decode captures here, so many a batch; return the processor's time of one in s, of each."""
    out = []
    for nth in range(0, len(tasks), together):
        batch = tasks[nth : nth + together]
        began = time.process_time()
        decode_batch(batch)
        out += [(time.process_time() - began) / len(batch)] * len(batch)
    return out


def _tables(place: Path, amounts: Amounts) -> Iterator[str]:
    """Measure one capture of each protocol, from file to its four tables."""
    total = 0.0
    for name, stream in STREAMS.items():
        file = place / "whole" / f"{name}.bin"
        file.parent.mkdir(exist_ok=True)
        file.write_bytes(stream(amounts.table))
        (task,) = _tasks(file, place / "tables")
        size = file.stat().st_size / 1e6
        seconds = statistics.median(_took([task] * amounts.rounds))
        total += seconds / size
        yield f"| four tables, {name}, {size:.1f} MB | {size / seconds:.1f} MB/s a core | |"
    rate = len(STREAMS) / total
    yield f"| four tables, as much of each | {rate:.1f} MB/s a core | >= 8 MB/s |"


def _small(place: Path, amounts: Amounts) -> Iterator[str]:
    """Measure captures that are so small that what each costs by itself shows."""
    inputs = written(place / "small", amounts.small, SMALL)
    for how in ("auto", "named"):
        took = []
        for nth, name in enumerate(STREAMS):
            tasks = _tasks(inputs, place / how, name if how == "named" else "auto")
            mine = sorted(tasks, key=lambda task: Path(task.uri).name)[nth :: len(STREAMS)]
            _took(mine[:1])  # it loads what the others find
            took += _took(mine[1:], TOGETHER)
        ms = statistics.median(took) * 1e3
        told = "protocol found" if how == "auto" else "protocol named"
        yield f"| a capture of {SMALL // 1000} kB, {told} | {ms:.1f} ms | <= 10 ms |"


def _skipped(place: Path, amounts: Amounts) -> Iterator[str]:
    """Measure a run that finds everything done: the whole command, in its own process."""
    inputs = written(place / "done", amounts.done, 100)
    dataset = place / "dataset"
    decode_fleet([inputs / "robot=r0" / "00000.bin"], dataset)
    store = Store.of(dataset)
    (row,) = (CaptureRow.from_json(p.read_text()) for p in (dataset / "_done").iterdir())
    whose = {f"r{nth}": nth for nth in range(10)}
    recipe = write_recipe(Options(), None, "auto")
    tasks = tasks_of(
        find_captures([inputs], store).captures,
        store,
        recipe,
        decoder_name(recipe),
        lambda capture: next(r for r in whose if f"/robot={r}/" in capture.uri),
    )
    for task in tasks:
        named = replace(row, path=task.path, robot=task.robot, fingerprint=task.fingerprint)
        commit(store, replace(named, status=OK))
    CaptureList(store).write()
    command = [sys.executable, "-m", "sniffer", "fleet", str(inputs), "-o", str(dataset)]
    took, walls = [], []
    for _ in range(amounts.rounds):
        began, at = os.times(), time.monotonic()
        told = subprocess.run(command, capture_output=True, check=True).stdout.decode()
        ended = os.times()
        walls.append(time.monotonic() - at)
        took.append(sum(ended[2:4]) - sum(began[2:4]))
        if f"(0 decoded, {amounts.done} there already)" not in told:
            sys.exit(f"not all of it was skipped: {told}")
    cpu, wall = statistics.median(took), statistics.median(walls)
    took_s = f"{cpu:.2f} s ({wall:.2f} s by the clock)"
    yield f"| {amounts.done} captures skipped, whole command | {took_s} | <= 2 s |"


def _start(place: Path, amounts: Amounts) -> Iterator[str]:
    """Measure the time by the clock from the call to the first capture, which is small."""
    inputs = written(place / "first", 1, SMALL)
    took = [decode_fleet([inputs], place / f"first{n}").seconds for n in range(amounts.rounds)]
    first = f"{statistics.median(took):.2f} s"
    yield f"| the first capture of `local`, by the clock | {first} | <= 0.5 s |"


PARTS: Final[Mapping[str, Callable[[Path, Amounts], Iterator[str]]]] = {
    "workers": _workers,
    "huge": _huge,
    "tables": _tables,
    "small": _small,
    "skipped": _skipped,
    "start": _start,
}
"""What is measured, each a few rows of the page."""


if __name__ == "__main__":
    main()
