"""One file of a flight recorder: chunks go in, and in steps what is made of them."""

from __future__ import annotations

import contextlib
import heapq
import time
from collections import deque
from typing import TYPE_CHECKING, Final

from sniffer.decoding.detect import UndecidedError
from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.ground.model import Chunk, Clock, Direction, Mark, MarkKind

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence
    from pathlib import Path

    from sniffer.mcapfile.ring import Past
    from sniffer.mcapfile.ros2 import JointPlaces
    from sniffer.mcapfile.sink import McapSink

PIECE: Final = 1 << 16
"""Bytes that are recorded and decoded in one go, as the recorder itself does."""


class FlightFile:
    """A file with the time around something that happened.

    Args:
        path: of the file.
        facts: of its session.
        options: how it is decoded.
        past: what each bus said before.
        until_ns: when it ends; that may be put off.
        last_ns: until when it may be put off.
        durable: whether the disk is waited for with each flush.
        topics: what is written beside the raw bytes; None: everything.
        joints: what ROS 2 understands is written, too; None: it is not.

    Raises:
        OutputError: the file cannot be written.
    """

    def __init__(
        self,
        path: Path,
        facts: Mapping[str, str],
        options: Options,
        past: Mapping[str, Past],
        *,
        until_ns: int,
        last_ns: int,
        durable: bool,
        topics: Collection[str] | None,
        joints: JointPlaces | None = None,
    ) -> None:
        from sniffer.mcapfile.sink import McapSink  # the mcap library is loaded when it is needed

        self.path = path
        self.until_ns = until_ns
        self.last_ns = last_ns
        self.is_over = False
        self.bytes = 0
        starts = {bus: some.start for bus, some in past.items()}
        self.sink: McapSink = McapSink(
            path,
            facts,
            overwrite=False,
            live=True,
            durable=durable,
            topics=topics,
            starts=starts,
            joints=joints,
        )
        self._pipeline = Pipeline(options, [self.sink], live=True, starts=starts)
        # of one bus they stay in their order, whatever their stamps say
        each = (some.chunks() for some in past.values())
        self._past = heapq.merge(*each, key=lambda c: c.t_ns or 0)
        self._next = next(self._past, None)
        """The next one of before, as long as there is one."""
        self._waiting: deque[Chunk] = deque()
        self._ended: list[Chunk] = []
        self._wires = dict.fromkeys(starts, Direction.UNKNOWN)

    def add(self, chunks: Sequence[Chunk]) -> None:
        """Take what came since; what is too late waits, for the end may be put off."""
        if not self.is_over:
            self._waiting.extend(chunks)

    def end(self, now_ns: int) -> None:
        """Take nothing more: what is open at that time was not waited for."""
        self.is_over = True
        mark = (Mark(MarkKind.ENDED, 0, count=0),)
        self._ended = [Chunk(b"", now_ns, Clock.READ, b, w, mark) for b, w in self._wires.items()]

    def work(self, until: float) -> bool:
        """Write and decode until it is time to do other things; tell whether it is finished."""
        while by_bus := self._piece():
            self._take(by_bus)
            if time.monotonic() >= until:
                return False
        if self.is_over:
            self._take({chunk.bus: [chunk] for chunk in self._ended})
            with contextlib.suppress(UndecidedError):  # its bytes are recorded
                self._pipeline.close()
            self._pipeline.finish()
            return True
        self.sink.flush()
        return False

    def _piece(self) -> dict[str, list[Chunk]]:
        """Return some of what waits, by bus: nothing that is later than the end."""
        by_bus: dict[str, list[Chunk]] = {}
        size = 0
        while size < PIECE and (chunk := self._due()) is not None:
            if self._next is not None:
                self._next = next(self._past, None)
            else:
                self._waiting.popleft()
            by_bus.setdefault(chunk.bus, []).append(chunk)
            self._wires.setdefault(chunk.bus, chunk.direction)
            size += len(chunk.data)
        self.bytes += size
        return by_bus

    def _due(self) -> Chunk | None:
        """Return what is next to be written; None: nothing, or it is later than the end."""
        chunk = self._next or (self._waiting[0] if self._waiting else None)
        return chunk if chunk is not None and (chunk.t_ns or 0) <= self.until_ns else None

    def _take(self, by_bus: Mapping[str, Sequence[Chunk]]) -> None:
        """Record chunks, and decode them then."""
        for bus, chunks in by_bus.items():
            self._pipeline.record(bus, chunks)
        self._check()
        self.sink.flush()
        for bus, chunks in by_bus.items():
            self._pipeline.decode(bus, chunks)
        self._check()

    def _check(self) -> None:
        if self._pipeline.failure is not None:
            raise self._pipeline.failure
