"""Packets of serial lines as chunks: RTAC heads, and bytes alone in a link type of the user's own.

What this tool wrote is put together again chunk by chunk. What others wrote has a packet a chunk;
a head of its own time tells whether the packet's is that of the first byte or of the last.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.ground.limits import BAUDS
from sniffer.ground.model import NS, Chunk, Clock, DamagedInputError, Direction, Mark, MarkKind
from sniffer.ground.timing import byte_time_ns
from sniffer.pcapfile.chunkends import ChunkEnd, unpacked
from sniffer.pcapfile.layout import (
    HEAD,
    INBOUND,
    MARKS,
    NO_TIMES,
    OUTBOUND,
    RATE,
    RTAC_SERIAL,
    RtacEvent,
    RtacFooter,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.pcapfile.reader import CapturedPacket, CaptureFace

CHUNK_MOST: Final = 1 << 20
"""Bytes of a chunk that wait for its end at most: sources give no longer ones."""

_WIRES: Final = {
    RtacEvent.TX_START: Direction.TX,
    RtacEvent.TX_END: Direction.TX,
    RtacEvent.RX_START: Direction.RX,
    RtacEvent.RX_END: Direction.RX,
}
_FINE: Final = 100_000
"""Ticks a second: a clock that has fewer says within which time a packet came, not when."""

_FLAGGED: Final = {OUTBOUND: Direction.TX, INBOUND: Direction.RX}
_EVENTS: Final = {event.value: event for event in RtacEvent}


class SerialLine:
    """One bus: takes its packets, gives its chunks."""

    def __init__(self, bus: str) -> None:
        self._bus = bus
        self._begun = bytearray()
        self._t_ns: int | None = None
        self._clock = Clock.FILE
        self._heard = 0
        self.early = 0
        """Bytes whose stamp is that of their packet's first one, where nobody said the rate."""

    def take(self, packet: CapturedPacket) -> Iterator[Chunk]:
        """Yield the chunks that a packet ends.

        Raises:
            DamagedInputError: it makes no sense.
        """
        face, data = packet.face, packet.data
        if face.link != RTAC_SERIAL:
            wire = _FLAGGED.get(packet.flags & 3, Direction.UNKNOWN)
            coarse = NS // face.unit if face.unit < _FINE else 0
            t_ns = None if packet.t_ns is None else packet.t_ns + max(coarse - 1, 0)
            yield from self._alone(packet, data, wire, t_ns, coarse=coarse)
            return
        if len(data) < HEAD.size:
            if packet.lost:
                return  # whoever captured it kept less than the head
            raise DamagedInputError(f"a packet of {self._bus} is too short for its head")
        seconds, micros, number, _, foot = HEAD.unpack_from(data)
        payload, event = data[HEAD.size :], _EVENTS.get(number, RtacEvent.STATUS_CHANGE)
        if RtacFooter.of(foot) is not None:
            yield from self._ours(packet, payload, event)
            return
        if event == RtacEvent.DATA_LOST:
            event = RtacEvent.OVERFLOW  # whoever lost them, they were on the line
        began = seconds * NS + micros * 1000
        t_ns = self._end(packet, began, len(payload), event)
        yield from self._alone(packet, payload, _WIRES.get(event, Direction.UNKNOWN), t_ns, event)

    def end(self) -> Iterator[Chunk]:
        """Yield what waits for the rest of its chunk, which does not come."""
        if self._begun:
            clock = Clock.NONE if self._t_ns is None else self._clock or Clock.FILE
            yield self._chunk(b"", self._t_ns, clock, Direction.UNKNOWN)

    def _ours(self, packet: CapturedPacket, data: bytes, event: RtacEvent) -> Iterator[Chunk]:
        t_ns = None if NO_TIMES in packet.face.description else packet.t_ns
        if packet.chunk_ends is None:
            yield from self.end()
            # who asks was told by decoding, not by the wire that it was heard on
            yield from self._alone(packet, data, Direction.UNKNOWN, t_ns, event)
            return
        self._t_ns = t_ns
        try:
            ends = [end for option in packet.chunk_ends for end in unpacked(option)]
        except ValueError as error:
            raise DamagedInputError(f"a packet of {self._bus}: {error}") from None
        done = 0
        for end in ends:
            if not done <= end.end <= len(data):
                raise DamagedInputError(f"a packet of {self._bus} says of chunks what cannot be")
            yield self._put(data[done : end.end], end)
            done = end.end
        if done < len(data):
            self._begun += data[done:]
            if len(self._begun) > CHUNK_MOST:
                yield from self.end()

    def _put(self, data: bytes, end: ChunkEnd) -> Chunk:
        size = len(self._begun) + len(data)
        self._clock = end.clock
        marks = tuple(m._replace(start=m.start + size) for m in end.marks)
        return self._chunk(data, end.t_ns, end.clock, end.direction, marks)

    def _chunk(
        self,
        data: bytes,
        t_ns: int | None,
        clock: Clock,
        wire: Direction,
        marks: tuple[Mark, ...] = (),
    ) -> Chunk:
        if self._begun:
            data = bytes(self._begun) + data
            self._begun.clear()
        self._heard += len(data)
        return Chunk(data, t_ns, clock, self._bus, wire, marks)

    def _alone(
        self,
        packet: CapturedPacket,
        data: bytes,
        wire: Direction,
        t_ns: int | None,
        event: RtacEvent = RtacEvent.STATUS_CHANGE,
        *,
        coarse: int = 0,
    ) -> Iterator[Chunk]:
        """Yield a packet as a chunk of its own; ``coarse``: what its clock shows at once, in ns."""
        marks = []
        if coarse and data:
            marks.append(Mark(MarkKind.COARSE, 0, len(data), coarse))
        if event in MARKS:
            # an error without bytes is about the byte before it
            before = 0 if data or not self._heard else 1
            marks.append(Mark(MARKS[event], -before, len(data) or before))
        if packet.lost:
            marks.append(Mark(MarkKind.OVERRUN, len(data), 0, packet.lost))
        if data or marks:
            clock = Clock.NONE if t_ns is None else Clock.FILE
            yield self._chunk(data, t_ns, clock, wire, tuple(marks))

    def _end(self, packet: CapturedPacket, began: int, size: int, event: RtacEvent) -> int | None:
        """Return when the last byte of somebody else's packet came."""
        t_ns = packet.t_ns
        at_end = event in (RtacEvent.TX_END, RtacEvent.RX_END)
        if t_ns is None or at_end or t_ns // 1000 > began // 1000 or not size:
            return t_ns
        baud = stated_baud(packet.face)
        if baud is None:
            self.early += size
            return t_ns
        return t_ns + size * byte_time_ns(baud)


def stated_baud(face: CaptureFace) -> int | None:
    """Return the rate that an interface states, None where there is none, or it was a guess."""
    if RATE in face.description or not BAUDS[0] <= face.speed <= BAUDS[1]:
        return None
    return face.speed
