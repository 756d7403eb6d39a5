"""Rules about answers: missing, damaged, late, unasked, ill-fitting, given twice."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from sniffer.anomalies.ambiguous import Ambiguity, Missed, Open, Span
from sniffer.anomalies.found import NUMBER, Anomalies
from sniffer.ground.codes import (
    DAMAGED,
    MISMATCHED,
    NO_RESPONSE,
    NOT_EXPECTED,
    OK,
    ON_ITS_OWN,
    OUTCOMES,
    UNSOLICITED,
)
from sniffer.ground.memory import Remembering
from sniffer.ground.model import ANY_ID, DEPTH
from sniffer.ground.wording import counted

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.anomalies.found import Told
    from sniffer.ground.model import I64, U8, Batch
    from sniffer.protocols.base import BusProtocol

LATE_SPAN_NS: Final = 3_000_000_000
"""An unasked answer this long after an unanswered request is still taken for its answer: the
longest time-out met in clients (wCK's original library waits 3 s)."""

LATE_SPAN: Final = 1 << 17
"""And no further behind it, in bytes: as much as a line of 430 kbit/s has room for in that time. On
a faster one that is never quiet such an answer is taken for unasked."""

_CODE: Final = np.array(
    [
        NUMBER[
            {
                NO_RESPONSE: "no-response",
                DAMAGED: "damaged-response",
                MISMATCHED: "mismatched-response",
                UNSOLICITED: "unsolicited-response",
            }.get(outcome, "late-response")
        ]
        for outcome in range(len(OUTCOMES))
    ]
)
"""What each outcome is called; one that is well is only looked at where it is late."""


class _Wrong(NamedTuple):
    """Transactions that went wrong, in columns; places are absolute."""

    at: I64  # their rows
    request: I64  # the row that it stands in, of this batch
    response: I64
    outcome: U8
    op: I64
    servo_id: I64
    asked: I64
    asked_length: I64
    answered: I64
    answered_length: I64
    t_ns: I64

    def span(self, i: int) -> Span:
        """Return where a request stands."""
        return self.asked.item(i), self.asked_length.item(i)

    def answer(self, i: int) -> Span:
        """Return where an answer stands."""
        return self.answered.item(i), self.answered_length.item(i)


class PairingRules(Remembering):
    """Remembers the last requests that stayed open, and the last answer."""

    PASSING = ("_open", "_last")
    PARTS = ("_ambiguity",)

    def __init__(self, protocol: BusProtocol) -> None:
        self._protocol = protocol
        self._open: deque[Open] = deque(maxlen=DEPTH)
        self._last: tuple[int, Span] | None = None
        self._names: dict[int, str] = {}
        self._ambiguity = Ambiguity(protocol)

    def matters(self, at: int) -> Mapping[str, Any]:
        """Return the requests that may still be answered late, and an answer that ends here."""
        last = self._last if self._last is not None and sum(self._last[1]) >= at else None
        return {"open": [o for o in self._open if self._may_be_late(o, at)], "last": last}

    def judge(self, batch: Batch) -> Sequence[Anomalies]:
        """Report the transactions that went wrong, and answers beyond their window."""
        found = self._judge(batch) if len(batch.transactions) else ()
        self._ambiguity.forget(batch)
        return found

    def _judge(self, batch: Batch) -> Sequence[Anomalies]:
        t = batch.transactions
        late = self._late(batch)
        wrong = (t.outcome != OK) & (t.outcome != NOT_EXPECTED)
        if len(late):
            wrong[late] = True
        answered = t.response[t.outcome == OK]
        wrong_rows = np.flatnonzero(wrong)
        unasked = t.outcome[wrong_rows] == UNSOLICITED
        own = batch.frames.token[t.response[wrong_rows]] == ON_ITS_OWN
        wrong_rows = wrong_rows[~(unasked & own)]
        out = []
        # Before the batch's own: telling these may put some of those out.
        before = [o for o in self._open if self._may_be_open(o, batch.base)]
        missed = Missed(before, *self._places(before), np.empty(0, np.int64), _nothing)
        if len(wrong_rows):
            rows = self._rows(batch, wrong_rows)
            mine = np.flatnonzero((rows.outcome == NO_RESPONSE) | (rows.outcome == DAMAGED))
            missed = self._missed(batch, before, rows, mine)
            out.append(self._told(batch, rows, mine, missed, answered))
        if len(answered):
            self._last = self._answer(batch, int(answered.max()))
            out.append(Anomalies.of([*self._ambiguity.judge(batch, missed)]))
        return out

    @staticmethod
    def _places(still: Sequence[Open]) -> tuple[I64, I64, I64]:
        """Return end, servo and token of requests."""
        return (
            np.array([sum(s.span) for s in still], np.int64),
            np.array([s.servo_id for s in still], np.int64),
            np.array([s.token for s in still], np.int64),
        )

    def _missed(self, batch: Batch, before: Sequence[Open], rows: _Wrong, mine: I64) -> Missed:
        """Put the requests of a batch that nobody answered behind those of before."""
        f, row = batch.frames, rows.request[mine]
        asked = batch.asked(batch.transactions.request[rows.at[mine]])
        who = np.where(asked.alt_id == ANY_ID, -1, rows.servo_id[mine])
        end, servo_id, token = self._places(before)

        def make(k: int) -> Open:
            i, q = int(mine[k]), int(row[k])
            start = int(f.start[q])
            raw = batch.data[start : start + int(f.length[q])]
            op = self._op(int(rows.op[i]))
            return Open(int(who[k]), int(asked.token[k]), int(f.t_end[q]), op, rows.span(i), raw)

        return Missed(
            before,
            np.concatenate([end, (rows.asked + rows.asked_length)[mine]]),
            np.concatenate([servo_id, who]),
            np.concatenate([token, asked.token]),
            row,
            make,
        )

    def _told(
        self, batch: Batch, rows: _Wrong, mine: I64, missed: Missed, answered: I64
    ) -> Anomalies:
        """Return what went wrong, in columns; remember the requests that stay open."""
        code = _CODE[rows.outcome]
        who = rows.servo_id.copy()
        late = rows.outcome == OK
        who[late] = batch.frames.servo_id[rows.response[late]]
        both = (rows.outcome == MISMATCHED) | late
        known_at = np.where(both, np.maximum(rows.asked, rows.answered), rows.asked)
        at, length = rows.asked.copy(), rows.asked_length.copy()
        unasked = np.flatnonzero(rows.outcome == UNSOLICITED)
        at[unasked], length[unasked] = rows.answered[unasked], rows.answered_length[unasked]
        known_at[unasked] = rows.answered[unasked]
        twice: dict[int, Span] = {}
        after: dict[int, tuple[Open, int]] = {}
        if len(unasked):
            twice = self._twice(batch, rows, unasked, answered)
            for i, span in twice.items():
                code[i] = NUMBER["duplicate-response"]
                at[i], length[i] = span
            others = unasked[batch.frames.uncertainty[rows.response[unasked]] >= 0]
            after = self._after(
                batch, rows, [i for i in others.tolist() if i not in twice], mine, missed
            )
            code[list(after)] = NUMBER["late-response"]
        else:
            self._remember(missed, 0, len(mine))

        def tell(mine: Sequence[int]) -> list[Told]:
            columns = (rows.outcome, rows.op, rows.servo_id, rows.asked, rows.asked_length)
            out: list[Told] = []
            for i, outcome, op, servo, *asked in zip(
                mine, *(column[mine].tolist() for column in columns), strict=True
            ):
                if late[i]:  # one that asked all has no servo; who answered has
                    servo = int(who[i])
                name = f"servo {servo}" if servo >= 0 else "no servo"
                if outcome == NO_RESPONSE:
                    out.append((f"{name} did not answer {self._op(op)}", (tuple(asked),)))
                elif outcome == DAMAGED:
                    text = f"torn bytes where {name} should answer {self._op(op)}"
                    out.append((text, (tuple(asked),)))
                elif outcome == MISMATCHED:
                    text = self._misfit(batch, rows, i, self._op(op))
                    out.append((text, (tuple(asked), rows.answer(i))))
                elif outcome == UNSOLICITED:
                    out.append(_unasked(servo, rows.answer(i), twice.get(i), after.get(i)))
                else:
                    text = self._too_late(batch, rows, i, name, self._op(op))
                    out.append((text, (tuple(asked), rows.answer(i))))
            return out

        return Anomalies(code, rows.t_ns, who, at, length, known_at, tell)

    def _may_be_open(self, still: Open, offset: int) -> bool:
        return offset - sum(still.span) <= self._protocol.reach

    def _may_be_late(self, still: Open, offset: int) -> bool:
        return offset - sum(still.span) <= max(LATE_SPAN, self._protocol.reach)

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

    def _rows(self, batch: Batch, rows: I64) -> _Wrong:
        f, t = batch.frames, batch.transactions
        q, r = t.request[rows], t.response[rows]
        asked = batch.asked(np.where(q == -1, r, q))
        start = f.start + batch.base
        own = batch.rows_of(q)
        return _Wrong(
            rows,
            own,
            r,
            t.outcome[rows],
            asked.op,
            asked.servo_id.astype(np.int64),
            asked.start + batch.base,
            asked.length,
            start[r],
            f.length[r],
            f.t_end[np.where(r >= 0, r, own)],
        )

    def _op(self, op: int) -> str:
        name = self._names.get(op)
        if name is None:
            name = self._names[op] = self._protocol.op_name(op)
        return name

    def _too_late(self, batch: Batch, rows: _Wrong, i: int, name: str, op: str) -> str:
        t, row = batch.transactions, int(rows.at[i])
        took, spread = int(t.response_time_ns[row]) / 1e6, int(t.uncertainty_ns[row]) / 1e6
        asked = batch.asked(t.request[row : row + 1])
        window = int(self._protocol.window_ns(asked)[0]) / 1e6
        return (
            f"{name} answered {op} after {took:.2f} ms (± {spread:.2f}); "
            f"expected within {window:.2f} ms"
        )

    def _remember(self, missed: Missed, first: int, until: int) -> None:
        """Take the batch's own requests from one to another among those that stay open."""
        self._open.extend(missed.make(k) for k in range(max(first, until - DEPTH), until))

    def _answer(self, batch: Batch, r: int) -> tuple[int, Span]:
        f = batch.frames
        return int(f.servo_id[r]), (batch.base + int(f.start[r]), int(f.length[r]))

    def _misfit(self, batch: Batch, rows: _Wrong, i: int, op: str) -> str:
        f, r = batch.frames, int(rows.response[i])
        asked, got = int(rows.servo_id[i]), int(f.servo_id[r])
        if asked != got:
            return f"servo {asked} was asked ({op}), servo {got} answered"
        start, length = rows.answer(i)
        raw = batch.data[start - batch.base : start - batch.base + length]
        return (
            f"the answer of servo {got} does not fit {op}: "
            f"{counted(int(f.data_length[r]), 'data byte')}, {raw[:32].hex(' ').upper()}"
        )

    def _twice(self, batch: Batch, rows: _Wrong, unasked: I64, answered: I64) -> dict[int, Span]:
        """Return which answers stand right behind one of the same servo, and where that is."""
        f, r = batch.frames, rows.response[unasked]
        answers = np.zeros(len(f), bool)
        answers[answered] = True
        before = np.maximum(r - 1, 0)
        again = (r > 0) & answers[before] & (f.servo_id[before] == f.servo_id[r])
        again &= f.end[before] == f.start[r]
        out = {}
        if not r[0] and self._last is not None:
            who, span = self._last
            if who == f.servo_id[0] and sum(span) == rows.answered[unasked[0]]:
                out[int(unasked[0])] = span
        for i, k in zip(unasked[again].tolist(), before[again].tolist(), strict=True):
            out[i] = self._answer(batch, k)[1]
        return out

    def _after(
        self, batch: Batch, rows: _Wrong, unasked: Sequence[int], mine: I64, missed: Missed
    ) -> dict[int, tuple[Open, int]]:
        """Return which answers come late, to which request, and after how many ns.

        Each looks at the requests that stood open before it, and takes one of them away.
        """
        out: dict[int, tuple[Open, int]] = {}
        known = 0
        for i in unasked:
            until = int(np.searchsorted(mine, i))
            self._remember(missed, known, until)
            known = until
            found = self._late_for(batch, int(rows.response[i]))
            if found is not None:
                out[i] = found
                self._open.remove(found[0])
        self._remember(missed, known, len(mine))
        return out

    def _late_for(self, batch: Batch, r: int) -> tuple[Open, int] | None:
        """Return the latest request that this may be the late answer to, and how late it is."""
        f = batch.frames
        who, token = int(f.servo_id[r]), int(f.token[r])
        for still in reversed(self._open):
            took = int(f.t_start[r]) - still.t_ns
            fits = still.servo_id in (-1, who) and token in (-1, still.token)
            fits &= self._may_be_late(still, batch.base + int(f.start[r]))
            if fits and 0 < took <= LATE_SPAN_NS:
                return still, took
        return None


def _nothing(row: int) -> Open:
    raise IndexError(row)


def _unasked(who: int, span: Span, twice: Span | None, after: tuple[Open, int] | None) -> Told:
    """Tell of an answer that nothing asked for: a second one, a late one, or neither."""
    if twice is not None:
        return f"servo {who} answered twice in a row", (twice, span)
    if after is not None:
        still, took = after
        text = f"servo {who} answered {still.op} only after {took / 1e6:.2f} ms"
        return text, (span, still.span)
    name = f"servo {who}" if who >= 0 else "a servo"
    return f"{name} answered, but nothing was asked", (span,)
