"""The reader thread: it stamps what the ports deliver and queues it, and does nothing else.

Stamps are the monotonic clock, anchored to the wall clock once: a step of the system clock never
reorders a recording. A port that goes away is opened again by its stable name until it is back.
"""

from __future__ import annotations

import collections
import contextlib
import functools
import os
import selectors
import threading
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from sniffer.ground.model import NEVER_NS, NS, InputError, SnifferError
from sniffer.ground.timing import byte_time_ns
from sniffer.ports import Port, PortLostError, PortOptions, Retunable, open_port
from sniffer.tap.events import Back, Counted, Event, Lost, Read, Retuned
from sniffer.tap.waiting import LATE_NS, LOOK_S, Account, Backlog, held_since

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

BREATH_NS: Final = 1_000_000
"""Pause between two rounds of reading on a busy line: a full-speed USB frame, so nothing is lost by
it; reading every byte as it comes would take a core for eight busy buses."""

WINDOW_NS: Final = 50_000_000
BUSY: Final = 40
"""Reads within ``WINDOW_NS`` from which on the reader takes a breath between rounds."""

FULL: Final = 4095
"""What the kernel hands out of a terminal at most in one read: there may be more of it."""

HELD_PASSES: Final = 4
"""How often more is looked for where bytes were held: they come in several pieces."""

JOINED_MAX: Final = 1 << 20
"""Bytes that are taken as one read when they were waiting together."""

REST_S: Final = 0.1
"""How long is read after the end was asked for, where a line never falls silent: time that the
thread works. A machine that has none for it takes nothing away."""

REST_MAX_S: Final = 1.0
"""How long that lasts at most by the clock, less than anybody waits for the thread."""

MOVED_UP_S: Final = 0.02
"""How long the kernel is given for what did not fit in what a read hands out (4 kB): a worker has
to move that up, and may wait for a processor."""

RETRY_S: Final = 0.25
"""How often a port that is away is looked for."""

NUMBERED: Final = "/dev/pts/"
"""Names that are given to others when they are free: a terminal of that name is another one."""

WAKES: Final = 64
"""So many who woke the reader are heard in one go."""

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


