"""Commands that a recording runs when something happens: beside it, never in its way.

A thread starts them, waits for them and reads what they say; the recorder only leaves word. Each
has what happened in its environment: ``SNIFFER_CAUSE``, ``SNIFFER_SERVOS`` (ids, blanks between
them), ``SNIFFER_BUS``, ``SNIFFER_T_NS`` (Unix time, in ns) and ``SNIFFER_WHAT``, a sentence.
"""

from __future__ import annotations

import contextlib
import os
import queue
import select
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from sniffer.ground.wording import one_line

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

AT_ONCE: Final = 4
"""Commands that run at the same time; where more are due they wait."""

WAITING: Final = 16
"""Commands that wait at most; where more are due they are left out."""

PAUSE_S: Final = 1.0
"""The least time from one command to the next in the same place of ``AT_ONCE``."""

SAID: Final = 2000
"""Bytes that are kept of what a command says; the rest is read, so that it need not wait."""

END_S: Final = 5.0
"""How long the end of a recording waits for commands that run."""

LOOK_S: Final = 0.1


@dataclass(frozen=True, slots=True)
class Errand:
    """A command that is due; ``on`` is what it was asked for."""

    on: str
    command: str
    environment: Mapping[str, str]


class Commands:
    """Runs shell commands.

    Args:
        tell: takes in a line what a command said.
        warn: takes what went wrong; a command that fails is told once.
    """

    def __init__(self, tell: Callable[[str], None], warn: Callable[[str], None]) -> None:
        self.left_out = 0
        """Runs that were left out: too many were due."""
        self._tell = tell
        self._warn = warn
        self._due: queue.Queue[Errand | None] = queue.Queue(WAITING)
        self._failed: set[str] = set()
        self._threads: list[threading.Thread] = []
        self._running: dict[int, subprocess.Popen[bytes]] = {}
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._busy = 0

    def run(self, errand: Errand) -> None:
        """Have a command run soon; this never waits."""
        try:
            with self._lock:
                self._due.put_nowait(errand)
                self._busy += 1
        except queue.Full:
            self.left_out += 1
            return
        if len(self._threads) < min(AT_ONCE, self._busy):
            thread = threading.Thread(target=self._work, name="command", daemon=True)
            self._threads.append(thread)
            thread.start()

    def close(self) -> None:
        """Wait a little for what runs; what takes longer goes on by itself."""
        self._closing.set()
        deadline = time.monotonic() + END_S
        for _ in self._threads:
            with contextlib.suppress(queue.Full):
                self._due.put(None, timeout=max(0.0, deadline - time.monotonic()))
        for thread in self._threads:
            thread.join(max(0.0, deadline - time.monotonic()))
        with self._lock:
            for process in self._running.values():
                self._tell(f"a command that was started still runs, as process {process.pid}")
                process.returncode = 0  # it is left on purpose: Popen need not warn of it

    def _work(self) -> None:
        while (errand := self._due.get()) is not None:
            began = time.monotonic()
            try:
                self._one(errand)
            except Exception as error:  # a recording does not end because a command cannot be run
                self._fail(errand, f"cannot be run ({error})")
            with self._lock:
                self._busy -= 1
            self._closing.wait(max(0.0, began + PAUSE_S - time.monotonic()))

    def _one(self, errand: Errand) -> None:
        process = subprocess.Popen(
            errand.command,
            shell=True,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env=os.environ | dict(errand.environment),
            start_new_session=True,  # a Ctrl-C of the terminal is for the recorder
        )
        with self._lock:
            self._running[process.pid] = process
        said = one_line(_said(process))
        status = process.wait()
        with self._lock:
            self._running.pop(process.pid, None)
        if status:
            how = f"status {status}" if status > 0 else f"signal {-status}"
            self._fail(errand, f"ended with {how}" + (f": {said}" if said else ""))
        elif said:
            self._tell(f"on {errand.on}: {said}")

    def _fail(self, errand: Errand, why: str) -> None:
        with self._lock:
            if errand.command in self._failed:
                return
            self._failed.add(errand.command)
        self._warn(f"on {errand.on}: `{errand.command}` {why}; the recording goes on")


def _said(process: subprocess.Popen[bytes]) -> str:
    """Read what a command says until it has ended; what it leaves behind may go on saying more."""
    assert process.stdout is not None
    kept = b""
    with process.stdout as pipe:
        while True:
            is_over = process.poll() is not None
            if sys.platform != "win32":
                ready, _, _ = select.select([pipe], [], [], 0.0 if is_over else LOOK_S)
                if not ready and is_over:
                    break
                if not ready:
                    continue
            data = os.read(pipe.fileno(), 1 << 16)
            if not data:
                break
            kept = (kept + data)[:SAID]
            if is_over and len(kept) == SAID:
                break
    return kept.decode(errors="replace")
