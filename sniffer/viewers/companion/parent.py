"""A recording shown in Rerun while it is made, by a process of its own that may be slow or hang.

``LiveView`` is the recorder's end: it never waits. It sends the raw bytes through a pipe to
``child.py`` beside this file, which decodes and shows them; where the pipe is full, groups of
chunks are left out and counted, and the other end begins afresh behind the hole.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import select
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

from sniffer.ground.model import OutputError
from sniffer.ground.wording import Sentence
from sniffer.viewers import viewer
from sniffer.viewers.companion.parcels import (
    CONNECT,
    DONE,
    FOXGLOVE,
    GONE,
    READY,
    SAY,
    WEB,
    WINDOW,
    IncidentWord,
    Setup,
    address_in,
    packed,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from sniffer.decoding.pipeline import Options
    from sniffer.decoding.rates import Rate
    from sniffer.diagnosis.tracking import IncidentChange
    from sniffer.ground.model import Batch, Chunk
    from sniffer.protocols.base import BusProtocol

GROUP_S: Final = 0.1
"""Chunks of so long go out together, in seconds: a parcel and a decoder pass cost about the same
for one chunk as for all of them, and eyes see no more."""

GROUP_BYTES: Final = 1 << 16
"""Where more comes in that time, it goes out sooner."""

PIPE_BYTES: Final = 1 << 20
"""What the pipe is to hold; Linux lets everybody have this much."""

BACKLOG_BYTES: Final = 4 << 20
"""What is kept here while the pipe is full. The other end needs about two seconds to start, in
which eight buses at 1 Mbit/s say 1.5 MB."""

AT_HOME: Final = "127.0.0.1:8765"
"""Where Foxglove finds a recording: only on this machine, at the port that it expects."""

CLOSE_S: Final = 1.0
"""The longest that closing may take."""


class LiveView:
    """A sink that shows raw chunks live, and does not hold up whoever feeds it.

    ``close`` leaves a window open to be looked at: it belongs to the other process, which ends with
    it. In the other modes that process ends with the recording, or soon after where it was about to
    start, or is killed where it hangs.

    Args:
        mode: ``window``, ``web`` (a server for browsers of this machine), ``connect``, or
            ``foxglove`` (a server for Foxglove).
        options: how to decode.
        name: of the recording.
        url: of the viewer to connect to; for Foxglove ``HOST:PORT``, where to listen.
        window_s: how much of the past is shown.
        say: is told in one line what the people at the recorder should know.
        arguments: for the viewer's program.
        buses: that are heard.

    Raises:
        OutputError: it cannot be shown that way; what else to do is in the message.
    """

    def __init__(
        self,
        mode: str,
        *,
        options: Options,
        name: str,
        url: str | None = None,
        window_s: float = 20.0,
        say: Callable[[str], None],
        arguments: Sequence[str] = (),
        buses: Sequence[str] = (),
    ) -> None:
        address = _checked(mode, url)
        self.mode = mode
        self.where = "Foxglove" if mode == FOXGLOVE else "Rerun"
        self.dropped_bytes = 0
        self.dropped_chunks = 0
        self._say = say
        self._is_alive = True
        self._is_ready = self._is_done = False
        self._has_sent = False
        self._groups: dict[str, list[Chunk]] = {}
        self._size = 0
        self._sent_s = time.monotonic()
        self._missing: dict[str, int] = {}
        self._held: set[str] = set()
        setup = Setup(mode, name, options, window_s, address, tuple(arguments), tuple(buses))
        self._backlog = bytearray(_packed(setup))
        self._heard = b""
        self._process = _start("serving" if mode == FOXGLOVE else "child")
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._pipe, self._told = self._process.stdin, self._process.stdout
        _enlarge(self._pipe.fileno())
        for end in (self._pipe, self._told):
            os.set_blocking(end.fileno(), False)
        self._pump()

    @property
    def alive(self) -> bool:
        """Tell whether somebody still takes what is shown."""
        return self._is_alive

    @property
    def pid(self) -> int:
        """The other process; it leads the group that the viewer belongs to."""
        return self._process.pid

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take chunks; they go out with all others of a tenth of a second."""
        if not self._is_alive or not chunks or bus in self._held:
            return
        self._groups.setdefault(bus, []).extend(chunks)
        self._size += sum([len(c.data) for c in chunks])
        if self._size >= GROUP_BYTES or time.monotonic() - self._sent_s >= GROUP_S:
            self._send()

    def hold(self, buses: Iterable[str]) -> None:
        """Leave buses out until their rate is found: what is heard until then is no frame."""
        self._held = set(buses)

    def tuned(self, bus: str, rate: Rate) -> None:
        """Show a bus from now on, at the rate that was found."""
        self._held.discard(bus)
        if self._is_alive:
            self._backlog += packed(bus, (), baud=rate.baud)

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Take what was decided; the other process decides for itself."""

    def incidents(self, changes: Sequence[IncidentChange]) -> None:
        """Take what has become of incidents; where the pipe is full it is left out."""
        if not self._is_alive or len(self._backlog) > BACKLOG_BYTES:
            return
        for change in changes:
            i = change.incident
            word = IncidentWord(i.last_ns, i.severity, i.servo_ids, str(change))
            self._backlog += packed(i.bus, (), words=[word])

    def keep_up(self) -> None:
        """Send what waits, and hear what the other process says, also on silent buses."""
        if self._is_alive and time.monotonic() - self._sent_s >= GROUP_S:
            self._send()

    def close(self) -> None:
        """Send what is left; leave an open window to itself, and kill what hangs."""
        deadline = time.monotonic() + CLOSE_S
        if self._is_alive:
            self._send()
        had_begun = self._is_ready
        while self._is_alive and self._backlog and _wait(deadline, writable=self._pipe.fileno()):
            self._pump()
        self._pipe.close()
        shown = self._has_sent and not self._backlog
        while self._is_alive and shown and not self._stays_open():
            if not _wait(deadline, readable=self._told.fileno()):
                break
            self._listen()
        self._told.close()
        if self._is_alive and shown and (self.mode == WINDOW or not had_begun):
            if self.mode == WINDOW:
                self._say("the Rerun window stays open until it is closed")
            self._process.returncode = 0  # it is left on purpose: Popen need not warn of it
        else:
            self._kill()
            self._process.wait()
        self._is_alive = False

    def _send(self) -> None:
        """Put what waits into parcels; where there is no room, leave it out."""
        self._sent_s, self._size = time.monotonic(), 0
        groups, self._groups = self._groups, {}
        self._pump()
        for bus, chunks in groups.items():
            if len(self._backlog) > BACKLOG_BYTES:
                size = sum([len(c.data) for c in chunks])
                self._missing[bus] = self._missing.get(bus, 0) + size
                self.dropped_bytes += size
                self.dropped_chunks += len(chunks)
            else:
                self._backlog += packed(bus, chunks, self._missing.pop(bus, 0))
                self._has_sent = True
        self._pump()
        self._listen()

    def _pump(self) -> None:
        """Put into the pipe what it has room for."""
        while self._is_alive and self._backlog:
            try:
                written = os.write(self._pipe.fileno(), self._backlog)
            except BlockingIOError:
                return
            except BrokenPipeError:
                self._listen()  # why, it may have said
                self._end(f"the process that shows it in {self.where} has stopped")
                return
            del self._backlog[:written]

    def _listen(self) -> None:
        """Hear what the other process tells."""
        while self._is_alive:
            try:
                heard = os.read(self._told.fileno(), 1 << 12)
            except BlockingIOError:
                return
            if not heard:
                self._end(f"the process that shows it in {self.where} has stopped")
                return
            *lines, self._heard = (self._heard + heard).split(b"\n")
            for line in lines:
                self._take(*line.decode(errors="replace").split(" ", 1))

    def _take(self, what: str, text: str) -> None:
        if what == SAY:
            self._say(text)
        elif what == GONE:
            self._end(text)
        elif what == READY:
            self._is_ready = True
        elif what == DONE:
            self._is_done = True

    def _end(self, why: str) -> None:
        """Give up showing; the recording goes on."""
        if not self._is_alive:
            return
        self._is_alive = False
        self._backlog.clear()
        self._groups.clear()
        self._kill()
        if not self._is_done and not self._pipe.closed:
            self._say(f"{why}; the recording goes on")

    def _stays_open(self) -> bool:
        return self._is_done and self.mode == WINDOW

    def _kill(self) -> None:
        """Kill whatever is left of the other process and its viewer."""
        if sys.platform != "win32":
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)


def _checked(mode: str, url: str | None) -> str:
    """Return the address to connect to, empty where the viewer is to be started."""
    if mode not in (WINDOW, WEB, CONNECT, FOXGLOVE):
        raise ValueError(f"no mode {mode!r}")
    if sys.platform == "win32":
        raise OutputError(
            "a recording cannot be shown while it is made on Windows: record it, and open it with "
            "`sniffer view FILE`"
        )
    if mode == FOXGLOVE:
        address_in(url or AT_HOME)
        return url or AT_HOME
    if mode == CONNECT:
        return viewer.data_address(url or "")[0]
    if mode == WINDOW and not viewer.has_display():
        told = (
            "there is no display for the Rerun viewer: let a browser show it with {view:web}, or a "
            "viewer elsewhere with {view:connect}"
        )
        raise OutputError(Sentence(told))
    viewer.executable()
    return ""


def _packed(setup: Setup) -> bytes:
    """Return the setup as bytes; the other process finds protocols by their names and files."""
    try:
        return setup.packed()
    except (pickle.PicklingError, TypeError, AttributeError):
        raise OutputError(
            "a protocol that is given as an object cannot be shown live: give its name or its file"
        ) from None


def _start(module: str) -> subprocess.Popen[bytes]:
    """Start the other process where no Ctrl-C of the terminal reaches it."""
    # Its modules are found where ours were, whatever lies in the folder it is started in.
    path = os.pathsep.join(str(Path(place).absolute()) for place in sys.path)
    return subprocess.Popen(
        [sys.executable, "-P", "-m", f"sniffer.viewers.companion.{module}"],
        bufsize=0,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"PYTHONPATH": path},
        start_new_session=True,
    )


def _enlarge(pipe: int) -> None:
    """Let a pipe hold more; where that is not granted, it holds what it does."""
    if sys.platform == "linux":
        import fcntl

        with contextlib.suppress(OSError):
            fcntl.fcntl(pipe, fcntl.F_SETPIPE_SZ, PIPE_BYTES)


def _wait(deadline: float, *, readable: int = -1, writable: int = -1) -> bool:
    """Wait until a pipe is ready; false where the deadline comes first."""
    left = deadline - time.monotonic()
    if left <= 0:
        return False
    reading = [readable] if readable >= 0 else []
    writing = [writable] if writable >= 0 else []
    return any(select.select(reading, writing, [], left))
