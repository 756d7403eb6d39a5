"""The requests of a pass in columns, behind those of earlier ones that are not over yet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.codes import DAMAGED, MISMATCHED, NO_RESPONSE
from sniffer.ground.columnar import Columns

if TYPE_CHECKING:
    from sniffer.ground.model import I64, U8, Batch, Mask
    from sniffer.protocols.base import BusProtocol

UNTOLD: Final = -1
"""The outcome of a request whose fate is not known yet."""


@dataclass(frozen=True, slots=True)
class Held(Columns):
    """Requests that are not over: what became of them is not told, or none came behind them.

    ``at`` is absolute; ``mark`` tells requests of one kind and length apart; ``window`` is the time
    for an answer, known of those that failed.
    """

    at: I64
    length: I64
    servo_id: I64
    unsure: I64
    mark: I64
    t_start: I64
    t_end: I64
    kind: I64
    outcome: I64
    answer_end: I64
    answer_at: I64
    answer_length: I64
    window: I64


class RequestRows:
    """Requests in order: those held, then those in the rows ``asks`` of a batch.

    What few ask for is looked up in the frames when it is asked for.
    """

    def __init__(self, batch: Batch, asks: I64, held: Held, kind: I64) -> None:
        f, n = batch.frames, len(asks)
        self._batch, self._asks, self._held = batch, asks, held
        self._first = len(held)
        self.t_start = np.concatenate([held.t_start, f.t_start[asks]])
        self.t_end = np.concatenate([held.t_end, f.t_end[asks]])
        self.kind = np.concatenate([held.kind, kind])
        self.outcome = np.concatenate([held.outcome, np.full(n, UNTOLD)])
        self.answer_end = np.concatenate([held.answer_end, np.full(n, -1)])
        self.answer_at = np.concatenate([held.answer_at, np.full(n, -1)])
        self.answer_length = np.concatenate([held.answer_length, np.zeros(n, np.int64)])
        self.window = np.concatenate([held.window, np.zeros(n, np.int64)])
        self._owes = np.full(len(self), -1)  # who failed to answer, as far as it is told

    def __len__(self) -> int:
        return len(self.t_start)

    def tell(self, batch: Batch, protocol: BusProtocol) -> None:
        """Note what became of requests."""
        t, f = batch.transactions, batch.frames
        place = np.full(len(f) + 1, -1)
        place[self._asks] = np.arange(self._first, len(self))
        row, own = t.request, batch.rows_of(t.request)
        here = place[np.maximum(own, -1)]
        if (row < -1).any() and self._first:  # of earlier passes
            earlier = np.flatnonzero((row < -1) & (own < 0))
            at = batch.asked(row[earlier]).start + batch.base
            held = np.minimum(np.searchsorted(self._held.at, at), self._first - 1)
            here[earlier] = np.where(self._held.at[held] == at, held, -1)
        told = np.flatnonzero(here >= 0)
        if (row < -1).any():
            # A request to a list is told of once a servo: the first that failed is told last.
            failed = has_failed(t.outcome[told])
            told = told[np.lexsort((np.where(failed, -told, told), failed))]
        here, response, outcome = here[told], t.response[told], t.outcome[told]
        self.outcome[here] = outcome
        self.answer_end[here] = np.where(response >= 0, f.t_end[np.maximum(response, 0)], -1)
        self.answer_length[here] = np.where(response >= 0, f.length[np.maximum(response, 0)], 0)
        at = f.start[np.maximum(response, 0)] + batch.base
        self.answer_at[here] = np.where(response >= 0, at, -1)
        wrong = np.flatnonzero(has_failed(outcome))
        if len(wrong):
            asked = batch.asked(row[told[wrong]])
            self.window[here[wrong]] = protocol.window_ns(asked)
            self._owes[here[wrong]] = asked.servo_id

    def places(self, rows: I64) -> I64:
        """Return where requests stand, absolute."""
        return self._look(rows, self._held.at, self._batch.frames.start, self._batch.base)

    def lengths(self, rows: I64) -> I64:
        """Return how many bytes they have."""
        return self._look(rows, self._held.length, self._batch.frames.length)

    def servos(self, rows: I64) -> I64:
        """Return whom they are for; of a list, who failed to answer."""
        named = self._batch.frames.servo_id.astype(np.int64)
        servo, owes = self._look(rows, self._held.servo_id, named), self._owes[rows]
        return np.where(owes >= 0, owes, servo)

    def unsure(self, rows: I64) -> I64:
        """Return how unsure their times are, in ns."""
        return np.maximum(self._look(rows, self._held.unsure, self._batch.frames.uncertainty), 0)

    def marks(self, rows: I64) -> I64:
        """Return a number of each one's last eight bytes: equal requests have equal ones.

        Kind, length and what stands at the end, the checksum among it, tell two requests apart.
        """
        new = rows >= self._first
        out = np.empty(len(rows), np.int64)
        out[~new] = self._held.mark[rows[~new]]
        if new.any():
            f, mine = self._batch.frames, self._asks[rows[new] - self._first]
            out[new] = last_bytes(self._batch.data, f.start[mine], f.length[mine])
        return out

    def same(self, rows: I64) -> Mask:
        """Tell which are said once more, byte for byte, by the next one."""
        out: Mask = self.kind[rows] == self.kind[rows + 1]
        some = np.flatnonzero(out)
        a = rows[some]
        out[some] = (self.lengths(a) == self.lengths(a + 1)) & (self.marks(a) == self.marks(a + 1))
        return out

    def behind(self, many: int) -> Held:
        """Return the requests from one on, to be held until more is known."""
        rows = np.arange(many, len(self))
        return Held(
            self.places(rows),
            self.lengths(rows),
            self.servos(rows),
            self.unsure(rows),
            self.marks(rows),
            self.t_start[many:],
            self.t_end[many:],
            self.kind[many:],
            self.outcome[many:],
            self.answer_end[many:],
            self.answer_at[many:],
            self.answer_length[many:],
            self.window[many:],
        )

    def _look(self, rows: I64, held: I64, column: I64, more: int = 0) -> I64:
        """Return a column of some requests, as they were held or as the batch has them."""
        if not self._first or (len(rows) and rows.min() >= self._first):
            return column[self._asks[rows - self._first]] + more
        new = rows >= self._first
        out = np.empty(len(rows), np.int64)
        out[~new] = held[rows[~new]]
        out[new] = column[self._asks[rows[new] - self._first]] + more
        return out


def has_failed(outcome: I64 | U8) -> Mask:
    """Tell which requests had no answer that holds."""
    failed: Mask = (outcome == NO_RESPONSE) | (outcome == DAMAGED) | (outcome == MISMATCHED)
    return failed


def last_bytes(data: bytes, start: I64, length: I64) -> I64:
    """Return the last eight bytes of frames, or as many as they have, as numbers."""
    if len(data) < 8:
        return last_bytes(bytes(8) + data, start + 8, length)
    end = start + length
    view = np.ndarray((len(data) - 7,), "<i8", data, 0, (1,))
    out = view[np.maximum(end - 8, 0)].astype(np.int64)
    early = end < 8
    out = np.where(early, out << np.clip(8 * (8 - end), 0, 63), out)
    shift = 8 * (8 - np.minimum(length, 8))
    # the bytes before a short frame are not its own
    own: I64 = (out.view(np.uint64) >> shift.astype(np.uint64)).view(np.int64)
    return own
