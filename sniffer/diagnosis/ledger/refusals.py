"""Commands that a servo answered with a refusal: which, how often, and how often it took them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.ledger.buckets import Buckets
from sniffer.ground.codes import OK
from sniffer.ground.model import ECHO_DIFFERS

if TYPE_CHECKING:
    from sniffer.ground.model import I64, Batch
    from sniffer.protocols.base import BusProtocol

ADDRESSES: Final = 1 << 13
"""Addresses are below 8192 in every protocol met; those beyond are one."""

OPS: Final = 1 << 32
"""Commands by the rest of this: words of LSS have longer numbers, and no two words one rest."""

_COLUMNS: Final = {
    "n": "sum",
    "status": "last",
    "at": "first",
    "length": "first",
    "t_first": "first",
    "t_last": "last",
}


class Refusals:
    """Counts by servo, command and address what was answered with a refusal."""

    def __init__(self, protocol: BusProtocol) -> None:
        self._protocol = protocol
        self._ops: dict[int, int] = {}
        self.counts = Buckets(_COLUMNS)

    def add(self, batch: Batch) -> None:
        """Take the exchanges of a batch."""
        t, f = batch.transactions, batch.frames
        doubtful = (f.status > 0) | (f.flags & ECHO_DIFFERS != 0)
        if not doubtful.any():
            return
        rows = np.flatnonzero((t.outcome == OK) & (t.request != -1) & (t.response >= 0))
        rows = rows[doubtful[t.response[rows]]]
        answer = t.response[rows]
        status = f.status[answer]
        refused = ((status > 0) & self._protocol.refused(status)) | (
            f.flags[answer] & ECHO_DIFFERS != 0
        )
        rows, answer, status = rows[refused], answer[refused], status[refused]
        if not len(rows):
            return
        frames, asked = batch.asking(t.request[rows])
        servo, op = f.servo_id[answer].astype(np.int64) + 1, frames.op[asked] & OPS - 1
        address = np.clip(frames.address[asked] + 1, 0, ADDRESSES - 1)
        self._ops.update(zip(op.tolist(), frames.op[asked].tolist(), strict=True))
        self.counts.add(
            (servo * ADDRESSES + address) * OPS + op,
            n=1,
            status=status.astype(np.int64),
            at=frames.start[asked] + batch.base,
            length=frames.length[asked],
            t_first=f.t_end[answer],
            t_last=f.t_end[answer],
        )

    def counted(self) -> dict[str, I64]:
        """Return the counts as columns, with ``servo_id``, ``op`` and ``address`` (-1: none)."""
        key, columns = self.counts.table()
        rest = key // OPS
        op = np.array([self._ops[k] for k in (key % OPS).tolist()], np.int64)
        return {
            **columns,
            "op": op,
            "address": rest % ADDRESSES - 1,
            "servo_id": rest // ADDRESSES - 1,
        }
