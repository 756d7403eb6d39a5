"""Bytes that no frame claims: where they are cut before they are explained."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sniffer.ground.gaps import IDLE_TAIL, TRUNCATED
from sniffer.ground.model import GAP_MAX, I64, U8, Gap, Mask
from sniffer.protocols.explaining import Pieces, Surveyor, pieces

if TYPE_CHECKING:
    from sniffer.ground.framing import Block


class Holes(NamedTuple):
    """Unclaimed bytes to explain in one go; ``closed``: a silence (or the end) follows."""

    start: I64
    end: I64
    closed: Mask


def holes_of(start: I64, end: I64, block: Block) -> Holes:
    """Cut holes between frames at silences, and what is long into pieces, from where it begins."""
    closed = np.zeros(len(start), bool)
    if len(block.barriers):
        inside = block.barriers[np.searchsorted(start, block.barriers) != 0]
        hole = np.searchsorted(start, inside) - 1  # the hole that begins before it
        inside = inside[inside < end[hole]]
        start, end = np.sort(np.append(start, inside)), np.sort(np.append(end, inside))
        closed = np.isin(end, block.barriers)
    if block.final:
        closed = closed | (end == block.n)
    many = -(-(end - start) // GAP_MAX)
    if (many > 1).any():
        of = np.repeat(np.arange(len(start)), many)
        start = start[of] + (np.arange(len(of)) - np.repeat(np.cumsum(many) - many, many)) * GAP_MAX
        closed = closed[of] & (end[of] - start <= GAP_MAX)
        end = np.minimum(end[of], start + GAP_MAX)
    return Holes(start, end, closed)


def surveyed(protocol: Surveyor, block: Block, holes: Holes) -> tuple[Pieces, U8]:
    """Return the gaps of all holes at once, and their kinds: an idle tail is a cut-off frame."""
    found = pieces(protocol, block.data, holes.start, holes.end)
    last = np.append(found.run[1:] != found.run[:-1], True)
    tail = last & holes.closed[found.run] & (found.kind == TRUNCATED)
    return found, np.where(tail, np.uint8(IDLE_TAIL), found.kind)


def mark_tail(pieces: list[Gap]) -> None:
    """A frame cut off by silence or by the end of the capture is an idle tail."""
    if pieces and pieces[-1].reason == "truncated":
        g = pieces[-1]
        pieces[-1] = Gap(g.start, g.length, "idle_tail", g.detail)
