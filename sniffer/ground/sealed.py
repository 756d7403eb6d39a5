"""Where a packet's check stands, what it covers, whether it holds: for one packet or for many."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from sniffer.ground.model import I64, U8, Mask
    from sniffer.ground.wire import Order


class Edge(NamedTuple):
    """A place in a packet: so many bytes behind its first one or, ``last``, before its end."""

    bytes: int
    last: bool = False

    def of(self, start: Any, end: Any) -> Any:
        """Return the offset, for one packet or for many."""
        return end - self.bytes if self.last else start + self.bytes


Stretch = tuple[Edge, Edge]


class Sealed(NamedTuple):
    """A check that stands where its grammar says, over stretches of the packet, in order."""

    name: str
    checksum: Any  # a Sum; one with ``over`` where it stands not right behind one stretch
    at: Stretch
    over: tuple[Stretch, ...]
    some: bool = False  # not there where it covers nothing
    order: Order = "little"  # which byte of it is the first

    @property
    def is_behind(self) -> bool:
        """Whether it stands right behind the one stretch that it covers."""
        return len(self.over) == 1 and self.over[0][1] == self.at[0]

    def good(self, data: U8, start: I64, end: I64) -> Mask:
        """Tell for which packets it holds."""
        if self.some:  # a packet that ends where the covered field begins has it not
            there = np.flatnonzero(self.at[0].of(start, end) > self.over[0][0].of(start, end))
            out = np.ones(len(start), bool)
            out[there] = self._holds(data, start[there], end[there])
            return out
        return self._holds(data, start, end)

    def _holds(self, data: U8, start: I64, end: I64) -> Mask:
        """Tell the same of packets that have it."""
        if self.is_behind and self.order == "little":
            at = self.at[0].of(start, end)
            return np.asarray(self.checksum.good(data, self.over[0][0].of(start, end), at))
        want, sent = self.numbers(data, start, end)
        return np.asarray(want == sent)

    def numbers(self, data: U8, start: I64, end: I64) -> tuple[I64, I64]:
        """Return what it should be in packets that have it, and what was sent."""
        spans = [(first.of(start, end), last.of(start, end)) for first, last in self.over]
        at = self.at[0].of(start, end)
        rise = range(self.width) if self.order == "little" else reversed(range(self.width))
        sent = sum(data[at + k].astype(np.int64) << 8 * by for k, by in enumerate(rise))
        if hasattr(self.checksum, "over"):
            return self.checksum.over(data, spans).astype(np.int64), np.asarray(sent)
        packets = (data[a:b].tobytes() for a, b in zip(start.tolist(), end.tolist(), strict=True))
        want = [self.checksum(self.covered(packet)) for packet in packets]
        return np.array(want, np.int64), np.asarray(sent)

    @property
    def width(self) -> int:
        """Bytes of it."""
        first, last = (edge.of(0, 0) for edge in self.at)
        return int(last - first)

    def stands_in(self, raw: bytes) -> bool:
        """Tell whether one packet has it."""
        return not self.some or len(raw) > self.over[0][0].bytes

    def covered(self, raw: bytes) -> bytes:
        """Return the bytes of one packet that it covers."""
        n = len(raw)
        spans = [raw[first.of(0, n) : last.of(0, n)] for first, last in self.over]
        return spans[0] if len(spans) == 1 else b"".join(spans)

    def sent(self, raw: bytes) -> int:
        """Return what stands in one packet where it is."""
        first, last = self.at
        raw = raw[first.of(0, len(raw)) : last.of(0, len(raw))]
        return int.from_bytes(raw, self.order)
