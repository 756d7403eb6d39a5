"""What is rare and told apart one by one: anomalies, settings that change, remarks of the tap.

Of each kind the first and the latest are kept; how many there were in all stands in the buckets.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.ledger.buckets import in_groups
from sniffer.ground.columnar import Columns

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.model import I64, Remark

ANOMALY, SETTING, REMARK = range(3)
"""``Happenings.kind``: ``what`` is a row of ``found.CODES``, a register, a ``MarkKind``."""

KEPT: Final = 1000
"""Of each kind and subject so many first and so many last ones."""

_WAIT: Final = 1 << 15


@dataclass(frozen=True, slots=True)
class Happenings(Columns):
    """Rows in the order of the stream; ``at`` is absolute.

    Of a setting ``before`` and ``after`` are raw values (before -1: not known), and ``written``
    tells whether a request stated it (1) or an answer (0). Of a remark ``after`` is its count.
    """

    kind: I64
    what: I64
    servo_id: I64
    t_ns: I64
    at: I64
    length: I64
    before: I64
    after: I64
    written: I64


def happened(kind: int, what: I64, servo_id: I64, t_ns: I64, at: I64, length: I64) -> Happenings:
    """Return rows without the columns that only settings have."""
    n = len(what)
    none = np.full(n, -1, np.int64)
    of = np.full(n, kind, np.int64)
    return Happenings(of, what, servo_id, t_ns, at, length, none, none, np.zeros(n, np.int64))


def remarked(remarks: Sequence[Remark]) -> Happenings:
    """Return what the tap remarked as rows, with its counts."""
    rows = np.array([(int(r.kind), r.t_ns, r.start, r.length, r.count) for r in remarks], np.int64)
    kind, t_ns, at, length, count = rows.T
    nobody = np.full(len(rows), -1, np.int64)
    return happened(REMARK, kind, nobody, t_ns, at, length).having(after=count)


class Events:
    """Keeps the first and the latest of each kind."""

    def __init__(self) -> None:
        self._parts: list[Happenings] = []
        self._waiting = 0

    def add(self, rows: Happenings) -> None:
        """Add rows in the order of the stream."""
        if len(rows):
            self._parts.append(rows)
            self._waiting += len(rows)
            if self._waiting > _WAIT:
                self.rows()

    def copy(self) -> Events:
        """Return the same rows, to which others can be added."""
        out = Events()
        out._parts, out._waiting = list(self._parts), self._waiting
        return out

    def sort(self) -> None:
        """Put rows that came later than their place in the stream where they belong."""
        if self._parts:
            rows = Happenings.concat(self._parts)
            self._parts = [rows.take(np.lexsort((rows.at, rows.kind)))]

    def rows(self) -> Happenings:
        """Return what is kept: by kind, and each in the order of the stream."""
        if not self._parts:
            return Happenings.empty()
        rows = Happenings.concat(self._parts)
        key = rows.kind << 32 | rows.what
        order, begins = in_groups(key)
        sizes = np.diff(np.append(begins, len(order)))
        rank = np.arange(len(order)) - np.repeat(begins, sizes)
        kept = (rank < KEPT) | (np.repeat(sizes, sizes) - rank <= KEPT)
        # Kinds of one pass come one after the other: in order they are only among themselves.
        kept_rows = np.sort(order[kept])
        rows = rows.take(kept_rows[np.argsort(rows.kind[kept_rows], kind="stable")])
        self._parts, self._waiting = [rows], 0
        return rows
