"""Rules about answers: missing, damaged, late, unasked, ill-fitting, given twice."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.diagnostics.rules import anomaly
from sniffer.model import (
    ANY_ID,
    DAMAGED,
    MISMATCHED,
    NO_RESPONSE,
    NOT_EXPECTED,
    OK,
    UNSOLICITED,
    Clock,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.model import I64, Anomaly, Batch
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


@dataclass(slots=True)
class _Open:
    """The last request nobody answered in time: its answer may still come, late."""

    servo_id: int
    token: int
    t_ns: int
    op: str
    span: Span


class PairingRules:
    """Remembers the last request that stayed open, and the last answer."""

    def __init__(self, protocol: BusProtocol) -> None:
        self._protocol = protocol
        self._open: _Open | None = None
        self._last: tuple[int, Span] | None = None
        self._begun = False
        self._names: dict[int, str] = {}

    def judge(self, batch: Batch) -> Iterator[Anomaly]:
        """Report the transactions that went wrong, and answers beyond their window."""
        t = batch.transactions
        if not len(t):
            return
        late = self._late(batch)
        wrong = (t.outcome != OK) & (t.outcome != NOT_EXPECTED)
        if len(late):
            wrong[late] = True
        for row in self._rows(batch, np.flatnonzero(wrong)):
            yield self._one(batch, row)
            self._begun = True
        self._begun = True
        answered = np.flatnonzero(t.outcome == OK)
        if len(answered):
            self._last = self._answer(batch, int(t.response[answered[-1]]))

    def _late(self, batch: Batch) -> I64:
        """Return the rows answered beyond their window, by more than the clock is unsure."""
        t = batch.transactions
        known = np.flatnonzero((t.outcome == OK) & (t.response_time_ns >= 0))
        if not len(known):
            return known
        window = self._protocol.window_ns(batch.frames.take(t.request[known]))
        took = t.response_time_ns[known] - t.uncertainty_ns[known]
        if batch.slower_ns:  # a slower line takes longer for the answer itself
            took = took - batch.frames.length[t.response[known]] * batch.slower_ns
        return known[took > window]

    def _rows(self, batch: Batch, rows: I64) -> Iterator[_Row]:
        f, t = batch.frames, batch.transactions
        q, r = t.request[rows], t.response[rows]
        told, last = np.where(q >= 0, q, r), np.where(r >= 0, r, q)
        start = f.start + batch.base
        columns = (
            rows,
            q,
            r,
            t.outcome[rows],
            f.op[told],
            f.servo_id[told],
            start[q],
            f.length[q],
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
        asked = f.take(slice(row.request, row.request + 1))
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
        self._open = _Open(who, int(f.token[q]), int(f.t_end[q]), op, row.asked)

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
        f, t = batch.frames, batch.transactions
        who, r = row.servo_id, row.response
        if batch.clock == Clock.READ and not (self._begun or row.at):
            text = "the tap was started between a request and its answer"
            return anomaly("capture-start", row.t_ns, who, text, row.answered)
        last = self._last
        if row.at and t.outcome[row.at - 1] == OK:
            last = self._answer(batch, int(t.response[row.at - 1]))
        if last is not None and last[0] == who and sum(last[1]) == row.answered[0]:
            text = f"servo {who} answered twice in a row"
            return anomaly("duplicate-response", row.t_ns, who, text, last[1], row.answered)
        still = self._open
        if still is not None and int(f.uncertainty[r]) >= 0:
            took = int(f.t_start[r]) - still.t_ns
            fits = still.servo_id in (-1, who) and int(f.token[r]) in (-1, still.token)
            if fits and 0 < took <= LATE_SPAN_NS:
                self._open = None
                text = f"servo {who} answered {still.op} only after {took / 1e6:.2f} ms"
                return anomaly("late-response", row.t_ns, who, text, row.answered, still.span)
        name = f"servo {who}" if who >= 0 else "a servo"
        text = f"{name} answered, but nothing was asked"
        return anomaly("unsolicited-response", row.t_ns, who, text, row.answered)
