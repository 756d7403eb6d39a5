"""Sums, extremes and ends by key, in columns: what is kept of traffic that nobody stores whole.

A row a key. All its columns are whole numbers, so that sums do not depend on how a stream was cut.
"""

from __future__ import annotations

import copy
import math
from typing import TYPE_CHECKING, Any, Final, Union

import numpy as np

from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sniffer.ground.model import I16, I64, Mask

Column = Union["I64", "Mask", int]
"""Numbers of rows, or one that all of them have."""

COMPACT: Final = 1 << 16
"""Rows that may wait to be joined: joining costs the more the oftener it is done."""

NARROW: Final = 1 << 16
"""Keys in so small a range are sorted by counting, ten times as fast; in its square in two goes."""

FEW: Final = 1 << 12
"""Fewer keys are sorted as fast by comparing them as in two goes."""


def in_groups(key: I64) -> tuple[I64, I64]:
    """Return the order that sorts rows by key, equal ones as they came, and where groups begin."""
    if not len(key):
        return np.empty(0, np.int64), np.empty(0, np.int64)
    low = int(key.min())
    width = int(key.max()) - low
    if width < NARROW:
        order = np.argsort((key - low).astype(np.uint16), kind="stable")
    elif len(key) > FEW and width < NARROW * NARROW:  # by their lower half, then by the upper
        halves = np.frombuffer((key - low).astype("<u4").tobytes(), "<u2").reshape(-1, 2)
        order = np.argsort(halves[:, 0], kind="stable")
        order = order[np.argsort(halves[order, 1], kind="stable")]
    else:
        order = np.argsort(key, kind="stable")
    ordered = key[order]
    begins = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1]]))
    return order, begins


BUCKET_NS: Final = NS // 4
"""A bucket of time: no cause is told from what is shorter, but for events, which have own times."""

SERVOS: Final = 512
"""Servos told apart in a bucket: ids are below 256, and nobody's is -1."""

FINE: Final = 1 << 14
"""So many buckets (68 minutes) stay as they are; those before are joined by ``COARSE``."""

COARSE: Final = 16

_REDUCE: Final[Mapping[str, Any]] = {
    "sum": np.add.reduceat,
    "min": np.minimum.reduceat,
    "max": np.maximum.reduceat,
}


class Buckets:
    """Rows by key, each column reduced in its way: ``sum``, ``min``, ``max``, ``first``, ``last``.

    ``first`` and ``last`` go by the order in which rows are added.
    """

    def __init__(self, columns: Mapping[str, str]) -> None:
        self._ways = dict(columns)
        self._parts: list[tuple[I64, dict[str, I64]]] = []
        self._waiting = 0

    def add(self, key: I64, **columns: Column) -> None:
        """Add rows; every column is given, one number where it is the same in all rows."""
        if not len(key):
            return
        part = self._reduced(key, columns)
        self._parts.append(part)
        self._waiting += len(part[0])
        if self._waiting > COMPACT + (len(self._parts[0][0]) if len(self._parts) > 1 else 0):
            self._compact()

    def rekey(self, renamed: I64) -> None:
        """Give rows, in the order of ``table``, other keys; those that become one are joined."""
        _, columns = self.table()
        self._parts = [self._reduced(renamed, columns)]
        self._waiting = len(self._parts[0][0])

    def copy(self) -> Buckets:
        """Return the same rows, to which others can be added."""
        out = Buckets(self._ways)
        out._parts, out._waiting = list(self._parts), self._waiting
        return out

    def table(self) -> tuple[I64, dict[str, I64]]:
        """Return the keys in order, and the columns."""
        self._compact()
        if not self._parts:
            none = np.empty(0, np.int64)
            return none, dict.fromkeys(self._ways, none)
        return self._parts[0]

    def _compact(self) -> None:
        if len(self._parts) > 1:
            key = np.concatenate([k for k, _ in self._parts])
            columns = {n: np.concatenate([c[n] for _, c in self._parts]) for n in self._ways}
            self._parts = [self._reduced(key, columns)]
        self._waiting = len(self._parts[0][0]) if self._parts else 0

    def _reduced(self, key: I64, columns: Mapping[str, Column]) -> tuple[I64, dict[str, I64]]:
        order, begins = in_groups(key)
        sizes = np.diff(np.append(begins, len(order)))
        firsts, lasts = order[begins], order[begins + sizes - 1]
        out: dict[str, I64] = {}
        sorted_: dict[int, Any] = {}  # putting a column in order takes longer than all the rest
        for name, way in self._ways.items():
            column = columns[name]
            if isinstance(column, int):
                out[name] = sizes * column if way == "sum" else np.full(len(begins), column)
            elif way == "first":
                out[name] = column[firsts].astype(np.int64)
            elif way == "last":
                out[name] = column[lasts].astype(np.int64)
            else:
                if id(column) not in sorted_:
                    sorted_[id(column)] = column[order]
                reduce = _REDUCE[way]
                out[name] = reduce(sorted_[id(column)], begins, dtype=np.int64)
        return key[firsts], out


class TimedBuckets:
    """Rows by quarter second, servo and what else is told apart; what is long past is joined.

    So a day takes no more room than some hours. ``within`` names what is told apart beside the
    servo, and how many numbers, from 0 on, each has.
    """

    def __init__(self, columns: Mapping[str, str], **within: int) -> None:
        self._rows = Buckets(columns)
        self._within = within
        self._width = SERVOS * math.prod(within.values())
        self._newest = 0
        self._joined_until: int | None = None

    def add(self, t_ns: I64, servo_id: I64 | I16, *within: I64, **columns: Column) -> None:
        """Add rows at their times; servo -1 is nobody."""
        if not len(t_ns):
            return
        bucket = t_ns // BUCKET_NS
        if self._joined_until is None:
            self._joined_until = int(bucket.min())
        key = bucket
        if int(bucket.min()) < self._joined_until:
            key = self._coarse(bucket)
        key = key * SERVOS + servo_id + 1
        for part, size in zip(within, self._within.values(), strict=True):
            key = key * size + part
        self._rows.add(key, **columns)
        self._newest = max(self._newest, int(bucket.max()))
        self._join_old(self._joined_until)

    def table(self) -> dict[str, I64]:
        """Return the columns, with ``bucket``, ``servo_id`` and the names of what is told apart."""
        key, columns = self._rows.table()
        out = dict(columns)
        for name, size in reversed(self._within.items()):
            out[name], key = key % size, key // size
        out["servo_id"], out["bucket"] = key % SERVOS - 1, key // SERVOS
        return out

    def copy(self) -> TimedBuckets:
        """Return the same, to which rows can be added that are not known for certain."""
        out = copy.copy(self)
        out._rows = self._rows.copy()
        return out

    def _join_old(self, begin: int) -> None:
        until = begin
        while self._newest - until >= 2 * FINE:
            until = (until + FINE) // COARSE * COARSE
        if until != begin:
            self._joined_until = until
            key, _ = self._rows.table()
            self._rows.rekey(self._coarse(key // self._width) * self._width + key % self._width)

    def _coarse(self, bucket: I64) -> I64:
        """Return the numbers that buckets have once they are joined."""
        return np.where(bucket < (self._joined_until or 0), bucket // COARSE * COARSE, bucket)
