"""Bytes that no frame claims: where they are cut before they are explained."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

from sniffer.ground.model import Gap

if TYPE_CHECKING:
    from sniffer.ground.framing import Block


def stretches(a: int, b: int, block: Block) -> list[tuple[int, int, bool]]:
    """Cut ``a..b`` at silences; tell for each part whether a silence (or the end) follows it."""
    if not len(block.barriers):
        return [(a, b, block.final and b == block.n)]
    inside = block.barriers[(block.barriers > a) & (block.barriers <= b)].tolist()
    edges = [a, *(x for x in inside if x < b), b]
    silent = {*inside, *([block.n] if block.final else [])}
    return [(c, d, d in silent) for c, d in itertools.pairwise(edges)]


def mark_tail(pieces: list[Gap]) -> None:
    """A frame cut off by silence or by the end of the capture is an idle tail."""
    if pieces and pieces[-1].reason == "truncated":
        g = pieces[-1]
        pieces[-1] = Gap(g.start, g.length, "idle_tail", g.detail)
