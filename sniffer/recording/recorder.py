"""The worker of a recording: takes what the reader queued, records it first, then decodes it.

One round every ``TICK_S``. What the ports delivered is handed to the recording before anything is
decoded, and is in the file when the round ends: a recorder that is killed loses no more than a
round. Decoding that takes long is interrupted for it; if it falls too far behind, bytes are
recorded without being decoded, and marked so.
"""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Protocol

from sniffer.model import NS, Chunk, DamagedInputError
from sniffer.protocols import PROTOCOLS
from sniffer.status import BusStatus, Status
from sniffer.sinks.base import Sink

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from sniffer.merging import Merger
    from sniffer.pipeline import Pipeline
    from sniffer.recording.stops import Stops
    from sniffer.recording.taps import Tap
    from sniffer.sources.listening import Anchor, Event, Listener

TICK_S: Final = 0.05
"""Length of a round: half of what a killed recorder may lose."""

DECODE_S: Final = (0.1, 0.5)
"""Time between two decoding passes, at least and at most, in seconds."""

DUTY: Final = 0.1
"""Share of the time that decoding takes before the passes become rarer: a pass has a fixed cost,
whatever it holds, so fewer of them for many busy buses are cheaper."""

PASS: Final = 1 << 16
"""Bytes of one bus that are decoded in one go: 30 ms at the worst that a line can say."""

OVERDUE_NS: Final = 70_000_000
"""When a decoding pass has kept the recording waiting so long, that comes first again."""

BACKLOG: Final = 16 << 20
"""Bytes waiting to be decoded from which on they are only recorded."""


class RecordingFile(Sink, Protocol):
    """The file of a recording, which may be a row of files."""

    path: Path

    @property
    def size(self) -> int:
        """Bytes written, all files together."""
        ...

    def flush(self) -> None:
        """Write what waits."""
        ...

    def rotate(self) -> None:
        """Begin a new file at the next turn."""
        ...

    def turn(self, decided: Mapping[str, int]) -> None:
        """Learn up to which byte each bus is decoded: here a new file may begin."""
        ...


@dataclass(slots=True)
class Wishes:
    """What signals ask for, taken up in the next round."""

    stop: str | None = None
    rotate: bool = False
    statistics: bool = False


@dataclass(slots=True)
class _Waiting:
    """Chunks of a bus that are recorded but not decoded."""

    chunks: deque[Chunk] = field(default_factory=deque)
    size: int = 0

    def add(self, chunks: Sequence[Chunk]) -> None:
        self.chunks.extend(chunks)
        self.size += sum(len(c.data) for c in chunks)

    def take(self, size: int) -> list[Chunk]:
        taken: list[Chunk] = []
        held = 0
        while self.chunks and held < size:
            taken.append(self.chunks.popleft())
            held += len(taken[-1].data)
        self.size -= held
        return taken


