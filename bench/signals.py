"""``python -m bench.signals`` (``make bench-signals``): levels to bytes, beside sigrok-cli.

One session, read in turns in one run by both: a mightyZAP bus at 115200 baud, sampled at 1 MHz.
What is compared is the processor's time from the file to its bytes. We find rate, polarity and
channel; sigrok-cli is told them, and what it takes to start is measured alone and left out.
"""

from __future__ import annotations

import argparse
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.streams import STREAMS
from sniffer.sources import open_source
from tests.waves import Wire, sampled, sr

if TYPE_CHECKING:
    from collections.abc import Callable

    from sniffer.ground.model import U8

BAUD: Final = 115_200
RATE: Final = 1_000_000
SIZE: Final = 100_000
ROUNDS: Final = 3
PULSE: Final = 2
"""Samples of a glitch: a quarter of a bit."""


def main() -> None:
    """Print what both take, and whether their bytes are the same."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--size", type=int, default=SIZE, help="bytes that are said")
    size = parser.parse_args().size
    if shutil.which("sigrok-cli") is None:
        sys.exit("sigrok-cli is not installed: there is nothing to compare with")
    data = STREAMS["mightyzap"](size)[:size]
    wire = Wire(0.001)
    for at in range(0, size, 10):
        wire.say(data[at : at + 10], BAUD, after=0.0003)
    wire.now += 0.001
    levels = sampled(wire, RATE)
    with tempfile.TemporaryDirectory() as folder:
        clean = sr(Path(folder) / "clean.sr", {"D0": levels}, RATE)
        noisy = sr(Path(folder) / "noisy.sr", {"D0": _with_glitches(levels, size // 50)}, RATE)
        empty = sr(Path(folder) / "empty.sr", {"D0": levels[:1000]}, RATE)
        theirs, took_sigrok = _took(_theirs, clean)
        took_sigrok -= _took(_theirs, empty)[1]
        ours, _ = _took(_ours, clean)
        took = statistics.median(_took(_ours, clean)[1] for _ in range(ROUNDS))
        same = ours == data == theirs
        heard = [_wrong(read(noisy), data) for read in (_ours, _theirs)]
    sys.stdout.write(
        f"{size} bytes at {BAUD} baud, {len(levels) / 1e6:.1f} M samples\n"
        f"sniffer    {took:8.3f} s   {size / took / 1e3:8.1f} kB/s\n"
        f"sigrok-cli {took_sigrok:8.3f} s   {size / took_sigrok / 1e3:8.1f} kB/s\n"
        f"ratio      {took_sigrok / took:8.0f}     bytes equal: {same}\n"
        f"with {size // 50} glitches: {heard[0]} bytes wrong, of sigrok-cli's {heard[1]}\n"
    )


def _took(read: Callable[[Path], bytes], path: Path) -> tuple[bytes, float]:
    """Return what was read, and the processor's time, ours and that of a program we ran, in s."""
    began = os.times()
    data = read(path)
    return data, sum(os.times()[:4]) - sum(began[:4])


def _ours(path: Path) -> bytes:
    with open_source(path) as opened:
        return b"".join(chunk.data for group in opened for chunk in group)


def _theirs(path: Path) -> bytes:
    told = ("-P", f"uart:rx=D0:baudrate={BAUD}", "-B", "uart=rx")
    command = ["sigrok-cli", "-i", str(path), *told]
    return subprocess.run(command, capture_output=True, check=True).stdout


def _with_glitches(levels: U8, count: int) -> U8:
    rng = np.random.default_rng(7)
    out = levels.copy()
    for at in rng.choice(len(out) - PULSE, count, replace=False).tolist():
        out[at : at + PULSE] ^= 1
    return out


def _wrong(read: bytes, said: bytes) -> int:
    """Return how many bytes differ; those behind one too many or too few are not counted on."""
    wrong, at = 0, 0
    for nth, byte in enumerate(read):
        if at < len(said) and byte == said[at]:
            at += 1
            continue
        wrong += 1
        for step in (1, 0, 2):  # another one in its place, one too many, one too few
            after = said[at + step : at + step + 4]
            if after and read[nth + 1 : nth + 1 + len(after)] == after:
                at += step
                break
        else:
            at += 1
    return wrong


if __name__ == "__main__":
    main()
