"""What a tap with an exact clock makes of a line: bytes in rows, with the stop bits it missed."""

from __future__ import annotations

import heapq
import random
from bisect import bisect_right
from typing import TYPE_CHECKING, Final

from bench.diagnosis.line import SHADOW, Bench, Said, begin_of
from bench.diagnosis.scenario import Heard
from bench.diagnosis.uart import BITS, Pulse, Receiver, line

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

APART: Final = 1.15
"""Two bytes whose beginnings are further apart than so many byte times stand in two rows: senders
are off by less."""


def tapped(bench: Bench, tap: Receiver | None = None) -> list[Heard]:
    """Return what a tap hears of all that was said; one of the line's own rate where None."""
    ear = tap or Receiver(bench.baud)
    rng = random.Random(f"tap {bench.seed}")
    out: list[Heard] = []
    for said, pulses in _clusters(bench, ear):
        out += _heard(bench, ear, said, pulses, rng)
    return out


def _is_plain(bench: Bench, ear: Receiver, said: Said) -> bool:
    return said.plain and ear.baud == bench.baud and not ear.error


def _clusters(bench: Bench, ear: Receiver) -> Iterator[tuple[list[Said], list[Pulse]]]:
    """Yield what may have to do with each other: nothing before is in the way of a receiver."""
    end = max((s.end_ns for s in bench.said), default=0.0)
    pulses = bench.pulsed(end)
    shadow = SHADOW * ear.bit_ns
    said: list[Said] = []
    outside: list[Pulse] = []
    until = 0.0
    things: Iterator[Said | Pulse] = heapq.merge(bench.said, pulses, key=begin_of)
    for thing in things:
        if thing.t_ns > until and (said or outside):
            yield said, outside
            said, outside = [], []
        if isinstance(thing, Said):
            said.append(thing)
            over = thing.end_ns if _is_plain(bench, ear, thing) else thing.end_ns + shadow
        else:
            outside.append(thing)
            over = max(thing.end_ns, thing.t_ns + shadow)
        until = max(until, over)
    if said or outside:
        yield said, outside


def _heard(
    bench: Bench, ear: Receiver, said: Sequence[Said], pulses: Sequence[Pulse], rng: random.Random
) -> Iterator[Heard]:
    if len(said) == 1 and not pulses and _is_plain(bench, ear, said[0]):
        (one,) = said
        yield Heard(int(one.t_ns), int(one.end_ns), one.data, one.sender < 0)
        return
    edges = line([s.burst for s in said], pulses, clash=bench.clash, rng=rng)
    begins = [s.t_ns for s in said]
    whole_ns = BITS * ear.bit_ns
    row: list[tuple[float, int, bool]] = []
    owner = last = -1

    def told() -> Heard:
        return Heard(
            int(row[0][0]),
            int(row[-1][0] + whole_ns),
            bytes(value for _, value, _ in row),
            owner >= 0 and said[owner].sender < 0,
            tuple(k for k, (_, _, stop) in enumerate(row) if not stop),
        )

    for byte in ear.hear(edges, rng):
        last = bisect_right(begins, byte.t_ns + ear.bit_ns) - 1
        apart = row and byte.t_ns - row[-1][0] > APART * whole_ns
        if row and (apart or (last != owner and byte.t_ns >= said[owner].end_ns)):
            yield told()
            row.clear()
        if not row:
            owner = last
        row.append((byte.t_ns, byte.value, byte.stop))
    if row:
        yield told()
