"""Who speaks, where only the packet before tells: columns in which request and answer alternate."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sniffer.ground.distinct import numbers

if TYPE_CHECKING:
    from sniffer.ground.framing import Block
    from sniffer.ground.model import I64, Mask, Spans


def in_turn(base: Mask, flips: Mask) -> Mask:
    """Return which rows are requests, where some are answers if the row before is a request.

    No loop is needed: in a run of ``flips`` request and answer alternate, whatever it begins with.
    For example, each row would fit as a request::

        row      0  1  2  3  4
        base     1  1  1  1  1
        flips    0  1  1  1  0      an answer, if the row before asks
        last     0  0  0  0  4      where the run began
        out      1  0  1  0  1
    """
    row = np.arange(len(base))
    last = np.maximum.accumulate(np.where(flips, 0, row))
    out: Mask = base[last] ^ ((row - last) & 1 > 0)
    return out


def near(block: Block, spans: Spans, reach: int) -> Mask:
    """Tell which rows are near enough the row before to answer it."""
    out = np.zeros(len(spans.start), bool)
    out[1:] = spans.start[1:] - spans.end[:-1] <= reach
    if len(block.barriers):
        segment = block.segment(spans.start)
        out[1:] &= segment[1:] == segment[:-1]
    return out


def alike(block: Block, spans: Spans, rows: I64) -> Mask:
    """Tell which of some rows have the bytes of the row before, which is as long."""
    start, size = spans.start, spans.end - spans.start
    out = np.zeros(len(rows), bool)
    for n in numbers(size[rows]).tolist():
        which = np.flatnonzero(size[rows] == n)
        mine = rows[which]
        here = start[mine][:, None] + np.arange(n)
        back = (start[mine] - start[mine - 1])[:, None]
        out[which] = (block.data[here] == block.data[here - back]).all(axis=1)
    return out


def said_again(block: Block, spans: Spans, may: Mask, reach: int) -> Mask:
    """Return which rows are answers because they are the request before them once more.

    ``may``: rows of commands that are answered so. A request that was lost and said again looks
    like one that was answered, and no byte tells it; its time does, if it is late.
    """
    size = spans.end - spans.start
    again = may & near(block, spans, reach)
    again[1:] &= size[1:] == size[:-1]
    rows = np.flatnonzero(again)
    again[rows] = alike(block, spans, rows)
    return ~in_turn(np.ones(len(may), bool), again)
