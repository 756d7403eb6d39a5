"""Ask a driver directly, past ``sniffer``: ``asks.py count|hold|bauds PORT ...``."""

from __future__ import annotations

import contextlib
import fcntl
import os
import struct
import sys
import termios
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable

TERMIOS2: Final = struct.Struct("=4IB19s2I")
TCGETS2, TCSETS2 = 0x802C542A, 0x402C542B
NAMES: Final = (
    *("cts", "dsr", "rng", "dcd", "rx", "tx"),
    *("frame", "overrun", "parity", "brk", "buf_overrun"),
)
BAUDS: Final = (9600, 57600, 74880, 76800, 100000, 115200, 250000, 1000000, 3000000, 4000000)


def opened(path: str, flags: int = os.O_RDONLY) -> int:
    """Open a port as a program does that is no terminal's."""
    return os.open(path, flags | os.O_NOCTTY | os.O_NONBLOCK)


def count(path: str) -> None:
    """Print the driver's counters."""
    try:
        record = fcntl.ioctl(opened(path), termios.TIOCGICOUNT, bytes(80))
    except OSError as error:
        print(error.strerror)
        return
    print(dict(zip(NAMES, struct.unpack("=20i", record), strict=False)))


def hold(path: str, how: str) -> None:
    """Keep a port open: ``plain``, ``excl`` or ``flock``, at 57600 without an echo."""
    fd = opened(path, os.O_RDWR)
    record = list(TERMIOS2.unpack(fcntl.ioctl(fd, TCGETS2, bytes(44))))
    record[2], record[3] = 0o10000 | 0o60 | 0o200 | 0o4000, 0
    record[6] = record[7] = 57600
    fcntl.ioctl(fd, TCSETS2, TERMIOS2.pack(*record))
    if how == "excl":
        fcntl.ioctl(fd, termios.TIOCEXCL)
    if how == "flock":
        fcntl.flock(fd, fcntl.LOCK_EX)
    Path("/tmp/held").touch()
    while not Path("/tmp/let-go").exists():
        time.sleep(0.05)
    record = list(TERMIOS2.unpack(fcntl.ioctl(fd, TCGETS2, bytes(44))))
    lines = int.from_bytes(fcntl.ioctl(fd, termios.TIOCMGET, bytes(4)), "little")
    up = [n for bit, n in ((termios.TIOCM_DTR, "DTR"), (termios.TIOCM_RTS, "RTS")) if lines & bit]
    print(record[6], *up)


def bauds(path: str) -> None:
    """Print what the driver reports for each of some baud rates."""
    fd = opened(path)
    out = []
    for baud in BAUDS:
        asked = TERMIOS2.pack(0, 0, 0o10000 | 0o60 | 0o200 | 0o4000, 0, 0, bytes(19), baud, baud)
        fcntl.ioctl(fd, TCSETS2, asked)
        got = TERMIOS2.unpack(fcntl.ioctl(fd, TCGETS2, bytes(44)))[6]
        out.append(f"{baud}" if got == baud else f"{baud}->{got}")
    print(*out)


def main() -> None:
    """Do what the first word says."""
    with contextlib.suppress(KeyboardInterrupt):
        asked: dict[str, Callable[..., None]] = {"count": count, "hold": hold, "bauds": bauds}
        asked[sys.argv[1]](*sys.argv[2:])


if __name__ == "__main__":
    main()
