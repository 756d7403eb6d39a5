"""Chunks as message records: the bytes as they came, all buses in one go.

In a live recording a few chunks of each bus are written every 50 ms; most of what that costs does
not depend on how many there are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.mcapfile.encoder import Encoder
from sniffer.mcapfile.orders import RAW_ORDER
from sniffer.mcapfile.rows import Blob, Heads, Loose, MessageRows
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
