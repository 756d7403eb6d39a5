"""How long the threads that read have waited for a processor: the kernel's own account of it.

A thread that was woken but not scheduled looks, from inside, like one that waited for a quiet line.
Linux counts the time between the two (``/proc/PID/task/TID/schedstat``, its second number, in ns;
Documentation/scheduler/sched-stats.rst). Elsewhere nothing is known of it.
"""

from __future__ import annotations

import contextlib
import os
import threading
from typing import Final

_PROC: Final = "/proc/self/task"


class Account:
    """The waiting of the calling thread and of the main one, which may keep the interpreter.

    Use it in the thread that is meant, with ``with``.
    """

    def __init__(self) -> None:
        self._files: list[int] = []
        self._before = 0

    def __enter__(self) -> Account:
        for thread in {threading.get_native_id(), os.getpid()}:
            with contextlib.suppress(OSError):  # not Linux, or no /proc
                self._files.append(os.open(f"{_PROC}/{thread}/schedstat", os.O_RDONLY))
        self._before = self._total()
        return self

    def __exit__(self, *_: object) -> None:
        for file in self._files:
            os.close(file)
        self._files.clear()

    def since(self) -> int:
        """Return how long they have waited since this was asked last, in ns; 0 where none knows."""
        if not self._files:
            return 0
        now = self._total()
        waited, self._before = now - self._before, now
        return max(waited, 0)

    def _total(self) -> int:
        total = 0
        for file in self._files:
            with contextlib.suppress(OSError, ValueError, IndexError):
                total += int(os.pread(file, 128, 0).split()[1])
        return total
