"""A port recorded beside the screen, by a process of its own: what is shown is its file.

A screen that hangs or is closed takes nothing from the recording; and what is shown is what is on
the disk.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from typing import TYPE_CHECKING, Final

from sniffer.ground.model import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

OPENS_S: Final = 30.0
"""How long a port may take until its recording is there; a rate that is looked for needs some."""

ENDS_S: Final = 10.0
"""How long a recorder may take to finish its file."""

LOOK_S: Final = 0.05

SAID_MOST: Final = 2000
"""Of what a recorder says, the last characters are looked at."""


class BesideRecorder:
    """``sniffer record`` while the screen is there.

    Args:
        arguments: what it is called with: a port, and where to.
        path: of the recording, as they say it.

    Raises:
        InputError: the port cannot be recorded; the message is the recorder's own.
    """

    def __init__(self, arguments: Sequence[str], path: Path) -> None:
        self.path = path
        self._last = ""
        self._said = tempfile.TemporaryFile(prefix="sniffer-")  # noqa: SIM115 - as long as this
        # a session of its own: Ctrl-C and a closed terminal are the screen's to answer
        self._process = subprocess.Popen(
            [sys.executable, "-m", "sniffer", "record", *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=self._said,
            start_new_session=True,
        )
        try:
            self._wait()
        except BaseException:
            self.stop()
            raise

    def _wait(self) -> None:
        """Wait until the recording has begun."""
        end = time.monotonic() + OPENS_S
        while not (self.path.exists() and self.path.stat().st_size):
            if self._process.poll() is not None:
                raise InputError(self.said or "the port cannot be recorded")
            if time.monotonic() > end:
                raise InputError(f"nothing was recorded within {OPENS_S:.0f} s: {self.said}")
            time.sleep(LOOK_S)

    @property
    def said(self) -> str:
        """The last line that the recorder has said, its name aside."""
        if self._said.closed:
            return self._last
        size = os.fstat(self._said.fileno()).st_size
        text = os.pread(self._said.fileno(), SAID_MOST, max(size - SAID_MOST, 0))
        lines = text.decode(errors="replace").strip().splitlines()
        return lines[-1].removeprefix("sniffer: ") if lines else ""

    @property
    def has_ended(self) -> bool:
        """Whether it records no more."""
        return self._process.poll() is not None

    def stop(self) -> None:
        """End the recording; the file is whole afterwards, or can be mended."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)
            try:
                self._process.wait(ENDS_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        self._last = self.said
        self._said.close()
