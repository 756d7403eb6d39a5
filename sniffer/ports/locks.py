"""Who has locked a port: flock(2), as pySerial and this program use it, seen from outside.

The kernel lists all locks, so a port that is in use can be refused without being opened; opening
it would already raise its modem lines.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Final

_FLOCK: Final = re.compile(
    r"^\d+: FLOCK +\w+ +\w+ +(-?\d+) ([0-9a-f]+):([0-9a-f]+):(\d+) ", re.MULTILINE
)


def locked_by(found: os.stat_result, root: Path = Path("/proc")) -> int | None:
    """Return the process that holds a lock on a file; 0 where it cannot be seen, None for none."""
    try:
        text = (root / "locks").read_text(encoding="utf-8")
    except OSError:
        return None
    here = (os.major(found.st_dev), os.minor(found.st_dev), found.st_ino)
    for pid, major, minor, inode in _FLOCK.findall(text):
        if (int(major, 16), int(minor, 16), int(inode)) == here:
            return max(0, int(pid))
    return None


def program(pid: int, root: Path = Path("/proc")) -> str:
    """Return a process as people know it."""
    try:
        name = (root / str(pid) / "comm").read_text(encoding="utf-8", errors="replace").strip()
    except OSError:  # it has ended, or is in another container
        return "another program"
    return f"{name if name.isprintable() else ascii(name)} (process {pid})"
