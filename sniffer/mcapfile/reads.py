"""What frames made known of servos, and which of it shares a message: what came in one read.

A message of its own costs its head and mostly 16 bytes of index beside what it says, and most reads
bring both what a servo was told and what it answered. All that came in one read has one log time,
so a plot over it shows the same. A value is never left out: where a read brings a field twice there
are two messages.

The reads are those that the recording has, however they were decoded: live, again, or in parts. So
what came in a read that is not decoded to its end waits for the rest.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Final, Self

import numpy as np

if TYPE_CHECKING:
    from sniffer.ground.model import F64, I64

_ROWS: Final = 7
"""So many columns of what is known have a row a frame and servo; the others have one a value."""

_FEW: Final = 128
"""So many rows and fewer are gone through one by one: a step for all at once takes as long."""

_BITS: Final = 62
"""Fields are told apart by their numbers modulo this: two that are taken for one only cost a
message."""


@dataclass(frozen=True, slots=True)
class ReadValues:
    """What single frames made known, a row for each servo that a frame is about, in their order.

    ``read`` is the offset behind the read in which a frame ended, -1: nobody knows, and it shares
    nothing. ``took`` is the response time, -1: none. Values are columns of their own: of which
    ``row``, of which ``field``.
    """

    servo: I64
    read: I64
    log: I64
    publish: I64
    offset: I64
    kind: I64
    took: I64
    row: I64
    field: I64
    value: F64

    def __len__(self) -> int:
        return len(self.servo)

    @classmethod
    def none(cls) -> Self:
        """Return no rows."""
        n = np.empty(0, np.int64)
        return cls(n, n, n, n, n, n, n, n, n, np.empty(0))

    def part(self, begin: int, end: int) -> ReadValues:
        """Return the rows from one to another, with their values."""
        first, behind = np.searchsorted(self.row, [begin, end]).tolist()
        rows = {f.name: getattr(self, f.name)[begin:end] for f in fields(self)[:_ROWS]}
        row = self.row[first:behind] - begin
        field, value = self.field[first:behind], self.value[first:behind]
        return ReadValues(**rows, row=row, field=field, value=value)

    def then(self, more: ReadValues) -> ReadValues:
        """Return these rows and others behind them."""
        if not len(self):
            return more
        if not len(more):
            return self
        more = replace(more, row=more.row + len(self))
        both = ((getattr(self, f.name), getattr(more, f.name)) for f in fields(self))
        return ReadValues(*map(np.concatenate, both))

    def messages(self) -> tuple[I64, I64]:
        """Return the number of each row's message, and the last row of each message.

        Rows share one as long as they are of one servo and one read and have no field in common.
        Messages are in the order of their last rows.

        Of one servo in one read: goal | position, load | goal | goal | position. The first two
        share a message, the third begins the next, the fourth another one, with the fifth.
        """
        # ids are small, and numbers of 16 bits are sorted by counting
        order = np.argsort(self.servo.astype(np.int16), kind="stable")
        servo, read, has = self.servo[order], self.read[order], self._fields()[order]
        fresh = np.ones(len(order), bool)
        fresh[1:] = (servo[1:] != servo[:-1]) | (read[1:] != read[:-1]) | (read[1:] < 0)
        start = np.flatnonzero(fresh)
        count = np.diff(start, append=len(order))
        # all first rows of a servo in a read at once, then all second ones, and so on
        many = count > 1
        at, left, had = start[many], count[many] - 1, has[start[many]]
        while len(at) > _FEW:
            at = at + 1
            there = has[at]
            again = (had & there) != 0
            fresh[at] = again
            more = left > 1
            had = np.where(again, there, had | there)[more]
            at, left = at[more], left[more] - 1
        begins: list[int] = []
        for k, rows, seen in zip((at + 1).tolist(), left.tolist(), had.tolist(), strict=True):
            for nth, bits in enumerate(has[k : k + rows].tolist(), k):
                if seen & bits:
                    begins.append(nth)
                    seen = bits
                else:
                    seen |= bits
        fresh[begins] = True
        last = order[np.append(np.flatnonzero(fresh)[1:], len(order)) - 1]
        is_last = np.zeros(len(order), bool)
        is_last[last] = True
        place = (np.cumsum(is_last) - 1)[last]
        message = np.empty(len(order), np.int64)
        message[order] = place[np.cumsum(fresh) - 1]
        return message, np.flatnonzero(is_last)

    def _fields(self) -> I64:
        """Return which fields each row has, in bits."""
        first = np.flatnonzero(np.diff(self.row, prepend=-1))
        bit = np.int64(1) << (np.arange(self.field.max(initial=0) + 1) % _BITS)
        bits = np.bitwise_or.reduceat(bit[self.field], first)
        return np.asarray(bits | (self.took >= 0).astype(np.int64) << _BITS, np.int64)
