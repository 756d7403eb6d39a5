"""What one bus says, as messages: chunks and batches in, message records out, a topic each.

Rows that are many go through the bulk encoder; gaps, anomalies and the seconds of the statistics
are rare and built one by one. ``log_time`` is when the bytes arrived, ``publish_time`` when they
were on the wire by the best estimate.
"""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.anomalies.found import Anomalies
from sniffer.decoding.called import ServoNames
from sniffer.decoding.joining import joined, runs
from sniffer.decoding.sink import bus_of
from sniffer.ground.gaps import Gaps
from sniffer.ground.model import I64, NS, Clock
from sniffer.ground.timing import byte_time_ns
from sniffer.mcapfile.encoder import Encoder
from sniffer.mcapfile.held import ANOMALIES, FRAMES, GAPS, Arrivals, Seconds
from sniffer.mcapfile.orders import FRAME_ORDER, TRANSACTION_ORDER
from sniffer.mcapfile.rare import anomaly_messages, gap_messages, log_messages
from sniffer.mcapfile.raw import HeldChunks, spoken
from sniffer.mcapfile.rows import U16, Blob, Heads, Loose
from sniffer.mcapfile.states import States
from sniffer.messages import FLAT
from sniffer.messages.log_pb2 import Log
from sniffer.messages.recording_pb2 import Anomaly, Frame, Gap, RawChunk, Stats, Transaction
from sniffer.messages.servo_state_pb2 import Quantity, ServoState

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    import numpy.typing as npt
    from google.protobuf.message import Message

    from sniffer.ground.model import Batch, Chunk
    from sniffer.mcapfile.kinds import MessageType
    from sniffer.mcapfile.queue import Queue
    from sniffer.mcapfile.ros2 import RosWriter
    from sniffer.protocols.base import BusProtocol


DERIVED: Final[Mapping[str, Any]] = {
    "frames": Frame,
    "transactions": Transaction,
    "state": ServoState,
    "gaps": Gap,
    "anomalies": Anomaly,
    "log": Log,
    "stats": Stats,
    FLAT: Quantity,
}
"""The message of each topic that is made of the raw bytes, by its kind."""


