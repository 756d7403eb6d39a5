"""A way out that may be given up: a terminal that stands still, a pipe that nobody reads."""

from __future__ import annotations

import contextlib
import os
import select
import time
from typing import Final, TextIO

PIECE: Final = 512
"""Bytes of one write: a pipe that can be written to at all takes so many without blocking (the
least ``PIPE_BUF`` of POSIX)."""

LOOK_S: Final = 0.02
"""Time between two looks at the deadline."""


class StalledError(OSError):
    """Nobody takes what is written, and there is no time left to wait."""


class Outlet:
    """A text stream to the file of another one that waits, but not longer than ``deadline``.

    It has a descriptor and a buffer of its own: a stalled write through ``sys.stdout`` would hold a
    lock that the interpreter wants at its end. A terminal is opened anew where that is possible, so
    that its writes can be made not to block without changing how others write to it.
    """

    def __init__(self, stream: TextIO) -> None:
        stream.flush()
        self.encoding = stream.encoding or "utf-8"
        self.deadline: float | None = None
        """By ``time.monotonic``; None: there is no hurry."""
        self._is_terminal = stream.isatty()
        self._held: list[str] = []
        self._stream: TextIO | None = None
        self._poll = None
        try:
            fd = stream.fileno()
        except OSError:  # it has no file and cannot stall
            self._stream, self._fd = stream, -1
            return
        self._fd = _own(fd, is_terminal=self._is_terminal)
        if hasattr(select, "poll"):  # Windows can ask sockets only: there a write may block
            self._poll = select.poll()
            self._poll.register(self._fd, select.POLLOUT)

    def write(self, text: str) -> int:
        """Keep a text until ``flush``."""
        self._held.append(text)
        return len(text)

    def flush(self) -> None:
        """Write what is kept.

        Raises:
            StalledError: nobody took it until the deadline.
            OSError: nobody reads it any more.
        """
        text = "".join(self._held)
        self._held.clear()
        if self._stream is not None:
            self._stream.write(text)
            self._stream.flush()
            return
        data = text.encode(self.encoding, "replace")
        while data:
            self._wait()
            try:
                data = data[os.write(self._fd, data[:PIECE]) :]
            except BlockingIOError:
                time.sleep(LOOK_S)
                self._hurry()

    def try_write(self, text: str) -> None:
        """Write a text at once, as much of it as is taken without waiting."""
        if self._stream is None and (self._poll is None or self._poll.poll(0)):
            with contextlib.suppress(OSError):
                os.write(self._fd, text.encode(self.encoding, "replace"))

    def let_go(self) -> None:
        """Let a terminal that somebody has stopped with Ctrl-S go on, as shells do at a prompt."""
        if self._poll is not None and not self._poll.poll(0) and self.is_ours():
            import termios  # Windows has none, and no poll

            with contextlib.suppress(OSError, termios.error):
                termios.tcflow(self._fd, termios.TCOOFF)  # else the other one does nothing
                termios.tcflow(self._fd, termios.TCOON)

    def is_ours(self) -> bool:
        """Tell whether the terminal is not somebody else's: in the background it is the shell's."""
        try:
            return os.tcgetpgrp(self._fd) == os.getpgrp()
        except (AttributeError, OSError):  # not the terminal we were started from
            return True

    def forget(self) -> None:
        """Forget what is kept and not written."""
        self._held.clear()

    def close(self) -> None:
        """Give the descriptor back; what is kept is not written."""
        self.forget()
        if self._stream is None:
            os.close(self._fd)

    def isatty(self) -> bool:
        """Tell whether it is a terminal."""
        return self._is_terminal

    def fileno(self) -> int:
        """Return the descriptor."""
        return self._fd

    def size(self) -> tuple[int, int]:
        """Return columns and lines."""
        try:
            columns, lines = os.get_terminal_size(self._fd)
        except OSError:
            columns, lines = 0, 0
        return columns or 80, lines or 24  # a terminal that does not know says 0

    def _wait(self) -> None:
        while self._poll is not None and not self._poll.poll(LOOK_S * 1000):
            self._hurry()

    def _hurry(self) -> None:
        if self.deadline is not None and time.monotonic() >= self.deadline:
            raise StalledError("nobody takes what is written")


def write_within(stream: TextIO, text: str, timeout_s: float) -> bool:
    """Write a text, and tell whether somebody took all of it in time."""
    try:
        out = Outlet(stream)
    except OSError:
        return False
    try:
        out.deadline = time.monotonic() + timeout_s
        out.write(text)
        out.flush()
    except OSError:
        return False
    finally:
        out.close()
    return True


def _own(fd: int, *, is_terminal: bool) -> int:
    if is_terminal and hasattr(os, "ttyname"):
        with contextlib.suppress(OSError):  # it may belong to somebody else
            return os.open(os.ttyname(fd), os.O_WRONLY | os.O_NOCTTY | os.O_NONBLOCK)
    return os.dup(fd)
