"""Keys of the terminal that the board stands on: read without waiting, given back as it was.

Ctrl-C, Ctrl-Z and Ctrl-S go on doing what they do. Without a terminal, or on a system that knows no
modes of terminals, there are no keys.
"""

from __future__ import annotations

import contextlib
import os
import re
from typing import Any, Final

_NAMED: Final = {
    "\x1b[A": "up",
    "\x1b[B": "down",
    "\x1bOA": "up",
    "\x1bOB": "down",
    "\r": "enter",
    "\n": "enter",
    "\x1b": "esc",
    "\x7f": "backspace",
    "\x08": "backspace",
    "\x15": "clear",
    " ": "space",
}
"""What keys send (xterm's control sequences), by the name of the key."""

_KEY: Final = re.compile(r"\x1b[\[O][0-9;]*[A-Za-z~]|\x1b|[^\x1b]", re.DOTALL)


def keys_in(text: str) -> list[str]:
    """Return the keys that a text from a terminal stands for; others than letters by their names.

    Sequences of keys that the board does not know are left out, with all of their letters.
    """
    found = [_NAMED.get(key, key) for key in _KEY.findall(text) if key in _NAMED or len(key) == 1]
    return [key for key in found if key.isprintable()]


class Keyboard:
    """The keys of one terminal; ``fd`` is a descriptor of it."""

    def __init__(self, fd: int) -> None:
        self._fd = -1
        self._before: list[Any] | None = None
        if hasattr(os, "ttyname"):
            with contextlib.suppress(OSError):  # it may belong to somebody else
                flags = os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK
                self._fd = os.open(os.ttyname(fd), flags)

    def take(self) -> None:
        """Have keys come one by one, and not be echoed; again is no change."""
        if self._fd < 0 or self._before is not None:
            return
        import termios

        with contextlib.suppress(termios.error):
            before = termios.tcgetattr(self._fd)
            modes = [*before[:6], [*before[6]]]
            modes[3] &= ~(termios.ICANON | termios.ECHO)
            modes[6][termios.VMIN], modes[6][termios.VTIME] = 0, 0
            termios.tcsetattr(self._fd, termios.TCSANOW, modes)
            self._before = before

    def give_back(self) -> None:
        """Make the terminal what it was; it waits for nothing."""
        before, self._before = self._before, None
        if before is not None:
            import termios

            with contextlib.suppress(termios.error):
                termios.tcsetattr(self._fd, termios.TCSANOW, before)

    def forget(self) -> None:
        """Leave the terminal as it is: it is somebody else's."""
        self._before = None

    def read(self) -> list[str]:
        """Return the keys that were pressed since, none where the keys are not ours."""
        if self._before is None:
            return []
        with contextlib.suppress(OSError):  # nothing was pressed, or the terminal is gone
            return keys_in(os.read(self._fd, 1024).decode("utf-8", "ignore"))
        return []

    def close(self) -> None:
        """Give all back."""
        self.give_back()
        fd, self._fd = self._fd, -1
        if fd >= 0:
            os.close(fd)
