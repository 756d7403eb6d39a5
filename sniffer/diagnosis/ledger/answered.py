"""What became of requests, and which commands somebody on the bus answers, from where on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sniffer.ground.codes import IF_ALL, MANY, MISMATCHED, NEVER, NOT_EXPECTED, OK
from sniffer.ground.model import ECHO

if TYPE_CHECKING:
    from sniffer.ground.model import I64, Batch, Mask


class AnsweredCommands:
    """Remembers where the first sound answer to each command is said, whoever gave it.

    A servo of which no answer holds may answer writes all the same: that its peers do says so.
    """

    def __init__(self) -> None:
        self._since: dict[int, int] = {}

    def add(self, batch: Batch) -> None:
        """Take the exchanges of a batch."""
        t, f = batch.transactions, batch.frames
        asked = batch.rows_of(t.request)
        sound = asked[(t.outcome == OK) & (asked >= 0)]
        ops, first = np.unique(f.op[sound], return_index=True)
        for op, row in zip(ops.tolist(), sound[first].tolist(), strict=True):
            self._since.setdefault(op, int(f.start[row]) + batch.base)

    def are_known(self, ops: I64, at: I64) -> Mask:
        """Tell of commands whether somebody has answered one before some absolute offsets."""
        since = self._since
        return np.array(
            [
                op in since and since[op] < where
                for op, where in zip(ops.tolist(), at.tolist(), strict=True)
            ],
            np.bool_,
        )


def is_awaited(reply: I64, outcome: I64, follows: Mask, by_peers: Mask) -> Mask:
    """Tell behind which requests an answer is awaited, so that torn bytes there are one.

    Args:
        reply: whether each request is answered, as its protocol has it.
        outcome: what became of it.
        follows: an answer begins right behind the torn bytes.
        by_peers: somebody is heard to answer such a request.
    """
    awaits: Mask = (reply != NEVER) & (reply != MANY)
    awaits &= ((outcome != NOT_EXPECTED) | by_peers) & ((outcome != OK) | follows)
    # another answer behind a write that need not have one is that to a torn request
    awaits &= (outcome != MISMATCHED) | ~follows | (reply != IF_ALL)
    return awaits


def outcomes_of(batch: Batch) -> I64:
    """Return what became of each frame's request, -1 for others; an echo's is its request's."""
    t, f = batch.transactions, batch.frames
    out = np.full(len(f) + 1, -1, np.int64)
    asked = batch.rows_of(t.request)
    mine = np.flatnonzero(asked >= 0)
    out[asked[mine]] = t.outcome[mine]
    echo = np.flatnonzero(f.flags & ECHO)
    out[echo] = out[echo - 1]
    return out
