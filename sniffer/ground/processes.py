"""Which processes are gone: what they left unfinished is nobody's any more."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path


def is_gone(process: int) -> bool:
    """Tell whether a process of this machine has ended, as far as that can be asked."""
    if os.name != "posix":  # elsewhere 0 kills
        return False
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return True
    except PermissionError:
        return False
    return _is_corpse(process)


def _is_corpse(process: int) -> bool:
    """Tell whether a process has ended, and nobody has asked yet how (proc(5), stat: Z, X)."""
    with contextlib.suppress(OSError):  # there is no /proc but on Linux
        told = Path(f"/proc/{process}/stat").read_text(encoding="utf-8", errors="replace")
        return told.rpartition(")")[2].split()[0] in "ZX"
    return False