class BusWriter:
    """One bus.

    Args:
        name: of the bus.
        baud: bits per second, None for the protocol's default.
        start: offset of its first byte.
        queue: takes the records.
        open_channel: opens a channel (topic, message type, metadata) and returns its id.
        live: messages are not numbered in each channel, which packs worse by an eighth, and
            nothing that reads recordings asks for it; and the index does not name all states.
        ros2: writes what ROS 2 understands of it, None: nobody does.
        published: the publish time, in ns, that the frames of each bus have reached; kept up to
            date here, and shared by the files of one recording.
    """

    def __init__(
        self,
        name: str,
        baud: int | None,
        start: int,
        queue: Queue,
        open_channel: Callable[[str, type[Message] | MessageType, Mapping[str, str]], int],
        *,
        live: bool = False,
        ros2: RosWriter | None = None,
        published: dict[str, int] | None = None,
        names: ServoNames | None = None,
    ) -> None:
        self.name = name
        self._names = names or ServoNames()
        self.protocol: BusProtocol | None = None
        self.oldest: int | None = None
        """Log time of the first chunk."""
        self.newest = 0
        """Log time of the latest bytes that are encoded."""
        self.decoded = 0
        """Log time up to which they are decoded too."""
        self.held = 0
        """Bytes taken but not encoded yet, and a little for each call."""
        self._chunks: list[Chunk] = []
        self._batches: list[Batch] = []
        self._baud = baud
        self._queue = queue
        self._open = open_channel
        self._live = live
        self._channels: dict[str, int] = {}
        self._sequences: dict[int, int] = {}
        self._times: dict[int, tuple[int, int]] = {}
        self._published = {} if published is None else published
        self._arrivals = Arrivals(start)
        self._begin = self._offset = start
        self._seconds = Seconds()
        self._clock = Clock.NONE
        self._frames = Encoder(Frame)
        self._transactions = Encoder(Transaction)
        self._states: States | None = None
        self._ros2 = ros2
        self._root = name
        self._beside: dict[str, BusWriter] = {}

    def raw(self, chunks: Sequence[Chunk]) -> None:
        """Take chunks as they came."""
        self._chunks += chunks
        self.held += sum(len(c.data) for c in chunks) + len(chunks)

    def write(self, protocol: BusProtocol, batch: Batch) -> None:
        """Take what a pass decided."""
        self.held += len(batch.data) + 1
        if batch.is_shared:
            root = bus_of(self.name, protocol, batch)
            self._of(protocol, root).write(protocol, replace(batch, is_shared=False))
            return
        if self.protocol is None:
            self._start(protocol)
        self._batches.append(batch)

    def tune(self, baud: int) -> None:
        """Learn the rate of the bus."""
        self._baud = baud

    @property
    def is_known(self) -> bool:
        """Whether anything was decoded of this bus."""
        return self.protocol is not None or bool(self._beside)

    def fields(self) -> dict[str, set[str]]:
        """Return which fields the states of each topic had so far."""
        mine = self._states.seen if self._states is not None else {}
        out = {f"/{self._root.strip('/')}/{topic}": names for topic, names in mine.items()}
        for writer in self._beside.values():
            out |= writer.fields()
        return out

    def _of(self, protocol: BusProtocol, root: str) -> BusWriter:
        """Return what writes one of the protocols that share the wire, under topics of its own."""
        writer = self._beside.get(protocol.name)
        if writer is None:
            writer = BusWriter(
                self.name,
                self._baud,
                self._begin,
                self._queue,
                self._open,
                live=self._live,
                ros2=self._ros2,
                published=self._published,
                names=self._names,
            )
            writer._root, writer._arrivals = root, copy.deepcopy(self._arrivals)
            self._beside[protocol.name] = writer
        return writer

    def heard(self) -> HeldChunks | None:
        """Return the chunks that were taken, ready to be encoded."""
        chunks, self._chunks = self._chunks, []
        if not chunks:
            return None
        self.held = sum(len(b.data) + 1 for b in self._batches)
        self.held += sum(writer.held for writer in self._beside.values())
        timed = np.array([c.t_ns is not None for c in chunks])
        t = np.array([c.t_ns or 0 for c in chunks], np.int64)
        log = np.maximum.accumulate(np.where(timed, np.maximum(t, self.newest), self.newest))
        length = np.array([len(c.data) for c in chunks], np.int64)
        end = self._offset + np.cumsum(length)
        for writer in (self, *self._beside.values()):
            writer._arrivals.add(end, log, timed)
        self._offset = int(end[-1])
        self.newest = int(log[-1])
        if self.oldest is None:
            self.oldest = int(log[0])
        heads = self._heads(self._channel("raw", RawChunk), log, np.where(timed, t, log))
        return HeldChunks(chunks, heads, t, timed, end - length, length)

    def spoken(self) -> list[tuple[int, int, bytes]]:
        """Return log time, channel and record of each chunk that was taken, for a live recording.

        Either this is used or ``heard``.
        """
        chunks, self._chunks = self._chunks, []
        if not chunks:
            return []
        self.held = sum(len(b.data) + 1 for b in self._batches)
        self.held += sum(writer.held for writer in self._beside.values())
        channel = self._channel("raw", RawChunk)
        before = self._times.get(channel, (0, 0))
        told = spoken(chunks, channel, self._offset, self.newest, before)
        for writer in (self, *self._beside.values()):
            writer._arrivals.note(told.arrived)
        self._times[channel] = told.times
        self._offset, self.newest, _ = told.arrived[-1]
        if self.oldest is None:
            self.oldest = told.arrived[0][1]
        return told.rows

    def encode(self, *, final: bool = False) -> None:
        """Queue messages for all that was decoded, in one go; ``final``: nothing will follow.

        The chunks it was decoded from have been fetched by ``heard`` before.
        """
        batches, self._batches, self.held = self._batches, [], 0
        for run in runs(batches):
            self._write_batch(joined(run))
        if final and self._states is not None:
            self._states.settle(None)
        if batches or final:
            self._write_stats(final=final)
        for writer in self._beside.values():
            writer.encode(final=final)
        if self._beside:
            self.decoded = min(writer.decoded for writer in self._beside.values())

    def _write_batch(self, batch: Batch) -> None:
        self._clock = batch.clock
        frames = batch.frames
        end = batch.base + frames.end
        log = self._arrivals.of(end, frames.t_end)
        log = np.maximum.accumulate(np.maximum(log, self.decoded))
        if len(frames):
            reached = self._published.get(self._root, 0)
            publish = np.maximum.accumulate(np.maximum(frames.t_end, reached))
            self._published[self._root] = int(publish[-1])
            self._write_frames(batch, log, publish)
            self._write_transactions(batch, log)
            assert self._states is not None, "a batch comes with its protocol"
            self._states.write(batch, log, publish, self._arrivals.read(end))
        done = batch.base + len(batch.data)
        if self._states is not None:
            self._states.settle(done)
        self._seconds.count(FRAMES, frames.t_end, frames.length)
        self._write_gaps(batch)
        self._write_anomalies(batch)
        last = np.array([frames.t_end[-1] if len(frames) else self.decoded])
        last = np.maximum(last, self.decoded)
        self.decoded = int(self._arrivals.of(np.array([done]), last)[0])
        self.newest = max(self.newest, self.decoded)
        self._arrivals.forget(done)

    def _start(self, protocol: BusProtocol) -> None:
        self.protocol = protocol
        self._baud = self._baud or protocol.baud
        self._frames = Encoder(Frame, protocol.op_name, FRAME_ORDER)
        self._transactions = Encoder(Transaction, protocol.op_name, TRANSACTION_ORDER)
        self._states = States(
            protocol,
            self._queue,
            self._channel,
            self._count_up,
            self._root,
            self._ros2,
            live=self._live,
        )

    def _write_frames(self, batch: Batch, log: I64, publish: I64) -> None:
        frames = batch.frames
        if not self._queue.wants("frames"):
            return
        self._queue.add(
            "frames",
            *self._frames.encode(
                self._heads(self._channel("frames", Frame), log, publish),
                {
                    "t_start_ns": frames.t_start,
                    "t_end_ns": frames.t_end,
                    "offset": batch.base + frames.start,
                    "length": frames.length,
                    "kind": frames.kind,
                    "op_code": frames.op,
                    "flags": frames.flags,
                    "direction": frames.direction,
                },
                {
                    "uncertainty_ns": (frames.uncertainty, frames.uncertainty >= 0),
                    "servo_id": (frames.servo_id, frames.servo_id >= 0),
                    "address": (frames.address, frames.address >= 0),
                    "status": (frames.status, frames.status >= 0),
                },
                ("op", frames.op),
                Blob("data", batch.data, frames.start, frames.length),
            ),
        )

    def _write_transactions(self, batch: Batch, log: I64) -> None:
        frames, t = batch.frames, batch.transactions
        if not len(t) or not self._queue.wants("transactions"):
            return
        asked, answered = t.request != -1, t.response >= 0
        request = batch.asked(np.where(asked, t.request, t.response))
        last = np.maximum(batch.rows_of(t.request), t.response)
        start = batch.base + frames.start
        self._queue.add(
            "transactions",
            *self._transactions.encode(
                self._heads(
                    self._channel("transactions", Transaction), log[last], frames.t_end[last]
                ),
                {"outcome": t.outcome},
                {
                    "request_offset": (batch.base + request.start, asked),
                    "response_offset": (start[t.response], answered),
                    "servo_id": (request.servo_id, request.servo_id >= 0),
                    "response_time_ns": (t.response_time_ns, t.response_time_ns >= 0),
                    "uncertainty_ns": (t.uncertainty_ns, t.uncertainty_ns >= 0),
                    "response_time_ms": (t.response_time_ns / 1e6, t.response_time_ns >= 0),
                },
                ("op", request.op),
            ),
        )

    def _write_gaps(self, batch: Batch) -> None:
        gaps = Gaps.of(batch.gaps)
        start, length, times = gaps.start, gaps.length, gaps.t_ns
        self._seconds.count(GAPS, times, length)
        if len(gaps) and self._queue.wants("gaps"):
            log = self._arrivals.of(batch.base + start + length, times)
            self._rare("gaps", Gap, gap_messages(batch), log, times)

    def _write_anomalies(self, batch: Batch) -> None:
        found = Anomalies.of(batch.anomalies)
        found = found.take(np.argsort(found.t_ns, kind="stable"))
        times = found.t_ns
        self._seconds.count(ANOMALIES, times)
        self._rare("anomalies", Anomaly, anomaly_messages(found), times, times)
        if self._ros2 is not None:
            self._ros2.anomalies(self._root, found, times)
        self._rare("log", Log, log_messages(found, self.name, self._names), times, times)

    def _write_stats(self, *, final: bool) -> None:
        rows = self._seconds.over(final=final)
        if self._clock != Clock.NONE and self._baud:
            for row in rows:
                row.bus_load_percent = 100 * row.bytes * byte_time_ns(self._baud) / NS
        times = np.array([r.t_ns for r in rows], np.int64)
        times = np.maximum(np.minimum(times + NS, self.newest), times)
        self._rare("stats", Stats, (row.SerializeToString() for row in rows), times, times)

    def _rare(
        self, topic: str, kind: type[Message], messages: Iterable[bytes], log: I64, publish: I64
    ) -> None:
        """Queue messages that are built one by one, one for each time."""
        if not len(log) or not self._queue.wants(topic):
            return
        heads = self._heads(self._channel(topic, kind), log, publish)
        self._queue.add(topic, Loose.holding(messages, heads))

    def _channel(self, topic: str, message: type[Message] | MessageType, **facts: str) -> int:
        """Return the channel of a topic, opened with its first message."""
        channel = self._channels.get(topic)
        if channel is None:
            metadata = {"bus": self.name, **facts}
            if self.protocol is not None:
                metadata["protocol"] = self.protocol.name
            full = f"/{self._root.strip('/')}/{topic}"
            channel = self._channels[topic] = self._open(full, message, metadata)
        return channel

    def _heads(self, channel: int, log: I64, publish: I64) -> Heads:
        """Return heads whose times never decrease within the channel, as viewers want them."""
        n = len(log)
        ids: U16 = np.full(n, channel, np.uint16)
        before = self._times.get(channel, (0, 0))
        log = np.maximum.accumulate(np.maximum(log, before[0]))
        publish = np.maximum.accumulate(np.maximum(publish, before[1]))
        self._times[channel] = (int(log[-1]), int(publish[-1]))
        return Heads(ids, self._count_up(channel, n), log, publish, self._queue.ranks(n))

    def _count_up(self, channel: int, n: int) -> npt.NDArray[np.uint32]:
        """Return the next sequence numbers of a channel; they wrap."""
        if self._live:
            return np.zeros(n, np.uint32)
        first = self._sequences.get(channel, 0)
        self._sequences[channel] = first + n
        return np.arange(first, first + n).astype(np.uint32)
