"""Bytes of registers by servo and address, named or not, and the values that are known beside them.

What is read stands in answers, what is written in requests. Nothing is guessed here.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.decoding.narrowing import meant
from sniffer.decoding.sink import bus_of
from sniffer.ground.codes import OK, REQUEST, WHOLE
from sniffer.ground.distinct import distinct
from sniffer.ground.model import ECHO, MALFORMED, UNKNOWN
from sniffer.ground.register import TYPES
from sniffer.protocols.base import shared_ids
from sniffer.statistics.thinned import Thinned

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.model import I64, Batch, Chunk, Mask
    from sniffer.protocols.base import BusProtocol

SPANS: Final = 256
"""Spans of bytes that are followed on a bus, the first ones met: each takes up to 600 kB."""

WIDEST: Final = 64
"""Bytes of a span that are followed: whoever reads a whole table at once reads it in such parts."""

KINDS: Final = ("u8", "u16le", "i16le", "u16be", "i16be")
"""What a field may be: the extremes of all of them are kept, as nobody knows which one it is."""

KNOWN: Final = 512
"""Registers of servos whose values are kept to compare with, the first ones met."""


class ByteSpan(NamedTuple):
    """Bytes that are read or written in one go."""

    servo_id: int
    address: int
    length: int
    is_write: bool


@dataclass(slots=True)
class SpanBytes:
    """What was heard of one span: its bytes over time, thinned, and exact figures of all of them.

    ``series`` has times and rows of bytes. ``ends`` are the least and the most of each kind of
    number, by the byte that it begins with, ``falls`` whether it ever became less. By byte and
    value (0..255): ``seen`` is whether it was heard, ``deltas`` how often a byte changed by it from
    one time to the next (modulo 256), and ``flips`` how often just these bits of it flipped.
    """

    series: Thinned
    seen: Mask
    deltas: I64
    flips: I64
    ends: dict[str, tuple[I64, I64]] = field(default_factory=dict)
    falls: dict[str, Mask] = field(default_factory=dict)
    last: I64 | None = None

    @classmethod
    def of(cls, width: int) -> SpanBytes:
        """Return that of a span of which nothing was heard yet."""
        many = (width, 256)
        return cls(Thinned(), np.zeros(many, bool), np.zeros(many, int), np.zeros(many, int))

    def add(self, t_ns: I64, said: I64) -> None:
        """Take rows of bytes."""
        self.series.add(t_ns, said)
        if self.last is not None:
            said = np.concatenate([self.last[None, :], said])
        for kind in KINDS:
            if TYPES[kind].itemsize <= said.shape[1]:
                number = numbers(said, kind)
                low, high = number.min(axis=0), number.max(axis=0)
                least, most = self.ends.get(kind, (low, high))
                self.ends[kind] = np.minimum(least, low), np.maximum(most, high)
                falls = np.logical_or.reduce(np.diff(number, axis=0) < 0, axis=0)
                self.falls[kind] = self.falls.get(kind, falls) | falls
        wide = said.astype(np.int64)
        places = np.arange(said.shape[1])
        self.seen[places, wide] = True
        delta = np.diff(wide, axis=0) % 256
        at = np.broadcast_to(places, delta.shape)
        np.add.at(self.deltas, (at, delta), 1)
        np.add.at(self.flips, (at, wide[1:] ^ wide[:-1]), 1)
        self.last = said[-1].copy()


def numbers(said: I64, kind: str) -> I64:
    """Return the numbers of one kind that begin with each byte of a span, row by row."""
    pieces = np.lib.stride_tricks.sliding_window_view(said, TYPES[kind].itemsize, axis=1)
    whole: I64 = np.ascontiguousarray(pieces).view(TYPES[kind])[..., 0].astype(np.int64)
    return whole


@dataclass(slots=True)
class LaneBytes:
    """One protocol on one bus."""

    protocol: BusProtocol
    spans: dict[ByteSpan, SpanBytes] = field(default_factory=dict)
    values: dict[tuple[int, int], Thinned] = field(default_factory=dict)
    """By servo and register (a row of the protocol's): times and values."""
    models: dict[int, str] = field(default_factory=dict)
    has_addresses: bool = False

    def add(self, batch: Batch) -> None:
        """Take a batch."""
        self.models.update({servo: model for servo, (model, _) in batch.models.items()})
        f, t = batch.frames, batch.transactions
        self.has_addresses |= bool((f.address >= 0).any())
        sound = f.flags & (MALFORMED | UNKNOWN | ECHO) == 0
        writes = np.flatnonzero(
            sound & (f.kind == REQUEST) & (f.address >= 0) & (f.data_length > 0)
        )
        # what is for several servos has parts, each with an address of its own
        several = np.zeros(len(f), bool)
        several[batch.values.row[batch.values.servo_id != f.servo_id[batch.values.row]]] = True
        several |= np.isin(f.servo_id, shared_ids(self.protocol))
        writes = writes[~several[writes]]
        ok = np.flatnonzero((t.outcome == OK) & (t.response >= 0) & (t.request != -1))
        asked, which = batch.asking(t.request[ok])
        answers = t.response[ok]
        own = f.address[answers]
        address = np.where(own >= 0, own, asked.address[which])
        keep = (address >= 0) & (f.data_length[answers] > 0) & sound[answers]
        rows = np.concatenate([answers[keep], writes])
        places = np.concatenate([address[keep], f.address[writes]])
        is_write = np.arange(len(rows)) >= int(keep.sum())
        order = np.argsort(rows, kind="stable")
        order = order[meant(batch)[rows[order]]]
        self._take(batch, rows[order], places[order], is_write[order])
        self._compare(batch)

    def _take(self, batch: Batch, rows: I64, address: I64, is_write: Mask) -> None:
        if not len(rows):
            return
        f = batch.frames
        data = np.frombuffer(batch.data, np.uint8)
        length = f.data_length[rows]
        key = ((f.servo_id[rows].astype(np.int64) << 20 | address) << 16 | length) << 1 | is_write
        keys, group, _ = distinct(key)
        first = np.full(len(keys), len(group))
        np.minimum.at(first, group, np.arange(len(group)))
        for k in np.argsort(first).tolist():
            mine = rows[group == k]
            lead = int(first[k])
            servo, size = int(f.servo_id[mine[0]]), int(length[lead])
            for at in range(0, size, WIDEST):
                wide = min(WIDEST, size - at)
                span = ByteSpan(servo, int(address[lead]) + at, wide, bool(is_write[lead]))
                if span not in self.spans and len(self.spans) >= SPANS:
                    continue
                place = f.data_start[mine][:, None] + at + np.arange(wide)
                if span not in self.spans:
                    self.spans[span] = SpanBytes.of(wide)
                self.spans[span].add(f.t_end[mine], data[place])

    def _compare(self, batch: Batch) -> None:
        """Keep the values that are known, also those of a selection's neighbours."""
        v = batch.values.take(batch.values.accepted)
        value = np.where(np.isnan(v.value), v.raw, v.value)
        rows = np.flatnonzero((v.part == WHOLE) & (v.servo_id >= 0))
        keys, which, _ = distinct(v.servo_id[rows].astype(np.int64) << 32 | v.register[rows])
        first = np.full(len(keys), len(which))
        np.minimum.at(first, which, np.arange(len(which)))
        for k in np.argsort(first).tolist():
            key = int(keys[k]) >> 32, int(keys[k]) & 0xFFFFFFFF
            if key not in self.values and len(self.values) >= KNOWN:
                continue
            mine = rows[which == k]
            self.values.setdefault(key, Thinned()).add(v.t_ns[mine], value[mine])


class Bytewise:
    """A sink that follows the bytes of all registers."""

    def __init__(self) -> None:
        self.lanes: dict[str, LaneBytes] = {}

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing: batches hold every byte."""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Take a batch."""
        name = bus_of(bus, protocol, batch)
        if name not in self.lanes:
            self.lanes[name] = LaneBytes(protocol)
        self.lanes[name].add(batch)

    def close(self) -> None:
        """Do nothing: what was heard is asked for afterwards."""
