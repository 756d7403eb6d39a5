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

from sniffer.ground.model import NS

LOOK_S: Final = 0.05
"""How long a silent line is waited for at most before it is said that nothing came."""

LATE_NS: Final = 3_000_000
"""Bytes that may have been there for longer than this are said to be held: beyond what a breath and
the worker's turns cost."""

UNSAID_NS: Final = 2 * LATE_NS
"""By how much a read may be late that is not said to be held: once until the thread that reads is
awake, and once while it reads the ports before. Which of two ports was read first is chance then.
"""

WOKEN_NS: Final = 10_000_000
"""The kernel was waited for, not the other threads, where it took longer than this."""

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


class Backlog:
    """Bytes of one line that waited while nobody read: the system hands them out in pieces.

    A terminal gives 4 kB at a time, and a worker of the kernel moves up what stands behind. What a
    read gives was waiting, too, as long as it is more than the line carries in the time since the
    read before, and no more than it carried in the time for which nobody read.
    """

    def __init__(self) -> None:
        self._left_ns = 0
        self._since_ns = self._read_ns = 0

    def held(self, took_ns: int, now_ns: int, held_ns: int) -> int:
        """Return how long bytes may have waited that are read now, ``held_ns`` at least.

        ``took_ns`` is how long the line takes for them.
        """
        if self._left_ns > 0 and took_ns > now_ns - self._read_ns + LATE_NS:
            held_ns = max(held_ns, now_ns - self._since_ns)
        else:
            self._left_ns, self._since_ns = held_ns, now_ns - held_ns
        self._left_ns -= took_ns
        self._read_ns = now_ns
        return held_ns


def held_since(before: int, looked: int, came: int) -> int:
    """Return how long bytes may have waited to be read.

    Nobody looked from ``before``, when the last round saw what there was, until ``looked``; from
    then on the kernel was waited for, until ``came``.
    """
    waited = came - looked
    if waited > LOOK_S * NS + LATE_NS:
        return came - before  # it should have come back sooner: the whole program stood still
    if waited > WOKEN_NS or came - before <= LATE_NS:
        return 0  # nothing was there when it was asked, and it came as soon as something was
    return came - before
