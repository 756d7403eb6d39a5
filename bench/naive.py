"""The plain way to listen: a byte a call, each with its time; what that costs beside the recorder.

``python -m bench.naive PORT BAUD OUT`` reads until SIGTERM, and leaves the number of bytes in OUT.
Nothing is decoded and nothing recorded.
"""

from __future__ import annotations

import signal
import sys
import time
from pathlib import Path
from typing import NoReturn

import serial


def main() -> None:
    """Read a byte at a time."""
    port, baud, out = sys.argv[1], int(sys.argv[2]), Path(sys.argv[3])
    heard: list[tuple[int, bytes]] = []

    def stop(number: int, frame: object) -> NoReturn:
        Path(out).write_text(str(len(heard)), encoding="ascii")
        raise SystemExit

    signal.signal(signal.SIGTERM, stop)
    with serial.Serial(port, baud) as line:
        out.write_text("", encoding="ascii")  # it listens
        while True:
            byte = line.read(1)
            heard.append((time.time_ns(), byte))


if __name__ == "__main__":
    main()
