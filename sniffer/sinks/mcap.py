"""Recordings as MCAP: every byte as it came, and all that was made of it.

Topics of each bus: ``raw`` (all bytes; a recording can be decoded again, better), ``frames``,
``transactions``, ``servo/<id>/state``, ``gaps``, ``anomalies``, ``log`` (foxglove.Log), ``stats``.
The messages are declared in ``schemas/messages``; the register tables are attached.

``log_time`` is when the bytes arrived and never decreases within the file; ``publish_time`` is when
they were on the wire, by the best estimate. Both count from the first byte where there is no clock.

What is handed over live is in the file within ``flush_ns``: it is written when the next call comes
half of that later (call at least that often, ``flush`` included), so a killed recorder loses no
more. Input whose clock runs far ahead of the wall clock is a conversion: there the records of all
buses are put in order first, as far as all of them are decoded.
"""

from __future__ import annotations

import contextlib
import time
from typing import TYPE_CHECKING, Final

from mcap.records import Attachment

from sniffer import __version__
from sniffer.messages import BUS, SESSION, TOOL
from sniffer.model import NS, OutputError
from sniffer.registers import schema_path
from sniffer.sinks.mcap_bulk import Container, Queue
from sniffer.sinks.mcap_messages import BusWriter

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from sniffer.model import Batch, Chunk
    from sniffer.protocols.base import BusProtocol

LIBRARY: Final = f"{TOOL} {__version__}"
"""Name of the metadata record with the facts of the recording."""

"""Name of the metadata records that tell a bus's protocol and rate."""

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
    ) -> None:
        self._session = dict(session)
        self._flush_ns = flush_ns
        self._queue = Queue()
        self._buses: dict[str, BusWriter] = {}
        self._attached: set[str] = set()
        self._failure: str | None = None
        self._file = Container(path, LIBRARY, overwrite=overwrite)
        self._closed = False
        self._since: int | None = None
        self._round_at = 0
        self._round_from = 0
        with self._guard():
            self._file.metadata(SESSION, self._session)
            for proto in sorted(schema_path("messages").glob("*.proto")):
                self._attach(f"messages/{proto.name}", "text/plain", proto.read_bytes())

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
        with self._guard():
            writer = self._bus(bus)
            if writer.protocol is None:
                self._introduce(bus, protocol)
            writer.write(protocol, batch)
            self._wait()
            self._settle(again=False)

    def flush(self) -> None:
        """Write everything that waits; for callers that are idle for long."""
        with self._guard():
            self._encode()
            self._flush(None)

    def close(self) -> None:
        """Finish the file; after a failure it is left as it is."""
        if self._closed:
            return
        if self._failure is None:
            with self._guard():
                self._encode(final=True)
                self._flush(None)
                self._file.finish()
        self._closed = True

    @contextlib.contextmanager
    def _guard(self) -> Iterator[None]:
        """After a failure end the file as well as it can be, and refuse everything else."""
        if self._failure is not None or self._closed:
            raise OutputError(self._failure or f"{self._file.path} is closed")
        try:
            yield
        except OutputError as error:
            self._failure = f"{error}; what was recorded before is kept"
            with contextlib.suppress(OutputError):
                self._file.finish()
            raise OutputError(self._failure) from None

    def _bus(self, name: str) -> BusWriter:
        writer = self._buses.get(name)
        if writer is None:
            baud = self._session.get(f"baud.{name}", self._session.get("baud", ""))
            number = int(baud) if baud.isdecimal() else None
            writer = self._buses[name] = BusWriter(name, number, self._queue, self._file.channel)
        return writer

    def _introduce(self, bus: str, protocol: BusProtocol) -> None:
        """Tell what a bus speaks, and attach the tables it is read by."""
        baud = self._session.get(f"baud.{bus}", self._session.get("baud", str(protocol.baud)))
        self._file.metadata(f"{BUS}.{bus}", {"bus": bus, "protocol": protocol.name, "baud": baud})
        for model in protocol.models:
            table = schema_path("registers", f"{model.model}.toml")
            if table.is_file():
                self._attach(f"registers/{table.name}", "application/toml", table.read_bytes())

    def _attach(self, name: str, media_type: str, data: bytes) -> None:
        if name not in self._attached:
            self._attached.add(name)
            self._file.attach(Attachment(0, self._file.last, name, media_type, data))

    def _wait(self) -> None:
        if self._since is None:
            self._since = time.monotonic_ns()

    def _settle(self, *, again: bool) -> None:
        """Write what has waited long enough; ``again``: a new round of the buses begins."""
        if self._since is None:
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

    def _encode(self, *, final: bool = False) -> None:
        for bus in self._buses.values():
            bus.encode(final=final)

    def _oldest(self) -> int:
        return min((b.oldest for b in self._buses.values() if b.oldest is not None), default=0)

    def _newest(self) -> int:
        return max((b.newest for b in self._buses.values()), default=0)

    def _flush(self, until: int | None) -> None:
        rows = self._queue.take(until, self._file.last)
        if rows is not None:
            for piece in rows.pieces():
                self._file.write(piece)
        self._since = time.monotonic_ns() if self._queue.size else None
