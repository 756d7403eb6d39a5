"""What a killed recorder had no time to derive from its last bytes, derived when it is mended.

Raw bytes are on the disk within 50 ms, what is made of them some seconds later. Decoded again, a
recording says the same (a law of the decoder), so the records that are there already can be told
from those that are missing by where they stand in the stream.
"""

from __future__ import annotations

import contextlib
from collections import deque
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from google.protobuf.message import DecodeError
from mcap.records import Attachment

from sniffer.decoding.called import ServoNames, names_in
from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.ground.limits import BAUDS, OFFSET_END, number_in
from sniffer.ground.model import DamagedInputError, OutputError, SnifferError
from sniffer.mcapfile.facts import attached_tables, facts_of
from sniffer.mcapfile.joints import joints_in
from sniffer.mcapfile.messages import DERIVED, BusWriter
from sniffer.mcapfile.queue import Queue
from sniffer.mcapfile.ros2 import ANOMALIES, JOINTS, JointPlaces, RosWriter
from sniffer.mcapfile.source import groups, session
from sniffer.mcapfile.states import kind_of
from sniffer.mcapfile.structs import MESSAGE
from sniffer.messages import BULK, BUS, FLAT, OFFSET, PLOTS, SHOWN, TOPICS
from sniffer.messages.recording_pb2 import Frame, Gap, Stats, Transaction
from sniffer.messages.servo_state_pb2 import Quantity, ServoState

if TYPE_CHECKING:
    from collections.abc import Hashable, Sequence
    from pathlib import Path

    from sniffer.decoding.sink import Part
    from sniffer.ground.model import Batch, Chunk, Mask
    from sniffer.mcapfile.container import Container
    from sniffer.mcapfile.queue import Sorted
    from sniffer.mcapfile.records import Piece
    from sniffer.protocols.base import BusProtocol

ROS: Final = frozenset((JOINTS, ANOMALIES))
"""Topics of ROS 2, which are of all buses."""

HELD: Final = 64 << 20
"""Records that are looked at to see what is there, in bytes: seconds of the busiest recording."""

FULL: Final = 16 << 20
"""Records are written from so many bytes on."""


class Tail:
    """Looks at the chunks of a recording as they pass, and writes what is missing behind them.

    Args:
        file: the new file.
    """

    def __init__(self, file: Container) -> None:
        self._file = file
        self._pieces: deque[tuple[Piece, Mask]] = deque()
        self._held = 0
        self._passed: dict[int, tuple[int, int]] = {}
        """Of each channel, offset and log time of the last message that is not held any more."""

    def look(self, piece: Piece) -> None:
        """Take note of a chunk, which is in the file."""
        topics = self._file.topics()
        derived = [c for c, topic in topics.items() if _derived(topic)]
        mine = np.isin(piece.channel, derived)
        if not mine.any():
            return
        self._pieces.append((piece, mine))
        self._held += len(piece.data)
        while self._held > HELD:
            old, which = self._pieces.popleft()
            self._held -= len(old.data)
            for channel in np.unique(old.channel[which]).tolist():
                row = np.flatnonzero(old.channel == channel)[-1:]
                offset = _place(self._read(channel, old.messages(old.at[row])[0]))
                self._passed[channel] = (offset, int(old.log[row[0]]))

    def derive(self, path: Path) -> int:
        """Write the records that the raw bytes of ``path`` have and the file has not.

        Returns how many that are.
        """
        facts = session(path)
        rest = _Rest(self._file, facts, self._known(), self._passed)
        pipeline = Pipeline(Options().with_facts(facts), [rest], starts=rest.starts, live=True)
        try:
            with contextlib.suppress(DamagedInputError):
                for group in groups(path):
                    pipeline.feed(group)
            pipeline.close()
        except OutputError:
            raise
        except SnifferError:
            pass  # nobody knows what is spoken, or it says nonsense of itself: its bytes are kept
        pipeline.finish()
        return rest.written

    def _known(self) -> dict[int, set[Hashable]]:
        """Return by channel the records that are held."""
        known: dict[int, set[Hashable]] = {}
        for piece, mine in self._pieces:
            at = piece.at[mine]
            columns = (piece.channel[mine].tolist(), at.tolist(), piece.messages(at))
            for channel, start, data in zip(*columns, strict=True):
                key = _key(self._read(channel, data), piece.data, start)
                known.setdefault(channel, set()).add(key)
        self._pieces.clear()
        return known

    def _read(self, channel: int, data: bytes) -> Any:
        kind = kind_of(self._file.topics()[channel])
        try:
            return _message(kind, data)
        except DecodeError:
            return DERIVED[kind]()


