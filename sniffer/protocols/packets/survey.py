"""Why no frame claims some bytes, for all runs of a pass at once: ``Words.explain`` in columns."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sniffer.ground.gaps import CHECKSUM, DAMAGED, TRUNCATED
from sniffer.protocols.explaining import NOBODY, Torn, following

if TYPE_CHECKING:
    from sniffer.ground.model import I64
    from sniffer.ground.plan import Plan
    from sniffer.protocols.explaining import Runs


def survey(runs: Runs, plan: Plan, size_name: str, least: int, total: I64) -> Torn:
    """Judge every header of the runs.

    Args:
        runs: to look at.
        plan: of the packets.
        size_name: the plan's field that the length of a packet follows from.
        least: of it that can be.
        total: bytes of a whole packet, by its size; a greater size is not believed.
    """
    who, size_at, width = plan.at["servo_id"], plan.at[size_name], plan.width[size_name]
    every = runs.find(plan.header)
    # an id is never a header's byte: of headers that overlap, the last one is it
    is_last = np.ones(len(every), bool)
    np.not_equal(every[1:], every[:-1] + 1, out=is_last[:-1])
    at = every[is_last]
    end = runs.end[runs.of(at)]
    behind = at + size_at + width
    size = sum(runs.byte(at + size_at + k) << 8 * k for k in range(width))
    size = np.where(behind <= end, size, -1)
    impossible = (size >= 0) & ((size < least) | (size >= len(total)))
    stop = at + total[np.minimum(np.maximum(size, least), len(total) - 1)]
    onward = following(every, at + len(plan.header), end)
    cut = (size < 0) | (stop > end) | ((onward < end) & (onward < stop - plan.sum_width))
    cut &= ~impossible
    until = np.where(impossible, behind, np.where(cut, onward, stop))
    kind = np.where(cut, TRUNCATED, DAMAGED).astype(np.uint8)
    whole = np.flatnonzero(~impossible & ~cut)
    # One that holds and is no frame all the same has a body that its guards refuse.
    sums = plan.checksum.good(runs.data, at[whole] + plan.sum_from, until[whole] - plan.sum_width)
    kind[whole[~sums]] = CHECKSUM
    named = ~impossible & (until - at > who)
    return Torn(at, until, kind, np.where(named, runs.byte(at + who), NOBODY))
