"""The records of a recording the plain way: one protobuf message and one writer call each."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import register_schema

from sniffer.decoding.decoder import Decoder
from sniffer.ground.model import Chunk
from sniffer.mcapfile.fields import state_field
from sniffer.messages.recording_pb2 import Frame, RawChunk, Transaction
from sniffer.messages.servo_state_pb2 import ServoState

if TYPE_CHECKING:
    from pathlib import Path

    from sniffer.ground.model import Batch

BLOCK = 1 << 18


class _Topics:
    def __init__(self, writer: Writer) -> None:
        self.writer = writer
        self._schemas: dict[type, int] = {}
        self._channels: dict[str, int] = {}

    def write(
        self, topic: str, message: Frame | RawChunk | Transaction | ServoState, t: int
    ) -> None:
        kind = type(message)
        if topic not in self._channels:
            if kind not in self._schemas:
                self._schemas[kind] = register_schema(self.writer, kind)
            self._channels[topic] = self.writer.register_channel(
                topic, "protobuf", self._schemas[kind]
            )
        data = message.SerializeToString()
        self.writer.add_message(self._channels[topic], t, data, t)


def one_by_one(data: bytes, path: Path) -> int:
    """Decode a mightyZAP stream into an MCAP; return the bytes decoded."""
    decoder = Decoder("mightyzap")
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile="", library="bench")
        topics = _Topics(writer)
        for a in range(0, len(data), BLOCK):
            part = data[a : a + BLOCK]
            topics.write("/bus0/raw", RawChunk(offset=a, data=part), a)
            _write(topics, decoder, decoder.feed(Chunk(part)))
        _write(topics, decoder, decoder.close())
        writer.finish()  # type: ignore[no-untyped-call]  # the library annotates its arguments only
    return len(data)


def _write(topics: _Topics, decoder: Decoder, batch: Batch) -> None:
    f, t, v = batch.frames, batch.transactions, batch.samples
    protocol = decoder.protocol
    starts = (f.start + batch.base).tolist()
    for i, start in enumerate(starts):
        message = Frame(
            t_start_ns=int(f.t_start[i]),
            t_end_ns=int(f.t_end[i]),
            offset=start,
            length=int(f.length[i]),
            kind=int(f.kind[i]),  # type: ignore[arg-type]  # numbers are what the wire has
            servo_id=int(f.servo_id[i]),
            op=protocol.op_name(int(f.op[i])),
            op_code=int(f.op[i]),
            flags=int(f.flags[i]),
            data=batch.data[int(f.start[i]) : int(f.start[i] + f.length[i])],
        )
        if f.address[i] >= 0:
            message.address = int(f.address[i])
        if f.status[i] >= 0:
            message.status = int(f.status[i])
        topics.write("/bus0/frames", message, int(f.t_end[i]))
    for i in range(len(t)):
        q, r = int(t.request[i]), int(t.response[i])
        row = q if q >= 0 else r
        exchange = Transaction(
            outcome=int(t.outcome[i]),  # type: ignore[arg-type]  # numbers are what the wire has
            servo_id=int(f.servo_id[row]),
            op=protocol.op_name(int(f.op[row])),
        )
        if q >= 0:
            exchange.request_offset = starts[q]
        if r >= 0:
            exchange.response_offset = starts[r]
        topics.write("/bus0/transactions", exchange, int(f.t_end[max(q, r)]))
    states: dict[tuple[int, int], ServoState] = {}
    for i in range(len(v)):
        name = state_field(protocol.registers[int(v.register[i])])
        if name is None or math.isnan(v.value[i]):
            continue
        row, servo = int(v.row[i]), int(v.servo_id[i])
        if (row, servo) not in states:
            states[row, servo] = ServoState(offset=starts[row])
        setattr(states[row, servo], name, float(v.value[i]))
    for (row, servo), state in states.items():
        topics.write(f"/bus0/servo/{servo}/state", state, int(f.t_end[row]))