class _Rest:
    """A sink that writes what is not known yet."""

    def __init__(
        self,
        file: Container,
        facts: dict[str, str],
        known: dict[int, set[Hashable]],
        passed: dict[int, tuple[int, int]],
    ) -> None:
        self.written = 0
        told = {key.partition("."): value for key, value in facts.items()}
        begin = {bus: number_in(v, 0, OFFSET_END) for (k, _, bus), v in told.items() if k == OFFSET}
        self.starts = {bus: at for bus, at in begin.items() if at is not None}
        self._file = file
        self._facts = facts
        self._known = known
        self._passed = passed
        wanted = facts.get("topics", ",".join(TOPICS)).split(",")
        self._queue = Queue([topic for topic in wanted if topic != "raw"])
        self._buses: dict[str, BusWriter] = {}
        self._names = ServoNames(names_in(facts))
        self._ros2: RosWriter | None = None
        if (joints := joints_in(facts)) is not None:
            places = JointPlaces.of(joints, facts)
            self._ros2 = RosWriter(places, self._queue, file.channel)

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Learn when bytes came: they are in the file."""
        writer = self._bus(bus)
        writer.raw(chunks)
        writer.heard()

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Write what of a batch is missing."""
        self.write_together(bus, [(protocol, batch)])

    def write_together(self, bus: str, parts: Sequence[Part]) -> None:
        """Write what is missing of what several protocols said in one pass."""
        writer, batch = self._bus(bus), parts[0][1]
        if batch.base + len(batch.data) <= self._done(bus):
            return
        if not writer.is_known and f"protocol.{bus}" not in self._facts:
            self._introduce(bus, [protocol for protocol, _ in parts])
        for protocol, said in parts:
            writer.write(protocol, said)
        if sum(b.held for b in self._buses.values()) > FULL // len(TOPICS):
            self._flush(final=False)

    def close(self) -> None:
        """Write the rest."""
        self._flush(final=True)

    def _bus(self, name: str) -> BusWriter:
        if name not in self._buses:
            baud = self._facts.get(f"baud.{name}", self._facts.get("baud", ""))
            self._buses[name] = BusWriter(
                name,
                number_in(baud, *BAUDS),
                self.starts.get(name, 0),
                self._queue,
                self._file.channel,
                live=True,
                ros2=self._ros2,
                names=self._names,
            )
        return self._buses[name]

    def _done(self, bus: str) -> int:
        """Return up to which byte all is known to be there."""
        topics = self._file.topics()
        return max((at for c, (at, _) in self._passed.items() if _of(topics[c], bus)), default=-1)

    def _introduce(self, bus: str, protocols: Sequence[BusProtocol]) -> None:
        self._file.metadata(f"{BUS}.{bus}", facts_of(bus, protocols, self._facts))
        for name, data in attached_tables(protocols):
            self._file.attach(Attachment(0, self._file.last, name, "application/toml", data))

    def _flush(self, *, final: bool) -> None:
        for bus in self._buses.values():
            bus.encode(final=final)
        for topics, indexed in ((BULK, False), ((*SHOWN, FLAT, PLOTS), True)):
            self._write(self._queue.lots(topics), indexed=indexed)
        if self._ros2 is not None:
            self._write(self._ros2.take(), indexed=True)

    def _write(self, rows: Sorted | None, *, indexed: bool) -> None:
        """Write what is missing of records."""
        rows = None if rows is None else rows.only(self._missing(rows))
        if rows is not None:
            self.written += len(rows.log)
            for piece in rows.pieces():
                self._file.write(piece, indexed=indexed)

    def _missing(self, rows: Sorted) -> Mask:
        topics = self._file.topics()
        kinds = {c: kind_of(topic) for c, topic in topics.items() if _derived(topic)}
        done = {c: self._passed.get(c, (-1, -1)) for c in kinds}
        out = np.ones(len(rows.log), bool)
        columns = (c.tolist() for c in (rows.channel, rows.log, rows.start, rows.end))
        for i, (channel, log, start, end) in enumerate(zip(*columns, strict=True)):
            message = _message(kinds[channel], rows.data[start + MESSAGE.size : end])
            offset, until = done[channel]
            is_there = _key(message, rows.data, start) in self._known.get(channel, ())
            place = _place(message)
            out[i] = not is_there and (place > offset if place >= 0 else log > until)
        return out


def _derived(topic: str) -> bool:
    kind = kind_of(topic)
    return kind in DERIVED or kind == PLOTS or topic in ROS


def _message(kind: str, data: bytes | memoryview) -> Any:
    """Return what a message says; one of ROS 2 says its bytes."""
    return DERIVED[kind].FromString(data) if kind in DERIVED else bytes(data)


def _of(topic: str, bus: str) -> bool:
    return topic.startswith(f"/{bus.strip('/')}/")


def _place(message: Any) -> int:
    """Return where in the stream a record stands, -1 for those that have but a time."""
    match message:
        case Frame(offset=offset) | Gap(offset=offset) | ServoState(offset=offset):
            return int(offset)
        case Transaction():
            return max(
                message.request_offset if message.HasField("request_offset") else -1,
                message.response_offset if message.HasField("response_offset") else -1,
            )
    return -1


def _key(message: Any, records: bytes | memoryview, start: int) -> Hashable:
    """Return what tells a record of a channel, which begins at ``start``, from all others."""
    match message:
        case Frame(offset=offset) | Gap(offset=offset) | ServoState(offset=offset):
            return int(offset)
        case Transaction(request_offset=request, response_offset=response):
            return (request, response, message.HasField("request_offset"))
        case Stats(t_ns=t_ns):
            return int(t_ns)
        case Quantity(value=value):
            *_, publish = MESSAGE.unpack_from(records, start)
            return (publish, value)
        case bytes():
            *_, publish = MESSAGE.unpack_from(records, start)
            return (publish, message)
    return bytes(message.SerializeToString(deterministic=True))
