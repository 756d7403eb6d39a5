"""What was decoded of a live recording: when it is due it is written in turns, raw bytes between.

To encode a second of eight full lines and to write it takes 140 ms: so long no raw byte would be
written, and a recorder that is killed would lose them.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Final

from sniffer.messages import BULK, FLAT, PLOTS, SHOWN

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.mcapfile.container import Container
    from sniffer.mcapfile.messages import BusWriter
    from sniffer.mcapfile.queue import Queue, Sorted
    from sniffer.mcapfile.ros2 import RosWriter

TURN: Final = 1 << 18
"""Bytes of the buses whose records are encoded in a turn, some 30 ms."""

WRITTEN: Final = 4 << 20
"""Records that are written in a turn, in bytes."""

TURNS: Final = 8
"""Turns that either takes at most: where there is more, they are longer."""

FULL: Final = 4 << 20
"""Bytes of the buses from which on they are due at once."""

_OVER: Final = object()


class Turns:
    """Writes what was decoded, kind by kind.

    Args:
        queue: holds the records that are encoded.
        file: takes them.
        ros2: has more of them, None: nobody does.
        flush_ns: how long what was decoded may wait, in ns.
    """

    def __init__(
        self, queue: Queue, file: Container, ros2: RosWriter | None, flush_ns: int
    ) -> None:
        self._queue = queue
        self._file = file
        self._ros2 = ros2
        self._flush_ns = flush_ns
        self._began = time.monotonic_ns()
        self._rest: Iterator[None] | None = None

    def take(self, buses: Sequence[BusWriter], *, final: bool) -> None:
        """Take a turn, where one is due; ``final``: write all there is."""
        if self._rest is None and not final and self._is_due(buses):
            self._rest = self._all(buses, final=False)
        if self._rest is not None and next(self._rest, _OVER) is _OVER:
            self._rest = None
        if final:
            for rest in (self._rest or (), self._all(buses, final=True)):
                for _ in rest:
                    pass

    def _is_due(self, buses: Sequence[BusWriter]) -> bool:
        waited = time.monotonic_ns() - self._began
        return waited >= self._flush_ns or sum(bus.held for bus in buses) >= FULL

    def _all(self, buses: Sequence[BusWriter], *, final: bool) -> Iterator[None]:
        """Encode bus by bus, then write kind by kind: what is alike packs best side by side."""
        self._began = time.monotonic_ns()
        turn, done = max(TURN, sum(bus.held for bus in buses) // TURNS), 0
        for bus in buses:
            done += bus.held
            bus.encode(final=final)
            if done >= turn:
                done = 0
                yield
        turn = max(WRITTEN, self._queue.size // TURNS)
        for topics in (*((topic,) for topic in BULK), (*SHOWN, FLAT, PLOTS)):
            for piece in _pieces(self._queue.lots(topics)):
                self._file.write(piece, indexed=topics[0] not in BULK)
                done += len(piece.data)
                if done >= turn:
                    done = 0
                    yield
        for piece in _pieces(None if self._ros2 is None else self._ros2.take()):
            self._file.write(piece, indexed=True)


def _pieces(rows: Sorted | None) -> Iterator[Sorted]:
    return iter(()) if rows is None else rows.pieces()
