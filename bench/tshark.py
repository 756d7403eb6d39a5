"""A whole process beside another: raw bytes to Parquet here, frames that are cut already to tshark.

``python -m bench.tshark``. tshark cannot find frames in a stream of bytes, pairs nothing and has no
units: it is given a packet a frame, each whole, and a dissector that reads fields and sums up the
checksum (``tuned.lua``). What both took is the processor's time, of all threads, start included.
"""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.results import put
from bench.streams import mightyzap
from sniffer.pcapfile.layout import USER_FIRST

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

TITLE: Final = "## Beside tshark"

SIZE: Final = 20_000_000

FIELDS: Final = (
    "frame.time_epoch",
    *("zap.id", "zap.code", "zap.address", "zap.count", "zap.position", "zap.speed"),
    *("zap.load", "zap.voltage", "zap.good"),
)

LUA: Final = Path(__file__).with_name("tuned.lua")

_PAIR: Final = (9, 15)
"""Bytes of a question and of its answer in the stream."""


def write_cut(path: Path, data: bytes) -> int:
    """Write a pcap with a packet a frame, of a stream without damage; return how many."""
    sizes = [("seconds", "<u4"), ("micros", "<u4"), ("kept", "<u4"), ("length", "<u4")]
    packet = [np.dtype([*sizes, ("frame", f"V{n}")]) for n in _PAIR]
    pairs = np.frombuffer(data, [("asked", f"V{_PAIR[0]}"), ("told", f"V{_PAIR[1]}")])
    out = np.zeros(len(pairs), [("asked", packet[0]), ("told", packet[1])])
    for nth, (name, n) in enumerate(zip(("asked", "told"), _PAIR, strict=True)):
        one, when = out[name], np.arange(len(pairs)) * 400 + 200 * nth
        one["seconds"], one["micros"] = when // 1_000_000, when % 1_000_000
        one["kept"] = one["length"] = n
        one["frame"] = pairs[name]
    head = np.array([0xA1B2C3D4, 4 << 16 | 2, 0, 0, 1 << 16, USER_FIRST], "<u4")
    path.write_bytes(head.tobytes() + out.tobytes())
    return 2 * len(pairs)


def took(*command: str) -> float:
    """Run it to its end; return the seconds of a processor that it took."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        command,
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        check=True,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def rivals(cut: Path) -> Iterator[tuple[str, Sequence[str]]]:
    """Yield what tshark is made to do."""
    read = ("tshark", "-n", "-r", str(cut))
    asked = [part for name in FIELDS for part in ("-e", name)]
    lua = ("-X", f"lua_script:{LUA}")
    yield (
        "tshark, no dissector: a packet's time and bytes",
        (*read, "-T", "fields", "-e", "frame.time_epoch", "-e", "data"),
    )
    yield "tshark, `tuned.lua`, ten fields", (*read, *lua, "-T", "fields", *asked)


def tshark_rows(size: int = SIZE) -> list[str]:
    """Measure; return the section, or nothing where there is no tshark."""
    if shutil.which("tshark") is None:
        return []
    with tempfile.TemporaryDirectory() as folder:
        raw, cut, table = (Path(folder) / name for name in ("a.bin", "a.pcap", "a.parquet"))
        raw.write_bytes(mightyzap(size))
        n = write_cut(cut, mightyzap(size, 0.0))
        here = (sys.executable, "-m", "sniffer", "decode", str(raw), "-q", "--force")
        out = [
            min(took(*here, "--protocol", "mightyzap", "-o", str(table)) for _ in range(3)),
            *(took(*command) for _, command in rivals(cut)),
        ]
    names = ["`sniffer decode a.bin -o a.parquet`", *(name for name, _ in rivals(cut))]
    lines = [
        TITLE,
        "",
        f"The processor's time of whole processes, {size // 1_000_000} MB of mightyZAP. `sniffer`",
        "is given the bytes, one in a thousand corrupted, and writes samples with units and frames",
        "that are paired; tshark is given each frame as a packet, none damaged, and prints fields.",
        "",
        "| | s | M frames/s | / sniffer |",
        "|---|---|---|---|",
    ]
    lines += [
        f"| {name} | {s:.2f} | {n / s / 1e6:.3f} | {s / out[0]:.1f}x |"
        for name, s in zip(names, out, strict=True)
    ]
    for line in lines[-len(names) :]:
        sys.stderr.write(line + "\n")
    return [*lines, ""]


if __name__ == "__main__":
    put(tshark_rows(), title=TITLE)
