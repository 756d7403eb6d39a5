"""Rules about answers: missing, damaged, late, unasked, ill-fitting, given twice."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.diagnostics.rules import anomaly
from sniffer.ground.model import (
    ANY_ID,
    DAMAGED,
    DEPTH,
    MISMATCHED,
    NO_RESPONSE,
    NOT_EXPECTED,
    OK,
    UNSOLICITED,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.ground.model import I64, Anomaly, Batch, Frames, Mask
    from sniffer.protocols.base import BusProtocol

Span = tuple[int, int]

LATE_SPAN_NS: Final = 3_000_000_000
"""An unasked answer this long after an unanswered request is still taken for its answer: the
longest time-out met in clients (wCK's original library waits 3 s)."""


class _Row(NamedTuple):
    """One transaction that went wrong, as plain numbers; spans are absolute."""

    at: int  # its row
    request: int
    response: int
    outcome: int
    op: int
    servo_id: int
    asked: Span
    answered: Span
    t_ns: int


@dataclass(frozen=True, slots=True)
class _Open:
    """A request nobody answered in time: its answer may still come, late."""

    servo_id: int
    token: int
    t_ns: int
    op: str
    span: Span
    raw: bytes


class _Answered(NamedTuple):
    """Requests that were answered, in wire order, as rows of ``asking``, and their answers."""

    base: int
    asking: Frames
    asked: I64
    answer: I64

    @property
    def start(self) -> I64:
        """Where each begins, absolute."""
        return self.asking.start[self.asked] + self.base

    def span(self, k: int) -> Span:
        """Return the span of one, absolute."""
        q = int(self.asked[k])
        return int(self.asking.start[q]) + self.base, int(self.asking.length[q])


class PairingRules:
    """Remembers the last requests that stayed open, and the last answer."""

    def __init__(self, protocol: BusProtocol) -> None:
        self._protocol = protocol
        self._open: deque[_Open] = deque(maxlen=DEPTH)
        self._last: tuple[int, Span] | None = None
        self._answers: Mask = np.empty(0, bool)  # which frames of the batch answer a request
        self._names: dict[int, str] = {}
        self._tail = b""  # before the batch: requests of it that are answered later begin there
        self._most = max(protocol.reach, 0) + protocol.longest

    def judge(self, batch: Batch) -> Iterator[Anomaly]:
        """Report the transactions that went wrong, and answers beyond their window."""
        yield from self._judge(batch)
        data = batch.data if len(batch.data) >= self._most else self._tail + batch.data
        self._tail = data[-self._most :]

    def _judge(self, batch: Batch) -> Iterator[Anomaly]:
        t = batch.transactions
        if not len(t):
            return
        late = self._late(batch)
        wrong = (t.outcome != OK) & (t.outcome != NOT_EXPECTED)
        if len(late):
            wrong[late] = True
        answered = t.response[t.outcome == OK]
        wrong_rows = np.flatnonzero(wrong)
        if len(wrong_rows):
            self._answers = np.zeros(len(batch.frames), bool)
            self._answers[answered] = True
        missed: list[_Open] = [o for o in self._open if self._may_be_open(o, batch.base)]
        for row in self._rows(batch, wrong_rows) if len(wrong_rows) else ():
            yield self._one(batch, row)
            if row.outcome in (NO_RESPONSE, DAMAGED):
                missed.append(self._open[-1])
        if len(answered):
            self._last = self._answer(batch, int(answered.max()))
            yield from self._unsure(batch, missed)

    def _may_be_open(self, still: _Open, offset: int) -> bool:
        return offset - sum(still.span) <= self._protocol.reach

    def _unsure(self, batch: Batch, missed: Sequence[_Open]) -> Iterator[Anomaly]:
        """Report answers that a request without one may have had as well as the one that got it.

        That is a later one to the same servo that asked for something else of the same length; or,
        where answers name nobody, one that stands before the same answer in one unbroken row.
        """
        if not missed:
            return
        t = batch.transactions
        rows = np.flatnonzero((t.outcome == OK) & (t.request != -1))
        asking, at = batch.asking(t.request[rows])
        order = np.argsort(asking.start[at], kind="stable")
        told: set[int] = set()
        later = _Answered(batch.base, asking, at[order], t.response[rows][order])
        pairs = self._in_a_row if self._protocol.ordered else self._alike
        for still, k in pairs(batch, missed, later, told):
            q, r = int(later.asked[k]), int(later.answer[k])
            if r not in told and not self._given_up(still, asking.take(slice(q, q + 1))):
                told.add(r)
                yield self._either(batch, r, still, later.span(k))

    def _in_a_row(
        self, batch: Batch, missed: Sequence[_Open], later: _Answered, told: set[int]
    ) -> Iterator[tuple[_Open, int]]:
        """Yield each missed request with those that stand behind it without a gap."""
        start = later.start
        end = np.array([sum(still.span) for still in missed])
        first = np.searchsorted(start, end)
        at = np.minimum(first, len(start) - 1)
        for i in np.flatnonzero((first < len(start)) & (start[at] == end)).tolist():
            still, until = missed[i], int(end[i])
            for k in range(int(first[i]), min(int(first[i]) + DEPTH, len(start))):
                if start[k] != until or int(later.answer[k]) in told:
                    break
                if not self._differs(batch, still, later, k):
                    break
                until = sum(later.span(k))
                yield still, k

    def _alike(
        self, batch: Batch, missed: Sequence[_Open], later: _Answered, _told: set[int]
    ) -> Iterator[tuple[_Open, int]]:
        """Yield each missed request with the later ones whose answer would fit it too."""
        reach = self._protocol.reach
        end = np.array([sum(still.span) for still in missed])
        first = np.searchsorted(later.start, end)
        last = np.searchsorted(later.start, end + max(reach, 0), "right")
        many = np.minimum(last - first, DEPTH)
        of = np.repeat(np.arange(len(missed)), many)
        k = np.arange(len(of)) - np.repeat(np.cumsum(many) - many, many) + first[of]
        who = np.array([still.servo_id for still in missed])
        token = np.array([still.token for still in missed])
        asked = later.asked[k]
        fits = (later.asking.servo_id[asked] == who[of]) & (later.asking.token[asked] == token[of])
        fits &= batch.frames.start[later.answer[k]] + batch.base - end[of] <= reach
        for i, place in zip(of[fits].tolist(), k[fits].tolist(), strict=True):
            if self._differs(batch, missed[i], later, place):
                yield missed[i], place

    def _differs(self, batch: Batch, still: _Open, later: _Answered, k: int) -> bool:
        """Tell whether a later request asked for something else."""
        start, length = later.span(k)
        start -= batch.base
        data = batch.data
        if start < 0:
            start, data = start + len(self._tail), self._tail
        return data[start : start + length] != still.raw

    def _given_up(self, still: _Open, asked: Frames) -> bool:
        """Tell whether the controller waited out the earlier request before it sent another."""
        pause = int(asked.t_start[0]) - still.t_ns - max(int(asked.uncertainty[0]), 0)
        return pause > int(self._protocol.window_ns(asked)[0])

    def _either(self, batch: Batch, r: int, still: _Open, asked: Span) -> Anomaly:
        who, span = self._answer(batch, r)
        f = batch.frames
        op = self._op(int(f.op[r]))
        text = (
            f"one answer to two requests: taken for that to the later one ({op}); it may be that "
            f"to the earlier one ({still.op}), and what it says then stands under a wrong name"
        )
        return anomaly("ambiguous-response", int(f.t_end[r]), who, text, still.span, asked, span)

    def _late(self, batch: Batch) -> I64:
        """Return the rows answered beyond their window, by more than the clock is unsure."""
        t = batch.transactions
        known = np.flatnonzero((t.outcome == OK) & (t.response_time_ns >= 0))
        if not len(known):
            return known
        asked, answer = t.request[known], t.response[known]
        window = self._protocol.window_ns(batch.asked(asked))
        took = t.response_time_ns[known] - t.uncertainty_ns[known]
        f = batch.frames
        if batch.slower_ns:  # a slower line takes longer for the answer itself
            took = took - f.length[answer] * batch.slower_ns
        # Nobody can answer while another one speaks: the time counts from when the line was free.
        waits = np.flatnonzero((answer > 0) & (asked != answer - 1))
        free = (
            f.t_start[answer[waits]] - f.t_end[answer[waits] - 1] - t.uncertainty_ns[known[waits]]
        )
        took[waits] = np.minimum(took[waits], free)
        return known[took > window]

    def _rows(self, batch: Batch, rows: I64) -> Iterator[_Row]:
        f, t = batch.frames, batch.transactions
        q, r = t.request[rows], t.response[rows]
        last = np.where(r >= 0, r, q)
        asked = batch.asked(np.where(q == -1, r, q))
        op, who = asked.op, asked.servo_id
        start = f.start + batch.base
        columns = (
            rows,
            q,
            r,
            t.outcome[rows],
            op,
            who,
            asked.start + batch.base,
            asked.length,
            start[r],
            f.length[r],
            f.t_end[last],
        )
        for at, one, two, outcome, op, who, s1, n1, s2, n2, t_ns in zip(
            *(c.tolist() for c in columns), strict=True
        ):
            yield _Row(at, one, two, outcome, op, who, (s1, n1), (s2, n2), t_ns)

    def _op(self, op: int) -> str:
        name = self._names.get(op)
        if name is None:
            name = self._names[op] = self._protocol.op_name(op)
        return name

    def _one(self, batch: Batch, row: _Row) -> Anomaly:
        op, who = self._op(row.op), row.servo_id
        name = f"servo {who}" if who >= 0 else "no servo"
        match row.outcome:
            case outcome if outcome in (NO_RESPONSE, DAMAGED):
                self._remember(batch, row, op)
                if outcome == NO_RESPONSE:
                    text = f"{name} did not answer {op}"
                    return anomaly("no-response", row.t_ns, who, text, row.asked)
                text = f"torn bytes where {name} should answer {op}"
                return anomaly("damaged-response", row.t_ns, who, text, row.asked)
            case outcome if outcome == MISMATCHED:
                text = self._misfit(batch, row, op)
                return anomaly("mismatched-response", row.t_ns, who, text, row.asked, row.answered)
            case outcome if outcome == UNSOLICITED:
                return self._unasked(batch, row)
            case _:
                return self._too_late(batch, row, name, op)

    def _too_late(self, batch: Batch, row: _Row, name: str, op: str) -> Anomaly:
        f, t = batch.frames, batch.transactions
        took, spread = int(t.response_time_ns[row.at]) / 1e6, int(t.uncertainty_ns[row.at]) / 1e6
        asked = batch.asked(np.array([row.request]))
        window = int(self._protocol.window_ns(asked)[0]) / 1e6
        text = (
            f"{name} answered {op} after {took:.2f} ms (± {spread:.2f}); "
            f"expected within {window:.2f} ms"
        )
        who = int(f.servo_id[row.response])
        return anomaly("late-response", row.t_ns, who, text, row.asked, row.answered)

    def _remember(self, batch: Batch, row: _Row, op: str) -> None:
        f, q = batch.frames, row.request
        who = -1 if f.alt_id[q] == ANY_ID else row.servo_id
        raw = batch.data[int(f.start[q]) : int(f.start[q] + f.length[q])]
        open_ = _Open(who, int(f.token[q]), int(f.t_end[q]), op, row.asked, raw)
        self._open.append(open_)

    def _answer(self, batch: Batch, r: int) -> tuple[int, Span]:
        f = batch.frames
        return int(f.servo_id[r]), (batch.base + int(f.start[r]), int(f.length[r]))

    def _misfit(self, batch: Batch, row: _Row, op: str) -> str:
        f = batch.frames
        asked, got = row.servo_id, int(f.servo_id[row.response])
        if asked != got:
            return f"servo {asked} was asked ({op}), servo {got} answered"
        start, length = row.answered
        raw = batch.data[start - batch.base : start - batch.base + length]
        return (
            f"the answer of servo {got} does not fit {op}: "
            f"{int(f.data_length[row.response])} data bytes, {raw[:32].hex(' ').upper()}"
        )

    def _unasked(self, batch: Batch, row: _Row) -> Anomaly:
        f = batch.frames
        who, r = row.servo_id, row.response
        last = self._last
        if r and self._answers[r - 1]:
            last = self._answer(batch, r - 1)
        if last is not None and last[0] == who and sum(last[1]) == row.answered[0]:
            text = f"servo {who} answered twice in a row"
            return anomaly("duplicate-response", row.t_ns, who, text, last[1], row.answered)
        if int(f.uncertainty[r]) >= 0 and (found := self._late_for(batch, r)) is not None:
            still, took = found
            self._open.remove(still)
            text = f"servo {who} answered {still.op} only after {took / 1e6:.2f} ms"
            return anomaly("late-response", row.t_ns, who, text, row.answered, still.span)
        name = f"servo {who}" if who >= 0 else "a servo"
        text = f"{name} answered, but nothing was asked"
        return anomaly("unsolicited-response", row.t_ns, who, text, row.answered)

    def _late_for(self, batch: Batch, r: int) -> tuple[_Open, int] | None:
        """Return the latest request that this may be the late answer to, and how late it is."""
        f = batch.frames
        who, token = int(f.servo_id[r]), int(f.token[r])
        for still in reversed(self._open):
            took = int(f.t_start[r]) - still.t_ns
            fits = still.servo_id in (-1, who) and token in (-1, still.token)
            if fits and 0 < took <= LATE_SPAN_NS:
                return still, took
        return None
