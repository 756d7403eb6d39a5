"""Commands that end a goal without stating another: a motor let go, a servo begun anew, a wheel."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.ledger.buckets import TimedBuckets
from sniffer.ground.codes import REQUEST
from sniffer.ground.model import ECHO, RESETS
from sniffer.protocols.base import RESTARTS, TURNS_ELSEWHERE, ends_goal

if TYPE_CHECKING:
    from sniffer.ground.model import I64, Batch
    from sniffer.protocols.base import BusProtocol

KINDS: Final = TURNS_ELSEWHERE + 1

_COLUMNS: Final = {
    "n": "sum",
    "at": "first",
    "length": "first",
    "t_first": "first",
    "t_last": "last",
}


class Orders:
    """Counts such commands by bucket, servo and kind (``protocols.base``)."""

    def __init__(self, protocol: BusProtocol) -> None:
        known = ends_goal(protocol)
        self._ops = np.array(sorted(known), np.int64)
        self._kinds = np.array([known[op] for op in sorted(known)], np.int64)
        self.counts = TimedBuckets(_COLUMNS, kind=KINDS)

    def add(self, batch: Batch) -> None:
        """Take the commands of a batch."""
        f = batch.frames
        mine = (f.flags & RESETS) != 0
        for op in self._ops.tolist():
            mine |= f.op == op
        if not mine.any():
            return
        rows = np.flatnonzero(mine & (f.kind == REQUEST) & (f.flags & ECHO == 0))
        kind = np.full(len(rows), RESTARTS, np.int64)
        if len(self._ops):
            place = np.minimum(np.searchsorted(self._ops, f.op[rows]), len(self._ops) - 1)
            kind = np.where(self._ops[place] == f.op[rows], self._kinds[place], kind)
        t_ns = f.t_end[rows]
        self.counts.add(
            t_ns,
            f.servo_id[rows],
            kind,
            n=1,
            at=f.start[rows] + batch.base,
            length=f.length[rows],
            t_first=t_ns,
            t_last=t_ns,
        )

    def counted(self) -> dict[str, I64]:
        """Return the counts as columns, with ``bucket``, ``servo_id`` and ``kind``."""
        return self.counts.table()
