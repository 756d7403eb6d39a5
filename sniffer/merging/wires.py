"""Lines of two taps in one log, one on each wire: are they in order, or mixed by the host?

A host that fetches each adapter every 16 ms writes what came meanwhile as one line, so the lines of
two wires cut each other's frames and hide which answer belongs to which request. Such lines are
merged by cause and effect, as two ports are that are recorded (``merger``). Lines in order stay as
they are, byte for byte: one tap that hears both ways and merely tells the direction.

Which it is follows from the lines alone: they are decoded as they stand, in windows, and only where
much goes wrong that merging mends is it merged, from there on.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.decoding.decoder import Decoder
from sniffer.decoding.detect import UndecidedError, detect
from sniffer.decoding.names import protocols_named
from sniffer.decoding.pipeline import AUTO
from sniffer.ground.codes import NO_RESPONSE, NOT_EXPECTED, OK
from sniffer.ground.model import Clock, DamagedInputError, Direction, Mark, MarkKind
from sniffer.ground.runs import by_bus
from sniffer.ground.timing import LATENCY_NS
from sniffer.merging.merger import Merger

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from sniffer.decoding.pipeline import Options
    from sniffer.ground.model import Batch, Chunk
    from sniffer.protocols.base import BusProtocol

WINDOW: Final = 4096
"""Bytes that are looked at in one go: some hundred exchanges."""

FIRST_LOOK: Final = 512
"""Bytes after which the first window is looked at for the first time."""

PLAIN: Final = 8
"""Exchanges from which on a part of the first window decides."""

WRONG: Final = 0.02
"""Below this share of exchanges that go wrong, nothing is mixed."""

TRIALS: Final = 4
"""Windows of a bus for which merging is tried at most: it is slow, and a bad line is no mixture."""


class _Wires:
    """The lines of one bus."""

    def __init__(self, bus: str, options: Options, tell: Callable[[str], None]) -> None:
        self._bus = bus
        self._named = options.protocols.get(bus, options.protocol)
        self._baud = options.bauds.get(bus, options.baud)
        stated = options.latencies.get(bus) if options.latency_ns is None else options.latency_ns
        self._latency_ns = LATENCY_NS[Clock.READ] if stated is None else stated
        self._tell = tell
        self._held: list[Chunk] = []  # of the first window: not handed on before it is judged
        self._window: list[Chunk] = []
        self._size = 0
        self._look_at = FIRST_LOOK
        self._is_first = True
        self._trials = 0
        self._merger: Merger | None = None
        self._found: BusProtocol | None = None

    @property
    def passes(self) -> bool:
        """Whether whatever comes is handed on as it is."""
        return self._merger is None and self._trials >= TRIALS and not self._is_first

    def feed(self, chunk: Chunk) -> list[Chunk]:
        """Take a chunk; return what can be handed on."""
        if self._merger is not None:
            return self._marked(self._merger.feed([chunk]))
        if self._trials >= TRIALS:
            return [chunk]
        if chunk.t_ns is None or chunk.direction == Direction.UNKNOWN:
            self._trials = TRIALS  # nothing to go by
            return [*self.close(), chunk]
        self._window.append(chunk)
        self._size += len(chunk.data)
        if not self._is_first:
            if self._size >= WINDOW:
                self._merger = self._mixed(least=1)
                self._window, self._size = [], 0
            return [chunk]
        if self._size < self._look_at:
            return []
        self._look_at *= 2
        whole = self._size >= WINDOW
        self._merger = self._mixed(least=1 if whole else PLAIN)
        return self._first_window() if whole or self._merger or self._is_sound() else []

    def close(self) -> list[Chunk]:
        """Return what is held back."""
        if self._merger is not None:
            return self._marked(self._merger.close())
        if not self._is_first:
            return []
        self._merger = self._mixed(least=1)
        out = self._first_window()
        return [*out, *self.close()] if self._merger is not None else out

    def _first_window(self) -> list[Chunk]:
        held, self._window, self._size, self._is_first = self._window, [], 0, False
        return held if self._merger is None else self._marked(self._merger.feed(held))

    def _protocol(self) -> BusProtocol | None:
        if self._named != AUTO:
            named = protocols_named(self._named)
            return named[0] if len(named) == 1 else None
        if self._found is not None:  # a bus speaks what it spoke: decoding takes it so, too
            return self._found
        asked = [chunk for chunk in self._window if chunk.direction == Direction.TX]
        for chunks in (self._window, asked):  # what is mixed may be told from one wire only
            try:
                found = protocols_named(detect(chunks, self._baud).protocol)
            except UndecidedError:
                continue
            if len(found) > 1:
                return None  # two cannot be merged
            if self._size >= WINDOW:
                self._found = found[0]
            return found[0]
        return None

    def _is_sound(self) -> bool:
        protocol = self._protocol()
        if protocol is None:
            return False
        good, bad = self._exchanges(protocol, self._window)
        return good >= PLAIN and not bad

    def _mixed(self, least: int) -> Merger | None:
        """Return a merger if the window is mixed: merging mends half of what goes wrong in it.

        ``least`` is how many exchanges must go wrong.
        """
        wires = {chunk.direction for chunk in self._window}
        protocol = self._protocol() if len(wires) > 1 and self._trials < TRIALS else None
        if protocol is None:
            return None
        good, bad = self._exchanges(protocol, self._window)
        if bad < least or bad <= WRONG * (good + bad):
            return None
        self._trials += 1
        merger = self._new(protocol)
        merged = [*merger.feed(self._window), *merger.close()]
        good_then, bad_then = self._exchanges(protocol, merged)
        if good_then <= good or bad_then > bad / 2:
            return None
        self._tell(
            f"{self._bus}: its TX and RX lines are of two taps, mixed by their host: merged by "
            f"cause and effect, times ± {self._latency_ns / 1e6:g} ms"
        )
        return self._new(protocol)

    def _new(self, protocol: BusProtocol) -> Merger:
        baud = self._baud or protocol.baud
        return Merger(self._bus, latency_ns=self._latency_ns, baud=baud, protocol=protocol)

    def _exchanges(self, protocol: BusProtocol, chunks: Sequence[Chunk]) -> tuple[int, int]:
        """Return how many exchanges are whole, and how much goes wrong that mixing can explain.

        A request that an answer's byte cuts is no exchange at all, only a gap: it counts as well.
        What the controller's wire has of gaps by itself (a line feed behind each command) no order
        mends, and neither does one mend a request that nobody answers: they do not count.
        """
        told = self._decoded(protocol, chunks)
        outcome = told.transactions.outcome
        good = int((outcome == OK).sum())
        lost = int(np.isin(outcome, (NO_RESPONSE, NOT_EXPECTED)).sum())
        asked = self._decoded(protocol, [c for c in chunks if c.direction == Direction.TX])
        return good, len(outcome) - good - lost + max(len(told.gaps) - len(asked.gaps), 0)

    def _decoded(self, protocol: BusProtocol, chunks: Sequence[Chunk]) -> Batch:
        decoder = Decoder(protocol, baud=self._baud, latency_ns=self._latency_ns)
        decoder.take(chunks)
        return decoder.close()

    def _marked(self, chunks: Iterable[Chunk]) -> list[Chunk]:
        """Add to merged chunks that they are, and by how much their stamps may lag."""
        told = self._latency_ns
        return [
            replace(k, marks=(*k.marks, Mark(MarkKind.MERGED, 0, len(k.data), told)))
            for k in chunks
        ]


def in_order(
    groups: Iterable[Sequence[Chunk]], options: Options, tell: Callable[[str], None]
) -> Iterator[Sequence[Chunk]]:
    """Yield groups of chunks, those of two wires merged where they are mixed.

    What was read before damage or an interruption comes before that does.
    """
    buses: dict[str, _Wires] = {}
    try:
        for group in groups:
            pass_all = bool(buses) and all(wires.passes for wires in buses.values())
            if pass_all and all(bus in buses for bus in by_bus(group)):
                yield group
                continue
            out: list[Chunk] = []
            for chunk in group:
                wires = buses.get(chunk.bus)
                if wires is None:
                    wires = buses[chunk.bus] = _Wires(chunk.bus, options, tell)
                out += wires.feed(chunk)
            if out:
                yield out
    except (DamagedInputError, KeyboardInterrupt):
        yield [chunk for wires in buses.values() for chunk in wires.close()]
        raise
    yield [chunk for wires in buses.values() for chunk in wires.close()]
