"""Bytes with the times of their edges -> chunks, whose times say no more than the edges tell.

Who reads a chunk lays its bytes back to back from the end of the last one, at the nominal rate. A
sender's clock is off by up to 2 %, and it may pause between bytes. So a chunk holds only bytes that
stand where the nominal rate has them to a fifth of a bit, which is what 2 % of one byte makes; and
the first byte behind a pause is a chunk of its own: whatever begins there begins at its edge.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.model import NS, Clock, Direction, Mark, MarkKind
from sniffer.ground.runs import ChunkRun
from sniffer.signals.uart import BREAK, DATA_BITS, FRAMING, NO_PARITY, PARITY, UartBytes

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.ground.model import I64, Chunk
    from sniffer.signals.rates import BitTime
    from sniffer.signals.stretch import LogicInput

BYTE_BITS: Final = DATA_BITS + 2
"""Bits of a byte at the nominal rate, 8N1, as ``ground.timing`` lays it out."""

PAUSE: Final = 1.0
"""A longer silence between two bytes, in bits, ends a run."""

OFF: Final = 0.2
"""How far bytes of one chunk may be from their places, in bits: 2 % of a byte."""

MOST: Final = 16
"""Bytes of a chunk: what 2 % add up to stays below half a byte."""

_KINDS: Final = ((BREAK, MarkKind.BREAK), (FRAMING, MarkKind.FRAMING), (PARITY, MarkKind.PARITY))


class Chunker:
    """Makes chunks of the bytes of one channel.

    Args:
        told: how the wire is read.
        given: the capture, whose ticks they are.
        bus: whose chunks they are.
        direction: which wire of the bus it is.
    """

    def __init__(
        self, told: BitTime, given: LogicInput, bus: str, direction: Direction = Direction.UNKNOWN
    ) -> None:
        self._bit = told.bit
        self._bits = BYTE_BITS + (told.parity != NO_PARITY)
        self._nominal = NS / told.baud / given.tick_ns
        self._tick_ns, self._zero_ns = given.tick_ns, given.zero_ns
        self._bus, self._direction = bus, direction
        self._last: int | None = None  # when the last byte began, in ticks

    def chunks(self, got: UartBytes) -> Sequence[Chunk]:
        """Return the chunks of some bytes, in order."""
        n = len(got.value)
        if not n:
            return []
        laid = got.start - BYTE_BITS * self._nominal * np.arange(n)
        # where a capture was cut nothing begins: the byte before may be one of the last call
        begins = np.ones(n, bool)
        begins[1:] = np.diff(got.start) > (self._bits + PAUSE) * self._bit
        if self._last is not None:
            begins[0] = got.start[0] - self._last > (self._bits + PAUSE) * self._bit
        self._last = int(got.start[-1])
        rows = np.arange(n)
        run = np.maximum.accumulate(np.where(begins, rows, 0))
        place = np.rint((laid - laid[run]) / (OFF * self._nominal))
        nth = rows - run
        cut = begins | (nth == 1) | ((nth - 1) % MOST == 0)
        cut[0] = True
        cut[1:] |= place[1:] != place[:-1]
        first = np.flatnonzero(cut)
        end = np.append(first[1:], n)
        # What begins a run is to begin at its edge; what ends elsewhere, to end where it did.
        length = np.where(begins[end - 1], BYTE_BITS * self._nominal, self._bits * self._bit)
        since = np.rint((got.start[end - 1] + length) * self._tick_ns).astype(np.int64)
        return ChunkRun(
            got.value.tobytes(),
            end,
            since + self._zero_ns,
            np.full(len(end), self._direction, np.uint8),
            Clock.SAMPLE,
            self._bus,
            _marks(got, first),
        )


def _marks(got: UartBytes, first: I64) -> Mapping[int, tuple[Mark, ...]]:
    """Return what was wrong with bytes, by chunk."""
    bad = np.flatnonzero(got.flags)
    of = np.searchsorted(first, bad, "right") - 1
    at = (bad - first[of]).tolist()
    out: dict[int, tuple[Mark, ...]] = {}
    for nth, place, flags in zip(of.tolist(), at, got.flags[bad].tolist(), strict=True):
        marks = tuple(Mark(kind, place, 1) for flag, kind in _KINDS if flags & flag)
        out[nth] = (*out.get(nth, ()), *marks)
    return out
