"""The reader thread: it stamps what the ports deliver and queues it, and does nothing else.

Stamps are the monotonic clock, anchored to the wall clock once: a step of the system clock never
reorders a recording. A port that goes away is opened again by its stable name until it is back.
"""

from __future__ import annotations

import collections
import contextlib
import os
import selectors
import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.model import NS, SnifferError
from sniffer.sources.ports import Counters, Port, PortLostError, PortOptions, open_port

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

BREATH_NS: Final = 1_000_000
"""Pause between two rounds of reading on a busy line: a full-speed USB frame, so nothing is lost by
it; reading every byte as it comes would take a core for eight busy buses."""

WINDOW_NS: Final = 50_000_000
BUSY: Final = 40
"""Reads within ``WINDOW_NS`` from which on the reader takes a breath between rounds."""

RETRY_S: Final = 0.25
"""How often a port that is away is looked for."""

COUNTERS_S: Final = 1.0
"""How often the driver's error counters are read."""


@dataclass(frozen=True, slots=True)
class Anchor:
    """The clock of a recording: monotonic, told in Unix time as of its start."""

    wall_ns: int
    monotonic_ns: int

    @classmethod
    def take(cls) -> Anchor:
        """Anchor to the clocks as they are now."""
        return cls(time.time_ns(), time.monotonic_ns())

    def now(self) -> int:
        """Return the time, in ns since the epoch."""
        return time.monotonic_ns() - self.monotonic_ns + self.wall_ns

    def step_ns(self) -> int:
        """Return how far the system clock has been set since (or has drifted), in ns."""
        return time.time_ns() - self.now()


class Read(NamedTuple):
    """Raw bytes of one read, at the time of its end."""

    port: int
    t_ns: int
    data: bytes


class Lost(NamedTuple):
    """The port went away."""

    port: int
    t_ns: int


class Back(NamedTuple):
    """The port was opened again, as another object."""

    port: int
    t_ns: int
    opened: Port


class Counted(NamedTuple):
    """The driver's counters have risen."""

    port: int
    t_ns: int
    now: Counters
    before: Counters


Event = Read | Lost | Back | Counted


class Listener:
    """Reads ports until it is stopped; ``drain`` hands over what came since.

    Args:
        ports: opened ports; they are closed by ``stop``.
        options: how each is opened again.
        anchor: the clock.
    """

    def __init__(
        self, ports: Sequence[Port], options: Sequence[PortOptions], anchor: Anchor
    ) -> None:
        self._events: collections.deque[Event] = collections.deque()
        self._anchor = anchor
        self._stop = threading.Event()
        self.died: BaseException | None = None
        """What ended a reader thread that nobody asked to end."""
        self._waker, self._wakes = os.pipe()
        lines = [_Line(i, p, o) for i, (p, o) in enumerate(zip(ports, options, strict=True))]
        self._lines = lines
        polled = [line for line in lines if line.pollable]
        jobs: list[Callable[[], None]] = [lambda: self._poll(polled)] if polled else []
        jobs += [self._waiting_for(line) for line in lines if not line.pollable]
        self._threads = [
            threading.Thread(target=self._guarded, args=(job,), name="reader", daemon=True)
            for job in jobs
        ]

    def start(self) -> None:
        """Begin to read."""
        for thread in self._threads:
            thread.start()

    def drain(self) -> list[Event]:
        """Return what has come since the last call, in the order of arrival of each port."""
        return [self._events.popleft() for _ in range(len(self._events))]

    def stop(self) -> None:
        """Stop reading and close the ports; what was read can still be drained."""
        if self._stop.is_set():
            return
        self._stop.set()
        os.write(self._wakes, b".")
        for thread in self._threads:
            if thread.is_alive():
                thread.join(2.0)
        for line in self._lines:
            line.close()
        os.close(self._wakes)
        os.close(self._waker)

    def _guarded(self, job: Callable[[], None]) -> None:
        try:
            job()
        except BaseException as error:
            self.died = error

    def _waiting_for(self, line: _Line) -> Callable[[], None]:
        """Return the job for a port that cannot be polled: a thread waits for it."""

        def job() -> None:
            while not self._stop.is_set():
                if line.port is None:
                    if not self._open(line):
                        self._stop.wait(RETRY_S)
                else:
                    self._read(line)
                    self._count(line)

        return job

    def _poll(self, lines: Sequence[_Line]) -> None:
        """Read all ports that can be polled, in one thread."""
        with selectors.DefaultSelector() as selector:
            selector.register(self._waker, selectors.EVENT_READ, None)
            for line in lines:
                selector.register(line.fileno(), selectors.EVENT_READ, line)
            retry_at = 0.0
            window, reads, breathes = 0, 0, False
            while not self._stop.is_set():
                ready = selector.select(COUNTERS_S / 4)
                began = time.monotonic_ns()
                for key, _ in ready:
                    if key.data is not None and not self._read(key.data):
                        selector.unregister(key.fileobj)
                        key.data.close()
                for line in lines:
                    if line.port is not None:
                        self._count(line)
                    elif began >= retry_at * NS and self._open(line):
                        selector.register(line.fileno(), selectors.EVENT_READ, line)
                if any(line.port is None for line in lines) and began >= retry_at * NS:
                    retry_at = began / NS + RETRY_S
                reads += len(ready)
                if began - window > WINDOW_NS:
                    window, reads, breathes = began, 0, reads >= BUSY
                if breathes:
                    time.sleep(BREATH_NS / NS)

    def _read(self, line: _Line) -> bool:
        """Read what is there; tell whether the port is still there, too."""
        port = line.port
        assert port is not None
        try:
            data = port.read()
        except PortLostError:
            line.lost_ns = self._anchor.now()
            self._events.append(Lost(line.number, line.lost_ns))
            if not line.pollable:
                line.close()
            return False
        if data:
            self._events.append(Read(line.number, self._anchor.now(), data))
        return True

    def _open(self, line: _Line) -> bool:
        """Try to open a port that was away."""
        try:
            port = open_port(line.path, line.options)
        except SnifferError:
            return False
        line.port, line.counters = port, None
        self._events.append(Back(line.number, self._anchor.now(), port))
        return True

    def _count(self, line: _Line) -> None:
        """Read the driver's counters once a second; tell when they have risen."""
        now = time.monotonic()
        if line.port is None or now < line.count_at:
            return
        line.count_at = now + COUNTERS_S
        counters = line.port.counters()
        before, line.counters = line.counters, counters
        if counters is not None and before is not None and counters != before:
            self._events.append(Counted(line.number, self._anchor.now(), counters, before))


class _Line:
    """A port as the reader sees it; ``port`` is None while it is away."""

    def __init__(self, number: int, port: Port, options: PortOptions) -> None:
        self.number = number
        self.port: Port | None = port
        self.path = port.path
        self.pollable = port.pollable
        self.options = options
        self.lost_ns = 0
        self.counters = port.counters()
        self.count_at = time.monotonic() + COUNTERS_S

    def fileno(self) -> int:
        assert self.port is not None
        return self.port.fileno()

    def close(self) -> None:
        if self.port is not None:
            with contextlib.suppress(OSError, PortLostError):
                self.port.close()
            self.port = None