class Recorder:
    """Runs a recording.

    Args:
        listener: the reader, not started yet.
        taps: one for each port, in the listener's order.
        anchor: the clock of the recording.
        pipeline: live; its sinks take everything, ``file`` among them.
        file: the recording, None where only other outputs were asked for.
        stops: what ends it.
        mergers: by bus, where two taps hear one.
        wishes: what signals ask for.
        on_round: is called once a round, with the recorder.
    """

    def __init__(
        self,
        listener: Listener,
        taps: Sequence[Tap],
        anchor: Anchor,
        pipeline: Pipeline,
        file: RecordingFile | None,
        stops: Stops,
        *,
        mergers: Mapping[str, Merger] | None = None,
        wishes: Wishes | None = None,
        on_round: Callable[[Recorder], None] = lambda recorder: None,
    ) -> None:
        self.taps = taps
        self.pipeline = pipeline
        self.skipped = 0
        """Bytes that were recorded but not decoded."""
        self.wishes = wishes or Wishes()
        self._listener = listener
        self._anchor = anchor
        self._file = file
        self._stops = stops
        self._mergers = dict(mergers or {})
        self._on_round = on_round
        self._waiting: dict[str, _Waiting] = {tap.spec.bus: _Waiting() for tap in taps}
        self._began_ns = anchor.now()
        self._last_ns = self._began_ns
        self._flushed_ns = time.monotonic_ns()
        self._decode_at = 0.0

    def run(self) -> str:
        """Record until something ends it; return in words what did.

        Raises:
            DamagedInputError: the reader died; what it had read is recorded.
            OutputError: the recording cannot be written any more.
        """
        self._listener.start()
        try:
            ended = self._rounds_until_over()
        finally:
            self._listener.stop()
            self._end()
        return ended

    def _rounds_until_over(self) -> str:
        due = time.monotonic()
        while True:
            due = max(due + TICK_S, time.monotonic())
            time.sleep(max(0.0, due - time.monotonic()))
            self._round()
            self._on_round(self)
            if self._listener.died is not None:
                raise DamagedInputError(f"reading stopped by itself: {self._listener.died!r}")
            if self.wishes.stop is not None:
                return self.wishes.stop
            size = self._file.size if self._file is not None else 0
            now = self._anchor.now()
            over = self._stops.met(
                self.pipeline.summary,
                ran_ns=now - self._began_ns,
                silent_ns=now - self._last_ns,
                size=size,
            )
            if over is not None:
                return over

    def _round(self) -> None:
        self._record(self._listener.drain())
        began = time.monotonic()
        if began >= self._decode_at:
            self._decode()
            self.pipeline.idle(self._anchor.now())
            self._tell_mergers()
            if self._file is not None:
                if self.wishes.rotate:
                    self._file.rotate()
                self._file.turn(self.pipeline.decided())
            self.wishes.rotate = False
            took = time.monotonic() - began
            # half a round early, so that rounds that come a little late are not missed
            self._decode_at = began + min(max(took / DUTY, DECODE_S[0]), DECODE_S[1]) - TICK_S / 2
        self._flush()

    def _record(self, events: Sequence[Event]) -> None:
        """Hand what came to the recording, all buses."""
        by_bus: dict[str, list[Chunk]] = {}
        for event in events:
            for chunk in self.taps[event.port].chunks(event):
                by_bus.setdefault(chunk.bus, []).append(chunk)
                if chunk.data:
                    self._last_ns = max(self._last_ns, chunk.t_ns or 0)
        for bus, merger in self._mergers.items():
            settled = merger.feed(by_bus.pop(bus, [])) + merger.idle(self._anchor.now())
            if settled:
                by_bus[bus] = settled
        for bus, chunks in by_bus.items():
            self.pipeline.record(bus, chunks)
            self._check()
            self._waiting[bus].add(chunks)

    def _decode(self) -> None:
        """Decode what waits, pass by pass; recording comes first whenever it is due."""
        buses = [bus for bus, waiting in self._waiting.items() if waiting.chunks]
        while buses:
            for bus in list(buses):
                waiting = self._waiting[bus]
                if waiting.size > BACKLOG:
                    self._skip(bus, waiting)
                self.pipeline.decode(bus, waiting.take(PASS))
                self._check()
                if not waiting.chunks:
                    buses.remove(bus)
                if time.monotonic_ns() - self._flushed_ns > OVERDUE_NS:
                    self._record(self._listener.drain())
                    self._flush()
                    self._on_round(self)
            if self.wishes.stop is not None:
                return

    def _skip(self, bus: str, waiting: _Waiting) -> None:
        """Give up decoding what waits, but for the latest of it."""
        left_out = 0
        while waiting.size > PASS:
            left_out += sum(len(c.data) for c in waiting.take(PASS))
        self.skipped += left_out
        self.pipeline.skip(bus, left_out, waiting.chunks.popleft())

    def _flush(self) -> None:
        if self._file is not None:
            self._file.flush()
        self._flushed_ns = time.monotonic_ns()

    def _check(self) -> None:
        """Stop when the recording itself has failed; other outputs may fail alone."""
        if self._has_failed() and self.pipeline.failure is not None:
            raise self.pipeline.failure

    def _has_failed(self) -> bool:
        return self._file is not None and not self.pipeline.has(self._file)

    def _tell_mergers(self) -> None:
        for bus, merger in self._mergers.items():
            name = self.pipeline.speaks(bus)
            if merger.protocol is None and name is not None:
                merger.protocol = PROTOCOLS[name]

    def _end(self) -> None:
        """Record and decode the rest, unless the recording itself has failed."""
        if self._has_failed():
            return
        self._record(self._listener.drain())
        for bus, merger in self._mergers.items():
            if rest := merger.close():
                self.pipeline.record(bus, rest)
                self._waiting[bus].add(rest)
        for bus, waiting in self._waiting.items():
            while waiting.chunks:
                self.pipeline.decode(bus, waiting.take(PASS))

    def status(self) -> Status:
        """Return how it is going."""
        now = self._anchor.now()
        return Status(
            elapsed_s=(now - self._began_ns) / NS,
            now_ns=now,
            file=str(self._file.path) if self._file is not None else "",
            size=self._file.size if self._file is not None else 0,
            waiting=sum(w.size for w in self._waiting.values()),
            buses=tuple(self._bus_status(tap, now) for tap in self.taps),
        )

    def _bus_status(self, tap: Tap, now: int) -> BusStatus:
        return BusStatus(
            bus=tap.spec.bus,
            port=tap.spec.port,
            baud=tap.port.baud,
            protocol=self.pipeline.speaks(tap.spec.bus),
            state=tap.state(now),
            bytes=tap.bytes,
            lost=tap.lost,
            line_errors=tap.line_errors,
        )
