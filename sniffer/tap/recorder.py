"""The worker of a recording: takes what the reader queued, records it first, then decodes it.

One round every ``TICK_S``. What the ports delivered is handed to the recording and written to the
file before anything is decoded: a recorder that is killed loses no byte that it had taken, whatever
decoding does. Decoding that takes long goes on in the next round; if it falls too far behind, bytes
are recorded without being decoded, and marked so.
"""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final, Protocol

from sniffer.decoding.rates import Rate, SearchStep
from sniffer.decoding.sink import Sink
from sniffer.ground.model import NS, Chunk, Clock, DamagedInputError, Mark, MarkKind, OutputError
from sniffer.tap.events import Retuned
from sniffer.tap.status import BusStatus, Status

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from sniffer.decoding.pipeline import Pipeline
    from sniffer.decoding.rates import RateSearch
    from sniffer.merging.merger import Merger
    from sniffer.tap.events import Event
    from sniffer.tap.reader import Anchor, Listener
    from sniffer.tap.stops import Stops
    from sniffer.tap.tap import Tap

TICK_S: Final = 0.05
"""Length of a round: half of what a killed recorder may lose."""

DECODE_S: Final = (0.1, 0.5)
"""Time between two decoding passes, at least and at most, in seconds."""

UNSEEN_S: Final = (0.5, 1.0)
"""The same where nobody looks at what is decoded before it is in the file."""

DUTY: Final = 0.05
"""Share of the time that decoding takes before the passes become rarer: a pass has a fixed cost,
whatever it holds, so fewer of them for many busy buses are cheaper."""

PASS: Final = 1 << 16
"""Bytes of one bus that are decoded in one go: 30 ms at the worst that a line can say."""

OVERDUE_S: Final = 0.07
"""When decoding has kept the recording waiting so long, that comes first again."""

BACKLOG: Final = 16 << 20
"""Bytes waiting to be decoded from which on they are only recorded."""


_TOLD: Final = (MarkKind.LOST, MarkKind.BACK)
"""What is told of bytes that are not decoded."""


class RecordingFile(Sink, Protocol):
    """The file of a recording, which may be a row of files."""

    @property
    def path(self) -> Path:
        """The file that is being written."""
        ...

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
    """What signals ask for, taken up in the next round.

    ``hurry``: what waits to be decoded at the end is only recorded. ``is_heard``: the recorder runs
    and looks at them, or soon will.
    """

    stop: str | None = None
    is_heard: bool = False
    hurry: bool = False
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

    def next(self) -> Chunk:
        chunk = self.chunks.popleft()
        self.size -= len(chunk.data)
        return chunk

    def take(self, size: int) -> list[Chunk]:
        taken: list[Chunk] = []
        left = self.size - size
        while self.chunks and (self.size > left or not taken):
            taken.append(self.next())
        return taken


