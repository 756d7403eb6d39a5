"""Blocks of bytes of which only the first has a time: what ended is handed on without one.

Some loggers write the time of the first byte that they read, and then all that comes until a pause,
a turn or the end of the row. Nothing tells when the other bytes came, so only that one has a stamp.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING

from sniffer.ground.coarse import FINE, coarse
from sniffer.ground.model import Chunk, Clock, Direction
from sniffer.sources.text import PIECE, LineBlock, TextLog

if TYPE_CHECKING:
    from collections.abc import Iterator


class StampedBlock:
    """The block that is being read.

    Args:
        bus: whose bytes come until another one is named.
    """

    def __init__(self, bus: str) -> None:
        self.bus = bus
        self.direction = Direction.UNKNOWN
        self.t_ns: int | None = None
        """The time of the byte to come; None behind it."""
        self._places = FINE
        self._held = bytearray()

    def begin(
        self, t_ns: int, bus: str, direction: Direction = Direction.UNKNOWN, places: int = FINE
    ) -> Iterator[Chunk]:
        """Yield what is held of the block before, and begin one at ``t_ns``.

        ``places``: decimal places of a second that are written of the time.
        """
        yield from self.rest()
        self.t_ns, self.bus, self.direction, self._places = t_ns, bus, direction, places

    def add(self, data: bytes) -> Iterator[Chunk]:
        """Yield what is complete when ``data`` has come."""
        if data and self.t_ns is not None:
            marks = coarse(1, self._places)
            yield Chunk(data[:1], self.t_ns, Clock.FILE, self.bus, self.direction, marks)
            self.t_ns, data = None, data[1:]
        self._held += data
        if len(self._held) >= PIECE:
            yield from self.rest()

    def rest(self) -> Iterator[Chunk]:
        """Yield the bytes without a stamp that have come."""
        if self._held:
            yield Chunk(bytes(self._held), bus=self.bus, direction=self.direction)
            self._held.clear()


class StampedLog(TextLog):
    """A log of such blocks, which is read line by line."""

    def __init__(self, bus: str) -> None:
        self._block = StampedBlock(bus)
        self.cut_off = False

    @abstractmethod
    def _line(self, line: bytes, number: int, cut_off: bool) -> Iterator[Chunk]:
        """Yield what is complete behind a line."""

    def chunks(self, block: LineBlock) -> Iterator[Chunk]:
        """Yield what the lines of ``block`` hold."""
        for number, line in enumerate(block.lines(), block.number):
            yield from self._line(line, number, block.cut_off)
        yield from self.rest()

    def rest(self) -> Iterator[Chunk]:
        """Yield the bytes without a stamp that have come."""
        yield from self._block.rest()
