"""What was asked and answered in a recording, exchange by exchange, with its bytes and delays."""

from __future__ import annotations

import bisect
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from sniffer.ground.codes import DAMAGED, NEVER, REQUEST
from sniffer.ground.model import ECHO, Clock, InputError
from sniffer.ground.timing import byte_time_ns

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.decoding.pacing import Pace
    from sniffer.ground.model import Batch, Chunk, Frames
    from sniffer.protocols.base import BusProtocol
    from sniffer.simulation.talk import HeardFrame


class RequestKey(NamedTuple):
    """What makes two requests alike although their bytes differ: the servo, and what of it.

    ``size`` is that of what is read or written; ``address`` is -1 where a command names none.
    """

    servo_id: int
    op: int
    address: int
    size: int

    @classmethod
    def heard(cls, frame: HeardFrame) -> RequestKey:
        """Return the key of a frame that is heard."""
        size = len(frame.data) or frame.token
        return cls(frame.servo_id, frame.op, frame.address, size)

    @classmethod
    def of(cls, frames: Frames, row: int) -> RequestKey:
        """Return the key of a recorded frame."""
        size = int(frames.data_length[row]) or int(frames.token[row])
        servo_id, op = int(frames.servo_id[row]), int(frames.op[row])
        return cls(servo_id, op, int(frames.address[row]), size)


class PlayedReply(NamedTuple):
    """Bytes that came back, and how long after the request's last byte their first one came."""

    delay_ns: int
    data: bytes


@dataclass(slots=True)
class RecordedExchange:
    """A request of a recording with all that came back; whole replies and torn ones alike.

    ``waits``: an answer could be expected. ``start_ns`` and ``end_ns`` are those of the request.
    """

    raw: bytes
    key: RequestKey
    op: str
    waits: bool
    start_ns: int
    end_ns: int
    replies: list[PlayedReply] = field(default_factory=list)


class ExchangeSink:
    """A sink that keeps the exchanges of the buses of a recording.

    ``echoes`` are requests that an adapter gave back to who sent them.
    """

    def __init__(self) -> None:
        self.buses: dict[str, list[RecordedExchange]] = {}
        self.protocols: dict[str, BusProtocol] = {}
        self.bauds: dict[str, int] = {}
        self.echoes: dict[str, int] = {}
        self._starts: dict[str, list[int]] = {}
        self._torn: dict[tuple[str, int], RecordedExchange] = {}

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing."""

    def pace(self, bus: str, told: Pace) -> None:
        """Keep the rate of a bus."""
        self.bauds[bus] = told.baud

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Take what one pass decided.

        Raises:
            InputError: two protocols share the wire.
        """
        if batch.is_shared:
            raise InputError(f"{bus}: two protocols share the wire: its servos cannot be played")
        self.protocols[bus] = protocol
        exchanges, starts = self.buses.setdefault(bus, []), self._starts.setdefault(bus, [])
        f = batch.frames
        for row in (f.kind == REQUEST).nonzero()[0].tolist():
            start, length = int(f.start[row]), int(f.length[row])
            if f.flags[row] & ECHO:
                self.echoes[bus] = self.echoes.get(bus, 0) + 1
                continue
            raw = batch.data[start : start + length]
            op, waits = protocol.op_name(int(f.op[row])), int(f.reply[row]) != NEVER
            times = int(f.t_start[row]), int(f.t_end[row])
            exchanges.append(RecordedExchange(raw, RequestKey.of(f, row), op, waits, *times))
            starts.append(batch.base + start)
        self._pair(bus, batch)
        self._tear(bus, batch)

    def _pair(self, bus: str, batch: Batch) -> None:
        """Give each answer to the request that it answers, or else to the last one before it."""
        f, t = batch.frames, batch.transactions
        columns = (t.request.tolist(), t.response.tolist(), t.outcome.tolist())
        for request, response, outcome in zip(*columns, strict=True):
            start = None
            if request >= 0:
                start = batch.base + int(f.start[request])
            elif request < -1 and batch.before is not None:
                start = batch.base + int(batch.before.start[-2 - request])
            elif response >= 0:
                start = batch.base + int(f.start[response]) - 1
            asked = None if start is None else self._at(bus, start)
            if asked is None:
                continue
            if response >= 0:
                at, length = int(f.start[response]), int(f.length[response])
                delay = int(f.t_start[response]) - asked.end_ns
                data = batch.data[at : at + length]
                asked.replies.append(PlayedReply(_known(delay, batch), data))
            elif outcome == DAMAGED and start is not None:
                self._torn[bus, start + len(asked.raw)] = asked

    def _tear(self, bus: str, batch: Batch) -> None:
        """Give torn bytes right behind a request to it, where they are what became of its reply."""
        if not self._torn:
            return
        byte_ns = byte_time_ns(self.bauds[bus]) if bus in self.bauds else 0
        for gap in batch.gaps:
            start = batch.base + gap.start
            asked = self._torn.pop((bus, start), None)
            if asked is not None:
                began = gap.t_ns - gap.length * byte_ns
                data = batch.data[gap.start : gap.start + gap.length]
                reply = PlayedReply(_known(began - asked.end_ns, batch), data)
                asked.replies.append(reply)
                self._torn[bus, start + gap.length] = asked  # long ones come in pieces

    def _at(self, bus: str, start: int) -> RecordedExchange | None:
        """Return the exchange whose request begins at an offset, or last before it."""
        nth = bisect.bisect_right(self._starts[bus], start) - 1
        return self.buses[bus][nth] if nth >= 0 else None

    def close(self) -> None:
        """Put replies in the order in which they came."""
        for exchanges in self.buses.values():
            for one in exchanges:
                one.replies.sort(key=lambda reply: reply.delay_ns)


def _known(delay_ns: int, batch: Batch) -> int:
    """Return a delay as far as the input tells it: without a clock nobody knows, and it is none."""
    return 0 if batch.clock == Clock.NONE else max(delay_ns, 0)
