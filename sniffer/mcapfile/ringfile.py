"""The ring of a flight recorder on the disk: what a recorder that is killed leaves behind.

One recording of raw bytes alone, flushed as recordings are. It holds between one and two spans of
the ring: once it has two, another one is begun beside it with what the ring holds, takes what comes
as well until it has caught up, and then takes its place. So at any time the file of that name has
all that the ring has, but for the last round.
"""

from __future__ import annotations

import contextlib
from collections import deque
from typing import TYPE_CHECKING, Final

from sniffer.decoding.names import joined
from sniffer.ground.files import occupied, writing
from sniffer.ground.model import InputError
from sniffer.mcapfile.ring import MARGIN_NS, RingBlock

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from sniffer.decoding.rates import Rate
    from sniffer.ground.model import Chunk
    from sniffer.mcapfile.ring import Ring
    from sniffer.mcapfile.sink import McapSink
    from sniffer.protocols.base import BusProtocol

ONLY_RAW: Final = ("raw",)

RING: Final = "ring"
"""The fact by which a ring on the disk is known."""

STEP: Final = 4 << 20
"""Bytes of the ring that are copied in one round: some ten ms."""


class RingFile:
    """Keeps a ring on the disk.

    Args:
        path: of the file; one that a recorder left behind there is put aside, see ``put_aside``.
        session: facts of the recording.
        ring: what it is a copy of.
        durable: whether the disk is waited for with each flush.

    Raises:
        OutputError: the file cannot be written.
    """

    def __init__(
        self, path: Path, session: Mapping[str, str], ring: Ring, *, durable: bool = False
    ) -> None:
        self.path = path
        self._ring = ring
        self._session = dict(session)
        self._durable = durable
        self._spoken: dict[str, str] = {}
        self._first_ns: int | None = None
        self._bytes = 0
        self._next: McapSink | None = None
        self._next_first_ns = 0
        self._next_bytes = 0
        self._behind: deque[RingBlock] = deque()
        self._other = path.with_name(f".{path.name}.next")
        self._sink = self._begin(path, {})

    def know(self, bus: str, protocols: Sequence[BusProtocol]) -> None:
        """Learn what a bus speaks: the next file says so."""
        self._spoken[bus] = joined(protocols)

    def tuned(self, bus: str, rate: Rate) -> None:
        """Take the rate that was found for a bus."""
        self._session.update((f"{key}.{bus}", value) for key, value in rate.facts().items())
        for sink in (self._sink, self._next):
            if sink is not None:
                sink.tuned(bus, rate)

    def add(self, block: RingBlock, chunks: Sequence[Chunk]) -> None:
        """Take what the ring has taken."""
        self._sink.raw(block.bus, chunks)
        self._bytes += len(block.data)
        if self._first_ns is None:
            self._first_ns = block.times[0]
        if self._next is not None:
            self._behind.append(block)

    def flush(self, now_ns: int) -> None:
        """Write what waits; where it is time, go on with another file that takes this one's place.

        Raises:
            OutputError: it cannot be written.
        """
        self._sink.flush()
        if self._next is None:
            span_ns = self._ring.span_ns + MARGIN_NS
            is_long = self._first_ns is not None and now_ns - self._first_ns >= 2 * span_ns
            if is_long or self._bytes >= 2 * max(self._ring.size, STEP):
                self._follow()
        else:
            self._catch_up(self._next)

    def close(self) -> None:
        """Finish the file: it stays, with the last that was heard."""
        if self._next is not None:
            self._next.abandon()
            self._other.unlink(missing_ok=True)
        self._sink.close()

    def _begin(self, path: Path, starts: Mapping[str, int]) -> McapSink:
        from sniffer.mcapfile.sink import McapSink  # the mcap library is loaded when it is needed

        facts = {**self._session, RING: "the last of what was heard, before anything happened"}
        facts |= {f"protocol.{bus}": name for bus, name in self._spoken.items()}
        return McapSink(
            path, facts, live=True, durable=self._durable, topics=ONLY_RAW, starts=starts
        )

    def _follow(self) -> None:
        """Begin the next file with what the ring holds."""
        blocks = self._ring.blocks()
        starts: dict[str, int] = {}
        for block in blocks:
            starts.setdefault(block.bus, block.start)
        self._next = self._begin(self._other, starts)
        self._behind = deque(blocks)
        self._next_first_ns = blocks[0].times[0] if blocks else 0
        self._next_bytes = 0

    def _catch_up(self, sink: McapSink) -> None:
        """Copy some of what the next file has not got; once it has all, it takes over."""
        step = 0
        while self._behind and step < STEP:
            block = self._behind.popleft()
            sink.raw(block.bus, [chunk for _, chunk in block.placed()])
            step += len(block.data)
        sink.flush()
        self._next_bytes += step
        if self._behind:
            return
        with writing(self.path):
            self._other.replace(self.path)
        self._sink.abandon()
        self._sink, self._next = sink, None
        self._first_ns, self._bytes = self._next_first_ns, self._next_bytes


def is_ring(path: Path) -> bool:
    """Tell whether a file is a ring of some recorder, ended or not."""
    from sniffer.mcapfile.source import session

    with contextlib.suppress(InputError):
        return RING in session(path)
    return False


def put_aside(path: Path, aside: Path) -> bool:
    """Keep what a recorder that did not end has left behind; tell whether there was any.

    A file that was finished is none of these: whoever ended that recorder did so on purpose.

    Raises:
        OutputError: it cannot be moved.
    """
    if not occupied(path) or _is_whole(path):
        return False
    with writing(aside):
        path.replace(aside)
    return True


def _is_whole(path: Path) -> bool:
    """Tell whether a recording was finished: it ends with the mark that MCAP files end with."""
    from sniffer.messages import MAGIC

    with contextlib.suppress(OSError), path.open("rb") as file:
        file.seek(-len(MAGIC), 2)
        return file.read() == MAGIC
    return False
