"""Writes of addresses that no table names: nobody can say what they change."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.ledger.buckets import Buckets
from sniffer.ground.codes import OK, REQUEST
from sniffer.ground.model import ECHO, MALFORMED, UNKNOWN

if TYPE_CHECKING:
    from sniffer.ground.model import I64, Batch
    from sniffer.protocols.base import BusProtocol

_WRITES: Final = {
    "n": "sum",
    "refused": "sum",
    "acknowledged": "sum",
    "at": "first",
    "length": "first",
    "t_first": "first",
    "t_last": "last",
}

_ADDRESSES: Final = 1 << 16


class UnnamedWrites:
    """Counts them by servo and address, with what the servo said to them."""

    def __init__(self, protocol: BusProtocol) -> None:
        self._protocol = protocol
        self._has_addresses = any(r.address >= 0 for r in protocol.registers)
        self._writes = Buckets(_WRITES)

    def add(self, batch: Batch) -> None:
        """Take the writes of a batch that state no value of any register."""
        f = batch.frames
        if not self._has_addresses or not len(f):
            return
        writes = (f.kind == REQUEST) & (f.address >= 0) & (f.data_length > 0)
        writes[batch.values.row] = False
        if not writes.any():
            return
        writes &= f.flags & (MALFORMED | UNKNOWN | ECHO) == 0
        rows = np.flatnonzero(writes)
        t = batch.transactions
        asked = batch.rows_of(t.request)
        answered = (t.outcome == OK) & (t.response >= 0) & (asked >= 0)
        status = np.full(len(f), -2)
        status[asked[answered]] = f.status[t.response[answered]]
        told = status[rows] > -2
        refused = told & self._protocol.refused(status[rows].astype(np.int16))
        self._writes.add(
            (f.servo_id[rows].astype(np.int64) + 1) * _ADDRESSES + f.address[rows] % _ADDRESSES,
            n=np.ones(len(rows), np.int64),
            refused=refused.astype(np.int64),
            acknowledged=(told & ~refused).astype(np.int64),
            at=f.start[rows] + batch.base,
            length=f.length[rows],
            t_first=f.t_end[rows],
            t_last=f.t_end[rows],
        )

    def table(self) -> dict[str, I64]:
        """Return them as columns, with ``servo_id`` and ``address``."""
        key, columns = self._writes.table()
        return {**columns, "servo_id": key // _ADDRESSES - 1, "address": key % _ADDRESSES}
