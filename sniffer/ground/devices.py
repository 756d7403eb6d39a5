"""Which files are devices that somebody speaks through."""

from __future__ import annotations

import os
import stat
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from pathlib import Path

_PTY_MAJORS: Final = range(136, 144)
"""Device numbers of the slaves of pseudo-terminals.
Source: Linux, Documentation/admin-guide/devices.txt, 136-143 char."""

_PORTS: Final = ("tty", "cu.", "rfcomm")
"""How the names of serial ports begin: Linux, macOS, and what Bluetooth's serial profile makes."""


def is_pseudo(status: os.stat_result) -> bool:
    """Tell by its device number whether a file is the slave of a pseudo-terminal.

    Other systems than Linux do not say so: there everything is taken for a serial port.
    """
    is_linux = os.name == "posix" and os.uname().sysname == "Linux"
    return is_linux and stat.S_ISCHR(status.st_mode) and os.major(status.st_rdev) in _PTY_MAJORS


def is_port(path: Path, status: os.stat_result) -> bool:
    """Tell whether a file is a serial port, or a terminal that stands for one; none is opened."""
    if not stat.S_ISCHR(status.st_mode):
        return False
    return path.resolve().name.startswith(_PORTS) or is_pseudo(status)
