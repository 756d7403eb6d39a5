"""One answer, and two requests that it may be to: nobody can tell, so it is said."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sniffer.anomalies.rules import anomaly
from sniffer.ground.codes import OK
from sniffer.ground.distinct import numbers
from sniffer.ground.memory import Remembering
from sniffer.ground.model import DEPTH

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from sniffer.ground.model import I64, Anomaly, Batch, Frames, Mask
    from sniffer.protocols.base import BusProtocol

Span = tuple[int, int]


class Open(NamedTuple):
    """A request nobody answered in time: its answer may still come, late."""

    servo_id: int
    token: int
    t_ns: int
    op: str
    span: Span
    raw: bytes


class _Answered(NamedTuple):
    """Requests that were answered, in wire order, as rows of ``asking``, and their answers.

    ``start`` is where each begins, absolute.
    """

    base: int
    asking: Frames
    asked: I64
    start: I64
    answer: I64

    def span(self, k: int) -> Span:
        """Return the span of one, absolute."""
        q = int(self.asked[k])
        return int(self.asking.start[q]) + self.base, int(self.asking.length[q])


class Missed(NamedTuple):
    """Requests without an answer, in wire order: those still open of before, and a batch's own.

    Where each ends (absolute), its servo and its token are columns; ``make`` tells one of the
    batch's own, counted from the first of them, and ``row`` is its row of the batch's frames.
    """

    before: Sequence[Open]
    end: I64
    servo_id: I64
    token: I64
    row: I64
    make: Callable[[int], Open]

    def one(self, i: int) -> Open:
        """Return one of them."""
        k = i - len(self.before)
        return self.before[i] if k < 0 else self.make(k)


class Ambiguity(Remembering):
    """Finds such answers batch after batch."""

    PASSING = ("_tail",)

    def __init__(self, protocol: BusProtocol) -> None:
        self._protocol = protocol
        self._tail = b""  # before the batch: requests of it that are answered later begin there
        self._most = max(protocol.reach, 0) + protocol.longest

    def forget(self, batch: Batch) -> None:
        """Keep what the next batch may still ask for."""
        data = batch.data if len(batch.data) >= self._most else self._tail + batch.data
        self._tail = data[-self._most :]

    def judge(self, batch: Batch, missed: Missed) -> Iterator[Anomaly]:
        """Report answers that a request without one may have had as well as the one that got it.

        That is a later one to the same servo that asked for something else of the same length; or,
        where answers name nobody, one that stands before the same answer in one unbroken row.
        """
        if not len(missed.end):
            return
        t = batch.transactions
        rows = np.flatnonzero((t.outcome == OK) & (t.request != -1))
        asking, at = batch.asking(t.request[rows])
        start, answer = asking.start[at] + batch.base, t.response[rows]
        if (start[1:] < start[:-1]).any():
            order = np.argsort(start, kind="stable")
            at, start, answer = at[order], start[order], answer[order]
        told: set[int] = set()
        later = _Answered(batch.base, asking, at, start, answer)
        pairs = self._in_a_row if self._protocol.ordered else self._alike
        for still, k in pairs(batch, missed, later, told):
            q, r = int(later.asked[k]), int(later.answer[k])
            if r not in told and not self._given_up(still, asking.take(slice(q, q + 1))):
                told.add(r)
                yield self._either(batch, r, still, later.span(k))

    def _in_a_row(
        self, batch: Batch, missed: Missed, later: _Answered, told: set[int]
    ) -> Iterator[tuple[Open, int]]:
        """Yield each missed request with those that stand behind it without a gap."""
        start, end = later.start, missed.end
        first = np.searchsorted(start, end)
        at = np.minimum(first, len(start) - 1)
        for i in np.flatnonzero((first < len(start)) & (start[at] == end)).tolist():
            still, until = missed.one(i), int(end[i])
            for k in range(int(first[i]), min(int(first[i]) + DEPTH, len(start))):
                if start[k] != until or int(later.answer[k]) in told:
                    break
                if not self._differs(batch, still, later, k):
                    break
                until = sum(later.span(k))
                yield still, k

    def _alike(
        self, batch: Batch, missed: Missed, later: _Answered, _told: set[int]
    ) -> Iterator[tuple[Open, int]]:
        """Yield each missed request with the later ones whose answer would fit it too."""
        reach, end = self._protocol.reach, missed.end
        first = np.searchsorted(later.start, end)
        last = np.searchsorted(later.start, end + max(reach, 0), "right")
        many = np.minimum(last - first, DEPTH)
        of = np.repeat(np.arange(len(end)), many)
        k = np.arange(len(of)) - np.repeat(np.cumsum(many) - many, many) + first[of]
        asked = later.asked[k]
        fits = (later.asking.servo_id[asked] == missed.servo_id[of]) & (
            later.asking.token[asked] == missed.token[of]
        )
        fits &= batch.frames.start[later.answer[k]] + batch.base - end[of] <= reach
        fits[fits] = ~_same(batch, missed, later, of[fits], k[fits])
        for i, place in zip(of[fits].tolist(), k[fits].tolist(), strict=True):
            still = missed.one(i)
            if self._differs(batch, still, later, place):
                yield still, place

    def _differs(self, batch: Batch, still: Open, later: _Answered, k: int) -> bool:
        """Tell whether a later request asked for something else."""
        start, length = later.span(k)
        start -= batch.base
        data = batch.data
        if start < 0:
            start, data = start + len(self._tail), self._tail
        return data[start : start + length] != still.raw

    def _given_up(self, still: Open, asked: Frames) -> bool:
        """Tell whether the controller waited out the earlier request before it sent another."""
        pause = int(asked.t_start[0]) - still.t_ns - max(int(asked.uncertainty[0]), 0)
        return pause > int(self._protocol.window_ns(asked)[0])

    def _either(self, batch: Batch, r: int, still: Open, asked: Span) -> Anomaly:
        f = batch.frames
        who, span = int(f.servo_id[r]), (batch.base + int(f.start[r]), int(f.length[r]))
        op = self._protocol.op_name(int(f.op[r]))
        text = (
            f"one answer to two requests: taken for that to the later one ({op}); it may be that "
            f"to the earlier one ({still.op}), and what it says then stands under a wrong name"
        )
        return anomaly("ambiguous-response", int(f.t_end[r]), who, text, still.span, asked, span)


def _same(batch: Batch, missed: Missed, later: _Answered, i: I64, k: I64) -> Mask:
    """Tell where a missed request and a later one, both of this batch, are the same bytes.

    Most are: who got no answer asks again. What is of an earlier batch is left to a closer look.
    """
    data = np.frombuffer(batch.data, np.uint8)
    asked = later.asked[k]
    one = i - len(missed.before)
    ours = np.flatnonzero((one >= 0) & (later.asking.start[asked] >= 0))
    same = np.zeros(len(i), bool)
    if not len(ours):
        return same
    f = batch.frames
    row, asked = missed.row[one[ours]], asked[ours]
    length = f.length[row]
    alike = length == later.asking.length[asked]
    for size in numbers(length[alike]).tolist():
        of = np.flatnonzero(alike & (length == size))
        steps = np.arange(size)
        first = data[f.start[row[of]][:, None] + steps]
        second = data[later.asking.start[asked[of]][:, None] + steps]
        same[ours[of]] = (first == second).all(axis=1)
    return same
