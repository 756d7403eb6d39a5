"""One channel of a capture: gathered until it is known how to read it, then read."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.ground.model import Direction
from sniffer.signals.chunking import Chunker
from sniffer.signals.glitches import SHORTEST, GlitchFilter
from sniffer.signals.grid import grid_in
from sniffer.signals.rates import SAMPLES_LEAST, BitTime, WireEdges
from sniffer.signals.uart import Receiver

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.model import I64, Chunk
    from sniffer.signals.stretch import LogicInput


COMPARED: Final = 1 << 10
"""Edges by which it is told that two channels are one wire ..."""

LIKE_BITS: Final = 0.25
"""... and how far apart they may be, in bits: behind a buffer edges come later."""


class ChannelVerdict(NamedTuple):
    """What is to be thought of a channel; ``why`` it cannot be read, where it cannot.

    ``is_explained``: a protocol knows what its bytes say. ``is_plausible``: it looks like serial.
    """

    told: BitTime | None
    is_explained: bool = False
    is_plausible: bool = False
    why: str = ""


class SignalChannel:
    """A channel by its name, and the bus that its bytes are of; ``is_asked``: somebody named it."""

    def __init__(self, name: str, bus: str, *, is_asked: bool) -> None:
        self.name, self.bus, self.is_asked = name, bus, is_asked
        self.direction = Direction.UNKNOWN
        self.verdict: ChannelVerdict | None = None
        self.is_left_out = False
        self.count = 0
        """Edges that were gathered."""
        self.sample = 0.0
        """Ticks of a sample, 0 where neither the file nor its edges say."""
        self._first: I64 = np.empty(0, np.int64)
        self._machine: tuple[GlitchFilter, Receiver, Chunker] | None = None
        self._level = 1
        self._is_open_ended = False
        self._edges: list[I64] = []
        self._until = 0

    @property
    def is_read(self) -> bool:
        """Whether its bytes are handed on."""
        return self._machine is not None

    @property
    def short_pulses(self) -> int:
        """How many pulses were too short for a bit."""
        return self._machine[0].removed if self._machine is not None else 0

    @property
    def is_open(self) -> bool:
        """Whether it is still to be found out what it is."""
        return not self.is_read and not self.is_left_out

    @property
    def horizon(self) -> int:
        """No byte that is still to come begins before this tick."""
        if self._machine is not None:
            return self._machine[1].horizon
        return int(self._edges[0][0]) if self._edges else self._until + 1

    def gather(self, level: int, edges: I64, until: int) -> None:
        """Keep what it says."""
        if not self.count:
            self._level = level
        if len(edges):
            self._edges.append(edges)
            self.count += len(edges)
        self._until = until

    def found(self) -> WireEdges:
        """Return what was gathered."""
        edges = np.concatenate(self._edges) if self._edges else np.empty(0, np.int64)
        return WireEdges(self._level, edges, self._until)

    def is_like(self, other: SignalChannel) -> bool:
        """Tell whether another one changes whenever this one does: one wire, or a pair."""
        told = self.verdict and self.verdict.told
        if told is None or len(self._first) != len(other._first):
            return False
        return bool(np.abs(self._first - other._first).max(initial=0) <= LIKE_BITS * told.bit)

    def drop(self) -> None:
        """Read no more of it."""
        self.is_left_out = True
        self._edges.clear()

    def begin(
        self, told: BitTime, given: LogicInput, glitch: float | None, *, last: bool
    ) -> Sequence[Chunk]:
        """Read it, from what was gathered on; return what is complete."""
        found = self.found()
        self._edges.clear()
        self._first = found.edges[:COMPARED]
        self._is_open_ended = given.is_open_ended
        self.sample = given.sample or grid_in(found.edges, given.tick_ns, told.bit, SAMPLES_LEAST)
        self._machine = (
            GlitchFilter(SHORTEST * told.bit if glitch is None else glitch),
            Receiver(told.bit, found.level, invert=told.invert, parity=told.parity),
            Chunker(told, given, self.bus, self.direction),
        )
        return self.read(found.edges, found.until, last=last)

    def read(self, edges: I64, until: int, *, last: bool) -> Sequence[Chunk]:
        """Return what is complete of what is read."""
        assert self._machine is not None, "begin comes first"
        glitches, receiver, chunker = self._machine
        edges, until = glitches.take(edges, until, last=last)
        return chunker.chunks(receiver.take(edges, until, stays=last and self._is_open_ended))
