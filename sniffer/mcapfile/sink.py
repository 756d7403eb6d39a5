"""Recordings as MCAP: every byte as it came, and all that was made of it.

Topics of each bus: ``raw`` (all bytes; a recording can be decoded again, better), ``frames``,
``transactions``, ``servo/<id>/state``, ``gaps``, ``anomalies``, ``log`` (foxglove.Log), ``stats``.
The messages are declared in ``schemas/messages``; the register tables are attached.

``log_time`` is when the bytes arrived; ``publish_time`` is when they were on the wire, by the best
estimate. Both never decrease within a topic, and count from the first byte where there is no clock.

There are two ways to use it. A live recorder calls ``flush`` often: the raw bytes are in the file
then, so a killed recorder loses no more than what came since. What was decoded of them follows
after ``flush_ns``: encoding a little costs nearly as much as encoding a lot, and much of one kind
side by side packs best. Its records stand behind raw bytes that came later, with their own log
times. The message index behind chunks of ``BULK`` names next to nothing, for it would be larger
than they are, and of states it names some, see ``states``.

Otherwise everything is written when the next call comes half of ``flush_ns`` after it was handed
over, and ``log_time`` never decreases within the whole file. Input whose clock runs far ahead of
the wall clock is a conversion: there the records of all buses are put in order first, as far as
all of them are decoded.
"""

from __future__ import annotations

import contextlib
import json
import time
from typing import TYPE_CHECKING, Final

import numpy as np
from mcap.records import Attachment

from sniffer import __version__
from sniffer.decoding.called import ServoNames, names_in
from sniffer.ground.limits import BAUDS, number_in
from sniffer.ground.model import NS, OutputError
from sniffer.ground.registers import schema_path
from sniffer.ground.wording import Sentence
from sniffer.mcapfile.container import Container
from sniffer.mcapfile.facts import attached_tables, facts_of
from sniffer.mcapfile.incidents import message_of
from sniffer.mcapfile.joints import FACT
from sniffer.mcapfile.layout import ATTACHED, layout
from sniffer.mcapfile.messages import BusWriter
from sniffer.mcapfile.queue import Queue, Sorted
from sniffer.mcapfile.raw import RawEncoder
from sniffer.mcapfile.rows import Heads, Loose
from sniffer.mcapfile.states import kind_of
from sniffer.mcapfile.turns import Turns
from sniffer.messages import (
    BUS,
    CHOICES,
    END,
    FLAT,
    INCIDENTS,
    OFFSET,
    SESSION,
    SHOWN,
    TOOL,
)

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence
    from pathlib import Path

    from sniffer.decoding.rates import Rate
    from sniffer.decoding.sink import Part
    from sniffer.diagnosis.tracking import IncidentChange
    from sniffer.ground.model import Batch, Chunk
    from sniffer.mcapfile.joints import RosJoint
    from sniffer.mcapfile.ros2 import JointPlaces, RosWriter
    from sniffer.protocols.base import BusProtocol

LIBRARY: Final = f"{TOOL} {__version__}"
"""What the header names as the file's maker."""

ROUND_NS: Final = 5 * NS
"""The longest time over which the input's clock is compared with the wall clock."""

MANY: Final = 1 << 16
"""Bytes of the buses from which on they are encoded: few at a time cost too much."""

FULL: Final = 4 << 20
"""Records of a conversion are put in order and written from so many bytes on."""

OVERFULL: Final = 64 << 20
"""Records waiting, in bytes, from which on no bus is waited for."""


