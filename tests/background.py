"""Commands of a page that go on in the background: what they print first, and behind that."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from pathlib import Path

OVER_S: Final = 180.0
"""How long a command may take to say something, to record something, or to end."""


def lines_of(text: str) -> list[str]:
    """Return lines as a page has them: no blanks at their ends, none of them empty at the end."""
    return [line.rstrip() for line in text.rstrip().splitlines()]


@dataclass(slots=True)
class Job:
    """A command in the background; ``shown`` of its lines are on the page already."""

    process: subprocess.Popen[bytes]
    output: Path
    shown: int = 0

    def first(self, least: int = 1) -> list[str]:
        """Return what it prints first, once there are so many lines, and whole ones."""
        deadline = time.monotonic() + OVER_S
        while self._whole() < least and self.process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.02)
        lines = self._lines()
        self.shown = len(lines)
        return lines

    def rest(self) -> list[str]:
        """Return what it prints behind that, once it has ended."""
        self.process.wait(OVER_S)
        return self._lines()[self.shown :]

    def kill(self, number: int) -> None:
        """Send a signal to it, and to all that it has started; wait until it has ended."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, number)
        self.process.wait(OVER_S)

    def end(self) -> None:
        """End it, and all that it has started."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGTERM)
        try:
            self.process.wait(OVER_S)
        except subprocess.TimeoutExpired:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()

    def _whole(self) -> int:
        return self.output.read_bytes().count(b"\n")

    def _lines(self) -> list[str]:
        return lines_of(self.output.read_text(encoding="utf-8"))
