"""What is open where a capture ends: more bytes could still have changed it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sniffer.ground.codes import OK, RESPONSE
from sniffer.ground.model import Cut

if TYPE_CHECKING:
    from sniffer.ground.model import I64, Frames, Transactions
    from sniffer.protocols.base import BusProtocol


class LeftOpen(NamedTuple):
    """Requests that bytes from ``decided`` on may still answer: ``rows`` of the frames.

    ``last_ns`` is the latest moment that is known of: a stamp, or that nothing was said until then.
    """

    protocol: BusProtocol
    frames: Frames
    rows: I64
    decided: int
    last_ns: int

    def cut(self, transactions: Transactions, base: int, size: int) -> Cut:
        """Return what more bytes could still have changed, where the capture ends with a block.

        A request whose time for an answer was over is not among it. The clock tells that. Without
        one it was over where the controller asked again after an answer; not so if all answers
        behind the request are to earlier ones, for with several in flight those come first.

        Args:
            transactions: of the frames.
            base: offset in the stream of the block.
            size: of the block in bytes.
        """
        frames, rows = self.frames, self.rows
        tail = frames.take(rows)
        answer = frames.kind == RESPONSE
        turns = np.flatnonzero(answer[:-1] & ~answer[1:])
        t = transactions.take(transactions.response >= 0)
        passed = np.where(t.outcome == OK, t.request, t.response)
        may = rows > min(max(turns.tolist(), default=-1), max(passed.tolist(), default=-1))
        waited = self.last_ns - tail.t_end - tail.uncertainty
        may = np.where(tail.uncertainty >= 0, waited <= self.protocol.window_ns(tail), may)
        first = min(frames.start[rows[may]].tolist(), default=size)
        # What waits for the bytes behind it all, as wCK commands in a row do, may be over as well.
        ends = frames.end[rows[~may]]
        over = max(ends[ends <= first].tolist(), default=0)
        asked = max(min(self.decided, first), over)
        return Cut(base + asked, base + max(self.decided, over))
