"""Answers to requests that need none, and reads of servos that were told to answer none."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.ledger.buckets import Buckets
from sniffer.diagnosis.ledger.refusals import OPS
from sniffer.ground.codes import IF_READ, NOT_EXPECTED, OK, Reply

if TYPE_CHECKING:
    from sniffer.ground.model import I64, Batch, Frames

_COLUMNS: Final = {
    "n": "sum",
    "at": "first",
    "length": "first",
    "t_first": "first",
    "t_last": "last",
}


class OptionalAnswers:
    """Counts by servo and command."""

    def __init__(self) -> None:
        self.counts = Buckets(_COLUMNS)

    def add(self, batch: Batch) -> None:
        """Take the exchanges of a batch."""
        t, f = batch.transactions, batch.frames
        rows = np.flatnonzero((t.outcome == OK) & (t.request != -1) & (t.response >= 0))
        frames, asked = batch.asking(t.request[rows])
        reply = frames.reply[asked]
        free = (reply == Reply.OPTIONAL) | (reply == Reply.IF_ALL)
        if not free.any():
            return
        rows, asked = t.response[rows[free]], asked[free]
        who = (f.servo_id[rows].astype(np.int64) + 1) * OPS
        _count(self.counts, who + (frames.op[asked] & OPS - 1), f, rows, batch.base)

    def counted(self) -> dict[str, I64]:
        """Return the counts as columns, with ``servo_id`` and ``op`` (its last 32 bits)."""
        key, columns = self.counts.table()
        return {**columns, "op": key % OPS, "servo_id": key // OPS - 1}


class UnansweredReads:
    """Counts by servo the reads that nobody answers, because it was told so."""

    def __init__(self) -> None:
        self.counts = Buckets(_COLUMNS)

    def add(self, batch: Batch) -> None:
        """Take the exchanges of a batch."""
        t = batch.transactions
        rows = np.flatnonzero((t.outcome == NOT_EXPECTED) & (t.request != -1))
        frames, asked = batch.asking(t.request[rows])
        asked = asked[frames.reply[asked] == IF_READ]
        if not len(asked):
            return
        who = frames.servo_id[asked].astype(np.int64)
        _count(self.counts, who, frames, asked, batch.base)

    def counted(self) -> dict[str, I64]:
        """Return the counts as columns, with ``servo_id``."""
        key, columns = self.counts.table()
        return {**columns, "servo_id": key}


def _count(counts: Buckets, key: I64, frames: Frames, rows: I64, base: int) -> None:
    """Count frames in by some key."""
    counts.add(
        key,
        n=1,
        at=frames.start[rows] + base,
        length=frames.length[rows],
        t_first=frames.t_end[rows],
        t_last=frames.t_end[rows],
    )
