"""Chunks as message records: the bytes as they came, all buses in one go.

In a live recording a few chunks of each bus are written every 50 ms; most of what that costs does
not depend on how many there are.
"""

from __future__ import annotations

import functools
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from mcap.opcode import Opcode

from sniffer.mcapfile.encoder import Encoder
from sniffer.mcapfile.orders import RAW_ORDER
from sniffer.mcapfile.rows import Blob, Heads, Loose, MessageRows
from sniffer.mcapfile.structs import HEAD, MESSAGE
from sniffer.mcapfile.varints import narrow, varint
from sniffer.messages.recording_pb2 import Clock, Direction, Mark, RawChunk

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.model import I64, Chunk, Mask


FEW: Final = 4096
"""Chunks that are taken one by one as to their lengths: of fewer, many have one of their own."""


@dataclass(frozen=True, slots=True)
class HeldChunks:
    """Chunks of one bus: their heads, their times where they have any, where their bytes begin."""

    chunks: Sequence[Chunk]
    heads: Heads
    t: I64
    timed: Mask
    offset: I64
    length: I64


class RawEncoder:
    """Encodes the chunks of all buses."""

    def __init__(self) -> None:
        self._plain = Encoder(RawChunk, order=RAW_ORDER)

    def encode(self, parts: Sequence[HeldChunks]) -> list[MessageRows | Loose]:
        """Return a record for each chunk; the few with marks are built one by one."""
        if not parts:
            return []
        chunks = [c for part in parts for c in part.chunks]
        heads = Heads.concat([part.heads for part in parts])
        t, timed, offset, length = (
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("t", "timed", "offset", "length")
        )
        out: list[MessageRows | Loose] = []
        marked = [i for i, c in enumerate(chunks) if c.marks]
        if marked:
            rows = np.array(marked)
            messages = map(_message, [chunks[i] for i in marked], offset[rows].tolist())
            out.append(Loose.of(messages, heads.take(rows)))
            plain = np.delete(np.arange(len(chunks)), rows)
            chunks = [chunks[i] for i in plain.tolist()]
            heads, t, timed = heads.take(plain), t[plain], timed[plain]
            offset, length = offset[plain], length[plain]
        numbers: dict[str, Any] = {
            "clock": np.array([c.clock for c in chunks], np.int64),
            "direction": np.array([c.direction for c in chunks], np.int64),
            "offset": offset,
        }
        data = b"".join([c.data for c in chunks])
        blob = Blob("data", data, np.cumsum(length) - length, length)
        times = {"t_ns": (t, timed)}
        differ = len(chunks) < FEW
        return out + self._plain.encode(heads, numbers, times, blob=blob, lengths_differ=differ)


class SpokenChunks(NamedTuple):
    """Chunks of one bus as records of a live recording.

    ``rows`` are their log times, channels and records, ``arrived`` what ``Arrivals.note`` takes,
    ``times`` the latest log and publish times.
    """

    rows: list[tuple[int, int, bytes]]
    arrived: list[tuple[int, int, bool]]
    times: tuple[int, int]


def spoken(
    chunks: Sequence[Chunk], channel: int, offset: int, newest: int, times: tuple[int, int]
) -> SpokenChunks:
    """Return a record for each chunk, the same that ``RawEncoder`` makes.

    Twenty times a second a bus has some dozens of them, and the processor has forgotten the way
    meanwhile: a short one takes half of what columns take, which are faster where they are warm.
    """
    rows: list[tuple[int, int, bytes]] = []
    arrived: list[tuple[int, int, bool]] = []
    last_log, last_publish = times
    for c in chunks:
        data, t_ns = c.data, c.t_ns
        if t_ns is not None and t_ns > newest:
            newest = t_ns
        last_log = max(last_log, newest)
        last_publish = max(last_publish, newest if t_ns is None else t_ns)
        if c.marks:
            body = _message(c, offset).SerializeToString()
        else:
            begin, between = _around(c.clock, c.direction)
            when = b"" if t_ns is None else _T + _I64(t_ns)
            body = b"".join((begin, when, between, _U64(offset), _data_of(len(data)), data))
        size = MESSAGE.size - HEAD.size + len(body)
        head = MESSAGE.pack(Opcode.MESSAGE, size, channel, 0, last_log, last_publish)
        offset += len(data)
        rows.append((last_log, channel, head + body))
        arrived.append((offset, newest, t_ns is not None))
    return SpokenChunks(rows, arrived, (last_log, last_publish))


def _tag(name: str, wire: int) -> bytes:
    return varint(RawChunk.DESCRIPTOR.fields_by_name[name].number << 3 | wire)


_I64: Final = struct.Struct("<q").pack
_U64: Final = struct.Struct("<Q").pack
_T: Final = _tag("t_ns", 1)


@functools.lru_cache(maxsize=64)
def _around(clock: int, direction: int) -> tuple[bytes, bytes]:
    """Return what stands before the time, and between it and the offset."""
    two = narrow(np.array([clock, direction])).astype("<u2")
    between = _tag("direction", 0) + two[1:].tobytes() + _tag("offset", 1)
    return _tag("clock", 0) + two[:1].tobytes(), between


@functools.lru_cache(maxsize=1 << 12)
def _data_of(length: int) -> bytes:
    return _tag("data", 2) + varint(length)


def _message(chunk: Chunk, offset: int) -> RawChunk:
    return RawChunk(
        t_ns=chunk.t_ns,
        clock=Clock.Name(chunk.clock),
        direction=Direction.Name(chunk.direction),
        offset=offset,
        data=chunk.data,
        marks=[
            Mark(kind=Mark.Kind.Name(m.kind), start=m.start, length=m.length, count=m.count)
            for m in chunk.marks
        ],
    )
