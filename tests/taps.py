"""A simulated bus as two adapters hear it, one on each wire, and what becomes of its exchanges."""

from __future__ import annotations

import itertools
import random
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from sniffer.decoding.decoder import Decoder
from sniffer.ground.codes import OK
from sniffer.ground.model import NS, Batch, Chunk, Clock, Direction
from sniffer.merging.merger import Merger
from sniffer.protocols import PROTOCOLS
from sniffer.simulation import BUSES, Fault, TrueFrame, simulate

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

MS: Final = NS // 1000
START_NS: Final = 1_795_215_306 * NS
PACKET: Final = 62
"""Bytes after which an adapter does not wait for its latency timer."""

TX, RX = Direction.TX, Direction.RX


def tap(
    frames: Iterable[TrueFrame], wire: Direction, baud: int, latency_ns: int, phase_ns: int = 0
) -> list[Chunk]:
    """Return what an adapter with a latency timer that ticks by itself hears of one wire."""
    out: list[Chunk] = []
    held, due_ns = bytearray(), 0
    for frame in frames:
        if (frame.kind == "response") != (wire == RX):
            continue
        for k, byte in enumerate(frame.wire, 1):
            t_ns = frame.t_start_ns - (-k * 10 * NS // baud)
            if held and t_ns > due_ns:
                out.append(Chunk(bytes(held), due_ns, Clock.READ, "tap", wire))
                held.clear()
            if not held:
                due_ns = t_ns + (phase_ns - t_ns) % latency_ns
            held.append(byte)
            if len(held) == PACKET:
                out.append(Chunk(bytes(held), t_ns, Clock.READ, "tap", wire))
                held.clear()
    if held:
        out.append(Chunk(bytes(held), due_ns, Clock.READ, "tap", wire))
    return out


def by_stamp(*taps: Sequence[Chunk]) -> list[Chunk]:
    """Return the reads of all taps as they lie in time, the controller's first on ties."""
    return sorted(itertools.chain(*taps), key=lambda c: (c.t_ns or 0, c.direction))


@dataclass(frozen=True, slots=True)
class Bus:
    """A simulated bus as two taps hear it."""

    name: str
    frames: list[TrueFrame]
    tx: list[Chunk]
    rx: list[Chunk]
    latency_ns: int

    @property
    def reads(self) -> list[Chunk]:
        return by_stamp(self.tx, self.rx)

    def merger(self) -> Merger:
        return Merger(
            "pair",
            latency_ns=self.latency_ns,
            baud=BUSES[self.name].baud,
            protocol=PROTOCOLS[self.name],
        )

    def merged(self) -> list[Chunk]:
        merger = self.merger()
        return [*merger.feed(self.reads), *merger.close()]


def heard(
    name: str,
    latency: tuple[int, int],
    *,
    seed: int = 1,
    seconds: float = 3.0,
    faults: Sequence[Fault] = (),
    jitter_ns: int = 0,
) -> Bus:
    """Let a bus talk, and two adapters of these latencies (in ns) listen.

    ``jitter_ns``: by how much a read may come later still, because the host was busy.
    """
    frames = list(
        simulate(
            name,
            seed=seed,
            start_ns=START_NS,
            duration_s=seconds,
            faults=faults,
        )
    )
    rng, baud = random.Random(seed), BUSES[name].baud
    tx, rx = (
        tap(frames, wire, baud, ns, rng.randrange(ns))
        for wire, ns in zip((TX, RX), latency, strict=True)
    )
    if jitter_ns:
        tx, rx = (_delayed(chunks, jitter_ns, rng) for chunks in (tx, rx))
    return Bus(name, frames, tx, rx, max(latency) + jitter_ns)


def _delayed(chunks: Iterable[Chunk], jitter_ns: int, rng: random.Random) -> list[Chunk]:
    times = [(c.t_ns or 0) + rng.randrange(jitter_ns) for c in chunks]
    return [
        replace(c, t_ns=t) for c, t in zip(chunks, itertools.accumulate(times, max), strict=True)
    ]


Pair = tuple[int, int]
"""An exchange: where its request begins on one wire, and its answer on the other."""


def true_pairs(frames: Iterable[TrueFrame], fault: str | None = None) -> set[Pair]:
    """Return the exchanges of which both frames came whole; only those with a fault, if named."""
    out: set[Pair] = set()
    at, asked = [0, 0], -1
    for frame in frames:
        wire = frame.kind == "response"
        whole = not frame.damaged and frame.fault != "duplicate"
        if frame.kind == "request":
            asked = at[0] if whole else -1
        elif wire and whole and asked >= 0 and fault in (None, frame.fault):
            out.add((asked, at[1]))
        at[wire] += len(frame.wire)
    return out


def decode(name: str, chunks: Sequence[Chunk], latency_ns: int) -> list[Batch]:
    decoder = Decoder(name, baud=BUSES[name].baud, latency_ns=latency_ns)
    return [decoder.feed(*chunks), decoder.close()]


def pairs(name: str, chunks: Sequence[Chunk], latency_ns: int) -> set[Pair]:
    """Return the exchanges that the decoder finds in a stream of two wires."""
    where: list[Pair] = []
    at = {TX: 0, RX: 0}
    for c in chunks:
        where += [(c.direction, at[c.direction] + k) for k in range(len(c.data))]
        at[c.direction] += len(c.data)
    out: set[Pair] = set()
    for b in decode(name, chunks, latency_ns):
        t = b.transactions.take(b.transactions.outcome == OK)
        for row, answer in zip(t.request.tolist(), t.response.tolist(), strict=True):
            asked = where[b.base + int(b.frames.start[row])]
            told = where[b.base + int(b.frames.start[answer])]
            if (asked[0], told[0]) == (TX, RX):
                out.add((asked[1], told[1]))
    return out


def shares(bus: Bus) -> tuple[float, float]:
    """Return the share of exchanges paired right: merged, and with reads sorted by stamp."""
    true = true_pairs(bus.frames)
    assert len(true) > 50
    found = (pairs(bus.name, chunks, bus.latency_ns) for chunks in (bus.merged(), bus.reads))
    merged, sorted_ = (len(p & true) / len(true) for p in found)
    return merged, sorted_
