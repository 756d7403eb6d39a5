"""A chunk in two parts: its bytes, their times, and what the tap remarked about them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sniffer.ground.model import Chunk, Mark


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
