"""A chunk in two parts: its bytes, their times, and what the tap remarked about them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sniffer.ground.model import Chunk, Mark

Placed = tuple[int, "Chunk"]
"""A chunk, and the offset of its first byte in the stream."""


def cut(chunk: Chunk, at: int, t_ns: int | None) -> tuple[Chunk, Chunk]:
    """Return a chunk as two: ``at`` bytes in the first one, whose time becomes ``t_ns``.

    A mark over the cut stands on both, with its whole count: nobody knows on which side it was.
    """
    left: list[Mark] = []
    right: list[Mark] = []
    for mark in chunk.marks:
        end = mark.start + mark.length
        if mark.start < at:
            left.append(mark._replace(length=min(end, at) - mark.start))
        if mark.start >= at or end > at:
            start = max(mark.start, at)
            right.append(mark._replace(start=start - at, length=end - start))
    return (
        replace(chunk, data=chunk.data[:at], t_ns=t_ns, marks=tuple(left)),
        replace(chunk, data=chunk.data[at:], marks=tuple(right)),
    )


def behind(placed: Iterable[Placed], place: int, byte_ns: int) -> tuple[list[Placed], int | None]:
    """Return the chunks behind a place, and where one is cut there the time of the byte before."""
    kept: list[Placed] = []
    t_ns: int | None = None
    for start, chunk in placed:
        rest = start + len(chunk.data) - place
        if start > place or (start == place and rest):
            kept.append((start, chunk))
        elif rest > 0:
            t_ns = None if chunk.t_ns is None else chunk.t_ns - rest * byte_ns
            kept.append((place, cut(chunk, place - start, t_ns)[1]))
    return kept, t_ns
