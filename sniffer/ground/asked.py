"""Where requests stand that transactions name beside a batch's own rows."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

_I64 = npt.NDArray[np.int64]


def own_rows(start: _I64, before: _I64, request: _I64) -> _I64:
    """Return the row of the frame that each request is said by; -1: none, or of an earlier batch.

    A request to a list of servos is one row, and what it asks of each servo stands in ``before``.

    Args:
        start: where each frame of a batch begins.
        before: where the requests beside them do.
        request: as ``Transactions`` has it.
    """
    named = np.flatnonzero(request < -1)
    if not len(named):
        return request
    wanted = before[-2 - request[named]]
    row = np.minimum(np.searchsorted(start, wanted), max(len(start) - 1, 0))
    out = request.copy()
    out[named] = np.where(start[row] == wanted, row, -1) if len(start) else -1
    return out