class McapSink:
    """Writes a recording.

    Args:
        path: of the file.
        session: facts of the recording; ``baud.<bus>`` or ``baud`` is the rate for the statistics.
        flush_ns: what is handed over is in the file so much later, in ns.
        overwrite: whether a file that is there may be replaced.
        live: whether the caller flushes often, and nothing is written between.
        durable: whether the disk is waited for with each flush, against a power failure.
        topics: which of ``CHOICES`` are written, None for ``TOPICS``; ``raw`` always is.
        starts: stream offset of the first byte by bus, where that is not 0.
        joints: what ROS 2 understands is written, too; for these joints, or, where empty, for all
            servos whose position has a physical unit. Files of one recording share what is known
            of their joints.
        published: the publish time, in ns, that the frames of each bus have reached; kept up to
            date here. Files of one recording share it: the next one does not go back.

    Raises:
        OutputError: the file cannot be written; what it holds so far stays readable.
    """

    def __init__(
        self,
        path: Path,
        session: Mapping[str, str],
        *,
        flush_ns: int = 100_000_000,
        overwrite: bool = True,
        live: bool = False,
        durable: bool = False,
        topics: Collection[str] | None = None,
        starts: Mapping[str, int] | None = None,
        joints: Sequence[RosJoint] | JointPlaces | None = None,
        published: dict[str, int] | None = None,
    ) -> None:
        begin = {f"{OFFSET}.{bus}": str(at) for bus, at in (starts or {}).items()}
        if topics is not None:
            begin["topics"] = ",".join(t for t in CHOICES if t == "raw" or t in topics)
        self._session = {_told(k): _told(v) for k, v in {**session, **begin}.items()}
        self._names = ServoNames(names_in(self._session))
        self._flush_ns = flush_ns
        self._live = live
        self._starts = dict(starts or {})
        self._queue = Queue(topics if topics is None else {"raw", *topics})
        self._raw = RawEncoder()
        self._published = {} if published is None else published
        self._buses: dict[str, BusWriter] = {}
        self._attached: set[str] = set()
        self._failure: str | None = None
        self._file = Container(path, LIBRARY, overwrite=overwrite, durable=durable, beside=not live)
        self._session.pop(FACT, None)  # that of a recording that this one is made of
        self._ros2: RosWriter | None = None
        if joints is not None:
            from sniffer.mcapfile.ros2 import JointPlaces, RosWriter

            places = JointPlaces.of(joints, self._session)
            self._session |= places.facts()
            self._ros2 = RosWriter(places, self._queue, self._file.channel)
        self._turns = Turns(self._queue, self._file, self._ros2, flush_ns)
        self._closed = False
        self._since: int | None = None
        self._round_at = self._round_from = self._told_ns = 0
        with self._guard():
            self._file.metadata(SESSION, self._session)
            for proto in sorted(schema_path("messages").glob("*.proto")):
                self._attach(f"messages/{proto.name}", "text/plain", proto.read_bytes())
            self._file.sync()

    @property
    def size(self) -> int:
        """Bytes in the file."""
        return self._file.size

    @property
    def is_deleted(self) -> bool:
        """Tell whether somebody has deleted the file while it is written."""
        return self._file.is_deleted

    @property
    def remarks(self) -> list[str]:
        """What should be told of the joints in it."""
        return [] if self._ros2 is None else self._ros2.places.told()

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take chunks as they came."""
        with self._guard():
            again = bus == next(iter(self._buses), None)
            self._settle(again=again)
            now = time.monotonic_ns()
            if again or not self._buses or now - self._round_at > ROUND_NS:
                self._round_at, self._round_from = now, self._newest()
            self._bus(bus).raw(chunks)
            self._wait()

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Take what a pass decided."""
        self.write_together(bus, [(protocol, batch)])

    def write_together(self, bus: str, parts: Sequence[Part]) -> None:
        """Take what several protocols said in one pass; each has topics of its own."""
        with self._guard():
            writer = self._bus(bus)
            if not writer.is_known:
                self._introduce(bus, [protocol for protocol, _ in parts])
            for protocol, batch in parts:
                writer.write(protocol, batch)
            self._wait()
            self._settle(again=False)

    def flush(self) -> None:
        """Write what waits; of a live recording all raw bytes, and what was decoded when due."""
        with self._guard():
            if self._live:
                self._flush_live()
            else:
                self._encode()
                self._flush(None)
                self._file.settle()

    def close(self) -> None:
        """Finish the file; after a failure it is left as it is."""
        for _ in self.closing({}):
            pass

    def closing(self, end: Mapping[str, str]) -> Iterator[None]:
        """Do that in steps of some ms; in the first one all but the file's index is written.

        ``end`` tells where another file goes on: the facts of the end mark, none where none does.
        """
        if self._closed:
            return
        if self._failure is None:
            with self._guard():
                if self._live:
                    self._flush_live(final=True)
                else:
                    self._encode(final=True)
                    self._flush(None)
                self._attach_layout()
                if end:
                    self._file.metadata(END, {_told(k): v for k, v in end.items()})
                yield from self._file.finishing()
        self._closed = True

    def tuned(self, bus: str, rate: Rate) -> None:
        """Take the rate that was found for a bus: it stands in the file from now on."""
        with self._guard():
            told = rate.facts()
            self._session.update((f"{key}.{bus}", value) for key, value in told.items())
            self._bus(bus).tune(rate.baud)
            self._file.metadata(f"{BUS}.{bus}", {"bus": bus, **told})

    def incidents(self, changes: Sequence[IncidentChange]) -> None:
        """Take what has become of incidents; it is written with what was decoded."""
        with self._guard():
            if not changes or not self._queue.wants(INCIDENTS):
                return
            messages = [message_of(change, self._names) for change in changes]
            channel = self._file.channel(f"/{INCIDENTS}", type(messages[0]), {})
            n = len(messages)
            times = np.array([change.t_ns for change in changes], np.int64)
            times = np.maximum.accumulate(np.maximum(times, self._told_ns))
            self._told_ns = int(times[-1])
            ids, sequence = np.full(n, channel, np.uint16), np.zeros(n, np.uint32)
            heads = Heads(ids, sequence, times, times, self._queue.ranks(n))
            self._queue.add(INCIDENTS, Loose.of(messages, heads))

    def note(self, name: str, facts: Mapping[str, str]) -> None:
        """Write facts that are known only now, as a metadata record of that name."""
        with self._guard():
            self._file.metadata(name, {_told(k): _told(v) for k, v in facts.items()})

    def abandon(self) -> None:
        """Let go of the file as it is: nobody will read it to its end."""
        self._closed = True
        self._file.abandon()

    @contextlib.contextmanager
    def _guard(self) -> Iterator[None]:
        """After a failure end the file as well as it can be, and refuse everything else."""
        if self._failure is not None or self._closed:
            raise OutputError(self._failure or f"{self._file.path} is closed")
        try:
            yield
        except OutputError as error:
            self._failure = Sentence("{why}; what was recorded before is kept", why=error)
            with contextlib.suppress(OutputError):
                self._file.finish()
            raise OutputError(self._failure) from None
        except BaseException:
            # what was half done may be in the file and not in its index: it gets none
            self._failure = f"{self._file.path}: interrupted; what was recorded before is kept"
            self._file.abandon()
            raise

    def _bus(self, name: str) -> BusWriter:
        writer = self._buses.get(name)
        if writer is None:
            baud = self._session.get(f"baud.{name}", self._session.get("baud", ""))
            writer = self._buses[name] = BusWriter(
                name,
                number_in(baud, *BAUDS),
                self._starts.get(name, 0),
                self._queue,
                self._file.channel,
                live=self._live,
                ros2=self._ros2,
                published=self._published,
                names=self._names,
            )
        return writer

    def _introduce(self, bus: str, protocols: Sequence[BusProtocol]) -> None:
        """Tell what a bus speaks, and attach the tables it is read by."""
        self._file.metadata(f"{BUS}.{bus}", facts_of(bus, protocols, self._session))
        for name, data in attached_tables(protocols):
            self._attach(name, "application/toml", data)

    def _attach(self, name: str, media_type: str, data: bytes) -> None:
        if name not in self._attached:
            self._attached.add(name)
            self._file.attach(Attachment(0, self._file.last, name, media_type, data))

    def _attach_layout(self) -> None:
        """Attach the panels that viewers have something to show in."""
        shown = SHOWN if self._live else CHOICES  # what is not indexed is not looked up
        topics = [t for t in self._file.topics().values() if kind_of(t) in (*shown, FLAT)]
        fields = {t: names for b in self._buses.values() for t, names in b.fields().items()}
        made = layout(topics, fields, names_in(self._session))
        if made is not None:
            data = json.dumps(made, separators=(",", ":")).encode()
            self._attach(ATTACHED, "application/json", data)

    def _wait(self) -> None:
        if self._since is None:
            self._since = time.monotonic_ns()

    def _settle(self, *, again: bool) -> None:
        """Write what has waited long enough; ``again``: a new round of the buses begins."""
        self._file.settle(wait=False)
        if self._since is None or self._live:
            return
        now = time.monotonic_ns()
        due = now - self._since >= self._flush_ns // 2
        if not due and sum(b.held for b in self._buses.values()) < MANY:
            return
        self._encode()
        ran = self._newest() - (self._round_from or self._oldest())
        live = ran < 4 * (now - self._round_at) + NS // 5
        if (due and live) or self._queue.size >= OVERFULL:
            self._flush(None)
        elif again and not live and self._queue.size >= FULL:
            self._flush(min(b.decoded for b in self._buses.values()))

    def _encode_raw(self) -> None:
        parts = (bus.heard() for bus in self._buses.values())
        self._queue.add("raw", *self._raw.encode([part for part in parts if part is not None]))

    def _encode(self, *, final: bool = False) -> None:
        self._encode_raw()
        for bus in self._buses.values():
            bus.encode(final=final)

    def _oldest(self) -> int:
        return min((b.oldest for b in self._buses.values() if b.oldest is not None), default=0)

    def _newest(self) -> int:
        return max((b.newest for b in self._buses.values()), default=0)

    def _flush_live(self, *, final: bool = False) -> None:
        """Write the raw bytes, in order of time; when it is due, the rest in turns."""
        rows = [row for bus in self._buses.values() for row in bus.spoken()]
        self._write_all(Sorted.of(rows) if rows else None, indexed=False)
        self._turns.take(list(self._buses.values()), final=final)
        self._file.sync()

    def _flush(self, until: int | None) -> None:
        rows = self._queue.take(until)
        if rows is not None:
            self._file.write_unsorted(rows)
        self._file.sync()
        self._since = time.monotonic_ns() if self._queue.size else None

    def _write_all(self, rows: Sorted | None, *, indexed: bool) -> None:
        for piece in () if rows is None else rows.pieces():
            self._file.write(piece, indexed=indexed)


def _told(text: str) -> str:
    """Return a text as UTF-8 has it: a file's name may be any bytes."""
    return text.encode("utf-8", "backslashreplace").decode()