class Listener:
    """Reads ports until it is stopped; ``drain`` hands over what came since.

    All ports that can be polled are read by one thread, each other one by a thread of its own. What
    may take long, closing and opening ports that went away, is done beside them.

    Args:
        ports: opened ports; they are closed by ``stop``.
        options: how each is opened again.
        anchor: the clock.
    """

    def __init__(
        self, ports: Sequence[Port], options: Sequence[PortOptions], anchor: Anchor
    ) -> None:
        self.died: BaseException | None = None
        """What ended a reader thread that nobody asked to end."""
        self._events: collections.deque[Event] = collections.deque()
        self._found: collections.deque[tuple[_Line, Port]] = collections.deque()
        self._tunes: collections.deque[tuple[_Line, int]] = collections.deque()
        self._anchor = anchor
        self._stop = threading.Event()
        self._stopping = threading.Lock()
        self._waker, self._wakes = os.pipe()
        lines = [_Line(i, p, o) for i, (p, o) in enumerate(zip(ports, options, strict=True))]
        self._lines = lines
        polled = [line for line in lines if line.pollable]
        jobs: list[Callable[[int], None]] = []
        if polled:
            jobs.append(functools.partial(self._poll, polled))
        jobs += [functools.partial(self._wait_for, line) for line in lines if not line.pollable]
        self._heard = [anchor.now()] * len(jobs)
        self._threads = [self._thread(functools.partial(job, n)) for n, job in enumerate(jobs)]

    @property
    def heard_ns(self) -> int:
        """The time up to which all is in the queue: a stamp that comes later is not earlier.

        It is to be asked for before ``drain``.
        """
        return min(self._anchor.now(), *self._heard)

    def start(self) -> None:
        """Begin to read."""
        for thread in self._threads:
            thread.start()

    def tune(self, port: int, baud: int) -> None:
        """Have a port listened at another rate; ``Retuned`` tells from where on it is."""
        with self._stopping:
            if not self._stop.is_set():
                self._tunes.append((self._lines[port], baud))
                os.write(self._wakes, b".")

    def drain(self) -> list[Event]:
        """Return what has come since the last call, in the order of arrival of each port."""
        return [self._events.popleft() for _ in range(len(self._events))]

    def stop(self) -> None:
        """Read what is there, stop and close the ports; what was read can still be drained."""
        with self._stopping:  # from now on nobody wakes anybody
            if self._stop.is_set():
                return
            self._stop.set()
            os.write(self._wakes, b".")
        for thread in self._threads:
            if thread.is_alive():
                thread.join(2.0)
        for line in self._lines:
            line.close()
        for _, port in self._found:
            port.close()
        os.close(self._wakes)
        os.close(self._waker)

    def _thread(self, job: Callable[[], None]) -> threading.Thread:
        return threading.Thread(target=self._guarded, args=(job,), name="reader", daemon=True)

    def _guarded(self, job: Callable[[], None]) -> None:
        try:
            job()
        except BaseException as error:
            self.died = error

    def _wait_for(self, line: _Line, number: int) -> None:
        """Read a port that cannot be polled."""
        with Account() as account:
            while not self._stop.is_set():
                if line.port is not None:
                    self._heard[number] = self._anchor.now()
                    account.since()
                    if self._read(line, account=account) is None:
                        line.close()
                    self._count(line)
                    continue
                self._heard[number] = NEVER_NS
                port = _opened(line)
                self._heard[number] = self._anchor.now()
                if port is not None:
                    self._take_back(line, port)
                else:
                    self._stop.wait(RETRY_S)
        self._read_rest([line])

    def _poll(self, lines: Sequence[_Line], number: int) -> None:
        """Read all ports that can be polled."""
        with selectors.DefaultSelector() as selector, Account() as account:
            selector.register(self._waker, selectors.EVENT_READ, None)
            for line in lines:
                selector.register(line.fileno(), selectors.EVENT_READ, line)
            window, reads, breathes, all_speak, is_new, look_at = 0, 0, False, False, True, 0
            came = self._anchor.now()
            while not self._stop.is_set():
                before, looked = came, self._anchor.now()
                if is_new or all_speak:  # a port may hold bytes that came before it was set up
                    ready = [line for line in lines if line.port is not None]
                    is_new = False
                else:
                    ready = [key.data for key, _ in selector.select(LOOK_S)]
                came = self._anchor.now()
                held_ns = held_since(before, looked, came)
                if held_ns:  # the kernel moves up what did not fit, once for all ports
                    time.sleep(BREATH_NS / NS)
                    # who was stopped while it waited is told of nothing, whatever came since
                    ready += [k for k in lines if k.port is not None and k not in ready]
                waited_ns = account.since()
                if waited_ns > BREATH_NS:  # the breath is part of the latency
                    held_ns = max(held_ns, min(waited_ns, self._anchor.now() - before))
                spoke = 0
                for line in ready:
                    if line is None:
                        os.read(self._waker, WAKES)
                    elif data := self._read(line, held_ns, came):
                        spoke += 1
                    elif data is None:
                        selector.unregister(line.fileno())
                        assert line.port is not None
                        gone = functools.partial(self._look_for, line, line.port)
                        line.port = None
                        self._thread(gone).start()
                self._heard[number] = looked
                while self._tunes:
                    self._tune(*self._tunes.popleft())
                while self._found:
                    line, port = self._found.popleft()
                    self._take_back(line, port)
                    selector.register(line.fileno(), selectors.EVENT_READ, line)
                    is_new = True
                reads += spoke
                began = time.monotonic_ns()
                if began > look_at:
                    look_at = began + WINDOW_NS
                    for line in lines:
                        self._count(line)
                if began - window > WINDOW_NS:
                    window, reads, breathes = began, 0, reads >= BUSY
                if breathes:
                    time.sleep(BREATH_NS / NS)
                # who all say something in each breath need not be asked which of them does
                all_speak = breathes and spoke == len(lines)
        self._read_rest(lines)

    def _look_for(self, line: _Line, gone: Port) -> None:
        """Close a port that went away, open it as soon as it is back, hand it to its reader."""
        _close(gone)
        while (port := _opened(line)) is None:
            if self._stop.wait(RETRY_S):
                return
        with self._stopping:
            if self._stop.is_set():
                port.close()
                return
            self._found.append((line, port))
            os.write(self._wakes, b".")

    def _read_rest(self, lines: Sequence[_Line]) -> None:
        """Read what came before the end and was not read, but not what comes for ever."""
        worked, now = time.thread_time() + REST_S, time.monotonic() + REST_MAX_S
        for is_last in (False, True):
            for line in lines:
                while line.port is not None and self._read(line):
                    if time.thread_time() > worked or time.monotonic() > now:
                        break
            if not is_last:
                time.sleep(MOVED_UP_S)

    def _read(
        self,
        line: _Line,
        held_ns: int = 0,
        came: int | None = None,
        account: Account | None = None,
    ) -> bytes | None:
        """Read what is there; return None when the port is no longer there.

        ``held_ns`` is how long it may have waited until ``came``; ``account`` tells how long the
        thread waits while it reads.
        """
        port = line.port
        assert port is not None
        is_gone = False
        try:
            data = port.read()
        except PortLostError:
            data, is_gone = b"", True
        else:
            if data and line.pollable and (held_ns or len(data) >= FULL):
                data, is_gone = _with_more(port, data, HELD_PASSES if held_ns else 0)
        now = self._anchor.now()
        if data:
            late = now - came if came is not None else account.since() if account else 0
            held_ns = held_ns + late if held_ns or late > LATE_NS else 0
            took_ns = len(data) * byte_time_ns(line.options.baud)
            held_ns = line.backlog.held(took_ns, now, held_ns)
            self._events.append(Read(line.number, now, data, held_ns))
        if is_gone:
            self._events.append(Lost(line.number, self._anchor.now()))
            return None
        return data

    def _tune(self, line: _Line, baud: int) -> None:
        """Listen at another rate; what came until then was heard at the one before."""
        line.options = replace(line.options, baud=baud)  # it may be away, and is back like that
        done, port = True, line.port
        if isinstance(port, Retunable):
            try:
                self._note(line, port.read())
                port.retune(baud)
                self._note(line, port.read())
            except InputError:
                done = False
            except PortLostError:
                pass  # the next read finds out, too
        self._events.append(Retuned(line.number, self._anchor.now(), baud, done))

    def _note(self, line: _Line, data: bytes) -> None:
        if data:
            self._events.append(Read(line.number, self._anchor.now(), data))

    def _take_back(self, line: _Line, port: Port) -> None:
        line.port, line.counters = port, port.counters()
        self._events.append(Back(line.number, self._anchor.now(), port))

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
        self.counters = port.counters()
        self.count_at = time.monotonic() + COUNTERS_S
        self.backlog = Backlog()

    def fileno(self) -> int:
        assert self.port is not None
        return self.port.fileno()

    def close(self) -> None:
        if self.port is not None:
            _close(self.port)
            self.port = None


def _with_more(port: Port, data: bytes, passes: int) -> tuple[bytes, bool]:
    """Return what was read with what stands behind it, and whether the port is gone.

    ``passes`` is how often more is looked for at least.
    """
    more = data
    try:
        while more and len(data) < JOINED_MAX and (len(more) >= FULL or passes):
            passes = max(passes - 1, 0)
            more = port.read()
            data += more
    except PortLostError:
        return data, True
    return data, False


def _opened(line: _Line) -> Port | None:
    """Open a port that was away; None: it still is, or somebody else has it."""
    if line.path.startswith(NUMBERED):
        return None
    try:
        return open_port(line.path, line.options)
    except (SnifferError, OSError):  # it may go away again in the midst of it
        return None


def _close(port: Port) -> None:
    with contextlib.suppress(OSError, PortLostError):
        port.close()
