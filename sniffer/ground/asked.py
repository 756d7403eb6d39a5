"""Where requests stand that transactions name beside a batch's own rows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from sniffer.ground.model import I64, Frames


def own_rows(frames: Frames, before: Frames | None, request: I64) -> I64:
    """Return the row of the frame that each request is said by; -1: none, or of an earlier batch.

    A request to a list of servos is one row, and what it asks of each servo stands in ``before``.

    Args:
        frames: a batch's own.
        before: the requests beside them.
        request: as ``Transactions`` has it.
    """
    named = np.flatnonzero(request < -1)
    if before is None or not len(named):
        return request
    start = before.start[-2 - request[named]]
    row = np.minimum(np.searchsorted(frames.start, start), max(len(frames) - 1, 0))
    out = request.copy()
    out[named] = np.where(frames.start[row] == start, row, -1) if len(frames) else -1
    return out
