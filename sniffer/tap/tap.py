"""A port and the bus it listens to: raw reads in, chunks out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from sniffer.ground.model import NS, Chunk, Clock, Direction, Mark, MarkKind
from sniffer.ground.timing import LATENCY_NS
from sniffer.tap.events import Back, Counted, Event, Lost, Read, Retuned
from sniffer.tap.reader import BREATH_NS

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from sniffer.ports import Counters, Port
    from sniffer.protocols.base import BusProtocol

NOT_TOLD_NS: Final = max(LATENCY_NS.values())
"""What is taken for the latency of an adapter that does not tell."""

SILENT_NS: Final = NS
"""A bus is called silent after this time without a byte."""


@dataclass(frozen=True, slots=True)
class PortSpec:
    """What the user said about a port.

    ``protocol`` is a name, a file that defines one, or the protocol itself; None: as for all ports.
    """

    bus: str
    port: str
    protocol: str | BusProtocol | None = None
    baud: int | None = None


class Tap:
    """One port of a recording.

    Args:
        spec: which bus it is.
        port: the opened port.
        direction: the wire it hears, where two taps hear one bus.
    """

    def __init__(
        self, spec: PortSpec, port: Port, direction: Direction = Direction.UNKNOWN
    ) -> None:
        self.spec = spec
        self.port = port
        self.direction = direction
        self.bytes = 0
        self.lost = 0
        self.errors = 0
        self.away_ns: int | None = None
        self.last_ns: int | None = None
        counts = bool(port.counts_errors) and port.counters() is not None
        self._tells_errors = bool(port.marks_errors) or counts
        # of the port as it was opened last: errors that the stream told of, that the driver
        # counted, and that were counted and not marked by then
        self._marked = self._counts = self._unmarked = 0
        self._past = 0  # errors until then
        self._since = 0  # bytes since the counters were read

    @property
    def latency_ns(self) -> int:
        """How long bytes may be held back between the wire and their stamp, at its rate of now."""
        held_ns = self.port.latency_ns
        return BREATH_NS + (NOT_TOLD_NS if held_ns is None else held_ns)

    @property
    def line_errors(self) -> int | None:
        """Line errors so far, None where neither marks nor counters tell, or none has yet."""
        return self.errors if self._tells_errors or self.errors else None

    def state(self, now_ns: int) -> str:
        """Return whether the port is listening, silent or away."""
        if self.away_ns is not None:
            return "away"
        if self.last_ns is None or now_ns - self.last_ns > SILENT_NS:
            return "silent"
        return "listening"

    def heard(self, read: Read) -> Chunk | None:
        """Return what a read adds to the stream; of busy lines there are thousands a second."""
        _, t_ns, raw, held_ns = read
        data, marks = self.port.unmark(raw)
        self.bytes += len(data)
        self._since += len(data)
        self.last_ns = t_ns
        if marks:
            self._marked += sum(mark.count for mark in marks)
            self._add_up()
        if held_ns and data:
            marks = (Mark(MarkKind.HELD, 0, len(data), held_ns), *marks)
        return self._chunk(data, t_ns, marks) if data or marks else None

    def chunks(self, event: Event) -> Iterable[Chunk]:
        """Return what an event of the listener adds to the stream."""
        if isinstance(event, Read):  # nearly all are: no generator is made for them
            chunk = self.heard(event)
            return () if chunk is None else (chunk,)
        return self._rare(event)

    def _rare(self, event: Event) -> Iterator[Chunk]:
        match event:
            case Lost(t_ns=t_ns):
                self.away_ns = t_ns
                self.lost += 1
                yield self._chunk(b"", t_ns, (Mark(MarkKind.LOST, 0),))
            case Back(t_ns=t_ns, opened=port):
                away_ns = t_ns - (self.away_ns if self.away_ns is not None else t_ns)
                self.port, self.away_ns = port, None
                self._past, self._marked, self._counts, self._unmarked = self.errors, 0, 0, 0
                yield self._chunk(b"", t_ns, (Mark(MarkKind.BACK, 0, count=away_ns),))
            case Retuned(t_ns=t_ns, baud=baud, done=done):
                if done:
                    yield self._chunk(b"", t_ns, (Mark(MarkKind.TUNED, 0, count=baud),))
            case Counted(t_ns=t_ns, now=now, before=before):
                marks = tuple(self._counted(now, before))
                self._since = 0
                if marks:
                    yield self._chunk(b"", t_ns, marks)

    def _counted(self, now: Counters, before: Counters) -> Iterator[Mark]:
        """Return what the counters add to the marks: the bytes since they were last read.

        A driver counts an error before its bytes can be read, so a mark may come after its count:
        both are added up since the port was opened. Where no byte was read since they were last
        counted, the bytes of an error are still to come, and bring its mark with them.
        """
        risen = now.since(before)
        region = self._since
        counted = risen.frame + risen.parity + risen.brk
        self._counts += counted
        is_to_come = not region and bool(self.port.marks_errors)
        new = 0 if is_to_come else self._counts - self._marked - self._unmarked
        new = min(counted, max(0, new))
        self._unmarked += new
        self._add_up()
        known = counted - new
        for kind, count in (
            (MarkKind.FRAMING, risen.frame),
            (MarkKind.PARITY, risen.parity),
            (MarkKind.BREAK, risen.brk),
        ):
            told = min(known, count)
            known -= told
            if count > told:
                yield Mark(kind, -region, region, count - told)
        if lost := risen.overrun + risen.buf_overrun:
            self.lost += 1
            yield Mark(MarkKind.OVERRUN, -region, region, lost)

    def _add_up(self) -> None:
        self.errors = self._past + max(self._marked, self._counts)

    def _chunk(self, data: bytes, t_ns: int, marks: tuple[Mark, ...]) -> Chunk:
        return Chunk(data, t_ns, Clock.READ, self.spec.bus, self.direction, marks)