class Recorder:
    """Runs a recording.

    Args:
        listener: the reader, which runs already; it is stopped at the end.
        taps: one for each port, in the listener's order.
        anchor: the clock of the recording.
        pipeline: live; its sinks take everything, ``file`` among them.
        file: the recording, None where only other outputs were asked for.
        stops: what ends it.
        mergers: by bus, where two taps hear one.
        searches: by bus, where the rate is looked for; such a bus has one tap.
        on_rate: is told which rate a bus was found to have.
        wishes: what signals ask for.
        on_round: is called once a round, with the recorder.
        latency_ns: by how much a stamp may lag behind its bytes, the greatest of all buses.
        backlog: bytes of a bus waiting to be decoded from which on they are only recorded.
        decode_s: time between two decoding passes, at least and at most, in seconds.
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
        searches: Mapping[str, RateSearch] | None = None,
        on_rate: Callable[[str, RateSearch], None] = lambda bus, search: None,
        wishes: Wishes | None = None,
        on_round: Callable[[Recorder], None] = lambda recorder: None,
        latency_ns: int = 0,
        backlog: int = BACKLOG,
        decode_s: tuple[float, float] = DECODE_S,
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
        self._searches = dict(searches or {})
        self._on_rate = on_rate
        self._on_round = on_round
        self._latency_ns = latency_ns
        self._backlog = backlog
        self._decode_s = decode_s
        self._waiting: dict[str, _Waiting] = {tap.spec.bus: _Waiting() for tap in taps}
        self._turns = deque(self._waiting)
        self._began_ns = anchor.now()
        self._last_ns = self._heard_ns = self._began_ns
        self._decode_at = 0.0
        self._failure: OutputError | None = None

    def run(self) -> str:
        """Record until something ends it; return in words what did.

        Raises:
            DamagedInputError: the reader died; what it had read is recorded.
            OutputError: the recording cannot be written any more.
        """
        self.wishes.is_heard = True
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
                silent_ns=self._heard_ns - self._last_ns,  # of a later time nobody knows yet
                size=size,
            )
            if over is not None:
                return over

    def _round(self) -> None:
        heard_ns = self._take()
        if self._file is not None:
            # Before decoding, which may take long or never end; its records wait for a round.
            self._file.flush()
        began = time.monotonic()
        if began >= self._decode_at:
            done = self._decode(began + OVERDUE_S)
            if done:
                # The next bytes may have been on the line for as long before they are stamped, and
                # mergers may hold older ones.
                held_ns = max((m.hold_ns for m in self._mergers.values()), default=0)
                self.pipeline.idle(heard_ns - max(self._latency_ns, held_ns))
            self._tell_mergers()
            if self._file is not None:
                if self.wishes.rotate:
                    self.wishes.rotate = False
                    self._file.rotate()
                self._file.turn(self.pipeline.decided())
            least, most = self._decode_s
            pause = min(max((time.monotonic() - began) / DUTY, least), most)
            # half a round early, so that rounds that come a little late are not missed
            self._decode_at = began + pause - TICK_S / 2 if done else 0.0

    def _take(self) -> int:
        """Hand what came to the recording; return up to which time that is all there is."""
        self._heard_ns = heard_ns = self._listener.heard_ns
        self._record(self._listener.drain(), heard_ns)
        self._search_on(heard_ns)
        return heard_ns

    def _record(self, events: Sequence[Event], heard_ns: int) -> None:
        by_bus: dict[str, list[Chunk]] = {}
        for event in events:
            if isinstance(event, Retuned) and not event.done:
                self._untunable(event)
            for chunk in self.taps[event.port].chunks(event):
                by_bus.setdefault(chunk.bus, []).append(chunk)
                if chunk.data:
                    self._last_ns = max(self._last_ns, chunk.t_ns or 0)
        for bus, merger in self._mergers.items():
            settled = merger.feed(by_bus.pop(bus, [])) + merger.idle(heard_ns)
            if settled:
                by_bus[bus] = settled
        for bus, chunks in by_bus.items():
            self._hand_over(bus, chunks)

    def _hand_over(self, bus: str, chunks: Sequence[Chunk]) -> None:
        self.pipeline.record(bus, chunks)
        self._check()
        if (search := self._searches.get(bus)) is not None:
            self._search(bus, search, search.hear(chunks))
        else:
            self._waiting[bus].add(chunks)

    def _search(self, bus: str, search: RateSearch, verdict: SearchStep) -> None:
        """Do what the search for a rate asks for; nothing is decoded until it is over."""
        number = next(n for n, tap in enumerate(self.taps) if tap.spec.bus == bus)
        if verdict is SearchStep.TRY:
            self._listener.tune(number, search.baud)
        elif verdict is SearchStep.FOUND:
            del self._searches[bus]
            rate = Rate(search.baud, search.begin, self.taps[number].latency_ns)
            self.pipeline.tune(bus, rate)
            self._waiting[bus].add(search.heard())
            self._on_rate(bus, search)

    def _search_on(self, now_ns: int) -> None:
        """Tell the searches for rates how late it is."""
        for bus, search in list(self._searches.items()):
            self._search(bus, search, search.idle(now_ns))

    def _untunable(self, event: Retuned) -> None:
        """Have another rate tried where the adapter cannot do one."""
        bus = self.taps[event.port].spec.bus
        if (search := self._searches.get(bus)) is not None:
            self._search(bus, search, search.cannot(event.baud))

    def _decode(self, until: float) -> bool:
        """Decode what waits, the buses in turn, until it is time to record; tell if that is all."""
        while any(waiting.chunks for waiting in self._waiting.values()):
            bus = self._turns[0]
            self._turns.rotate(-1)
            waiting = self._waiting[bus]
            if not waiting.chunks:
                continue
            if waiting.size > self._backlog:
                self._skip(bus, waiting)
            else:
                self.pipeline.decode(bus, waiting.take(PASS))
            self._check()
            if time.monotonic() >= until:
                break
        return not any(waiting.chunks for waiting in self._waiting.values())

    def _skip(self, bus: str, waiting: _Waiting) -> None:
        """Give up decoding what waits, but for the latest of it."""
        left_out = 0
        torn: list[Mark] = []
        while waiting.size > PASS and len(waiting.chunks) > 1:
            chunk = waiting.next()
            left_out += len(chunk.data)
            torn += (m._replace(start=0) for m in chunk.marks if m.kind in _TOLD)
        self.skipped += left_out
        first = waiting.next()
        self.pipeline.skip(bus, left_out, replace(first, marks=(*torn, *first.marks)))

    def _check(self) -> None:
        """Stop when the recording itself has failed; other outputs may fail alone."""
        failure = self.pipeline.failure
        if self._has_failed():
            assert self._file is not None
            if failure is None or failure is self._failure:  # that was another output
                failure = OutputError(f"{self._file.path}: cannot be written any more")
            raise failure
        self._failure = failure

    def _has_failed(self) -> bool:
        return self._file is not None and not self.pipeline.has(self._file)

    def _tell_mergers(self) -> None:
        for bus, merger in self._mergers.items():
            if merger.protocol is None:  # of two that share a wire: by time only
                merger.protocol = self.pipeline.protocol_of(bus)

    def _end(self) -> None:
        """Record and decode the rest, unless the recording itself has failed."""
        if self._has_failed():
            return
        self._take()
        for bus, merger in self._mergers.items():
            if rest := merger.close():
                self._hand_over(bus, rest)
        for bus, search in list(self._searches.items()):
            search.settle()
            self._search(bus, search, SearchStep.FOUND)
        now_ns = self._anchor.now()
        for bus, tap in {tap.spec.bus: tap for tap in self.taps if tap.bytes}.items():
            ended = (Mark(MarkKind.ENDED, 0, count=0),)
            end = Chunk(b"", now_ns, Clock.READ, bus, tap.direction, ended)
            self._hand_over(bus, [end])
        if self._file is not None:
            self._file.flush()
        while not (self.wishes.hurry or self._decode(0.0)):
            pass
        self.skipped += sum(waiting.size for waiting in self._waiting.values())

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
            baud=self.pipeline.baud_of(tap.spec.bus) or tap.port.baud,
            protocol=self.pipeline.speaks(tap.spec.bus),
            state=tap.state(now),
            bytes=tap.bytes,
            lost=tap.lost,
            line_errors=tap.line_errors,
        )
