"""Recordings for tests: simulated buses with faults, written by the sink, read back one by one."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader

from sniffer.decoding.decoder import Decoder
from sniffer.ground.model import Batch, Chunk, Clock, DamagedInputError, InputError, SnifferError
from sniffer.mcapfile.sink import McapSink
from sniffer.mcapfile.source import chunks
from sniffer.messages import log_pb2, recording_pb2, servo_state_pb2
from sniffer.protocols import PROTOCOLS
from sniffer.simulation.buses import simulate
from sniffer.simulation.faults import LINE_FAULTS, Fault
from sniffer.simulation.render import usb_reads

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

START_NS = 1_795_215_306_000_000_000
MESSAGES: dict[str, Any] = {
    kind.DESCRIPTOR.full_name: kind
    for kind in (
        recording_pb2.RawChunk,
        recording_pb2.Frame,
        recording_pb2.Transaction,
        recording_pb2.Gap,
        recording_pb2.Anomaly,
        recording_pb2.Incident,
        recording_pb2.Stats,
        servo_state_pb2.ServoState,
        servo_state_pb2.Quantity,
        log_pb2.Log,
    )
}


def talk(
    protocol: str, seconds: float = 1.0, seed: int = 1, rate: float = 0.02, bus: str = "bus0"
) -> list[Chunk]:
    """Return what a USB adapter delivers from a bus with every kind of fault."""
    faults = [Fault(kind, rate) for kind in LINE_FAULTS]
    frames = simulate(protocol, seed=seed, faults=faults, start_ns=START_NS, duration_s=seconds)
    reads = usb_reads(frames, PROTOCOLS[protocol].baud)
    return [Chunk(data, t, Clock.READ, bus) for t, data in reads]


def decode(protocol: str, chunks: Sequence[Chunk], size: int = 50) -> list[Batch]:
    """Decode chunks in groups; the last batch comes from closing."""
    decoder = Decoder(protocol)
    out = [decoder.feed(*chunks[i : i + size]) for i in range(0, len(chunks), size)]
    return [*out, decoder.close()]


def record(
    path: Path, protocol: str, chunks: Sequence[Chunk], size: int = 50, **options: Any
) -> list[Batch]:
    """Write a recording of one bus; return what was decoded."""
    batches = decode(protocol, chunks, size)
    sink = McapSink(path, {"tool": "test"}, **options)
    bus = chunks[0].bus
    for i, batch in enumerate(batches):
        sink.raw(bus, chunks[i * size : (i + 1) * size])
        sink.write(bus, PROTOCOLS[protocol], batch)
    sink.close()
    return batches


def keep(path: Path, parts: Iterable[Sequence[Chunk]], **options: Any) -> None:
    """Write a recording of raw chunks only, each part in one call a bus."""
    sink = McapSink(path, {"tool": "test"}, **options)
    for part in parts:
        for bus in dict.fromkeys(c.bus for c in part):
            sink.raw(bus, [c for c in part if c.bus == bus])
    sink.close()


def messages(path: Path) -> dict[str, list[Any]]:
    """Return every topic's messages in the order of the file, parsed by the generated classes."""
    out: dict[str, list[Any]] = {}
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            assert schema is not None
            parsed = MESSAGES[schema.name].FromString(message.data)
            out.setdefault(channel.topic, []).append(parsed)
    return out


def heads(path: Path) -> list[Message]:
    """Return the messages unparsed, in the order of the file."""
    with path.open("rb") as stream:
        records = StreamReader(stream, validate_crcs=True).records
        return [record for record in records if isinstance(record, Message)]


def read(data: bytes) -> tuple[list[Chunk], SnifferError | None]:
    """Return what can be read, and what was raised then."""
    out: list[Chunk] = []
    try:
        for chunk in chunks(io.BytesIO(data)):
            out.append(chunk)  # noqa: PERF402 - what comes before the error is to be kept
    except (DamagedInputError, InputError) as error:
        return out, error
    return out, None
