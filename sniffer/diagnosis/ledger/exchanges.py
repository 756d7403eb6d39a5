"""What a controller did after each request: how long it waited, whether it asked again, its pauses.

A request is looked at once its fate is told and the next request is heard, in order of the stream.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.diagnosis.ledger.buckets import Buckets, TimedBuckets
from sniffer.diagnosis.ledger.histograms import Histograms
from sniffer.diagnosis.ledger.kinds import KINDS, RequestKinds
from sniffer.diagnosis.ledger.moments import RequestMoments
from sniffer.diagnosis.ledger.requests import UNTOLD, Held, RequestRows, has_failed
from sniffer.diagnosis.ledger.torn import torn_ends
from sniffer.ground.codes import NO_RESPONSE, NOT_EXPECTED, OK, REQUEST
from sniffer.ground.distinct import within
from sniffer.ground.model import ECHO, NEVER_NS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.model import I64, Batch, Mask
    from sniffer.protocols.base import BusProtocol

FIRST: Final = 1 << 15
"""Exchanges that say what is usual: some minutes of a busy bus. Later ones are not counted."""

LONGEST: Final = 256
"""Pauses that are kept one by one, the longest ones."""

KEPT: Final = 500
"""Exchanges that went wrong and are kept one by one, the first ones; runs of retries alike."""

OPEN_MOST: Final = 4096
"""Requests whose fate is not told yet: far more than a decoder holds open."""

_NEXT: Final = 2 * KINDS

_WAITS: Final = {
    "n": "sum",
    "wait_sum": "sum",
    "wait_min": "min",
    "wait_max": "max",
    "again": "sum",
    "hasty": "sum",
    "at": "first",
    "length": "first",
    "t_first": "first",
    "t_last": "last",
}

_FOLLOWS: Final = {
    "n": "sum",
    "rest_min": "min",
    "at": "first",
    "t_first": "first",
    "t_last": "last",
}

_RETRIES: Final = {
    "n": "sum",
    "lost_ns": "sum",
    "at": "first",
    "t_first": "first",
    "t_last": "last",
}


class Pause(NamedTuple):
    """A pause of the controller that no missing answer explains; ``sure_ns`` at least."""

    sure_ns: int
    t_ns: int
    at: int
    kind: int
    """Of the request before it."""
    next_kind: int


class Failed(NamedTuple):
    """An exchange that went wrong, and what the controller did then."""

    at: int
    length: int
    t_ns: int
    servo_id: int
    kind: int
    outcome: int
    wait_ns: int
    """From the end of the request to the beginning of the next one."""
    unsure_ns: int
    next_kind: int
    is_again: bool
    """The next request is the same one."""


class Run(NamedTuple):
    """The same request again and again, without an answer: how many times beside the first."""

    t_ns: int
    until_ns: int
    at: int
    length: int
    servo_id: int
    again: int
    kind: int


class Exchanges:
    """Follows the requests of a bus one by one, in columns."""

    def __init__(self, protocol: BusProtocol) -> None:
        self._protocol = protocol
        self._byte_ns = 0
        self.slower_ns = 0
        """How much longer a byte may take than at the rate by which the bus is timed."""
        self.kinds = RequestKinds()
        self.moments = RequestMoments()
        self.count = 0
        self.turns = Histograms()
        """Of sound exchanges: from the end of a request to the beginning of the next, by kind."""
        self.spans = Histograms()
        """Of sound exchanges: from the end of a request to the end of its answer, by kind."""
        self.idle = Histograms()
        """Of exchanges that did not fail: how long the line was idle behind them; key 0.

        At least: a stamp says when a request ended, and at a slower rate it began sooner.
        """
        self.waits = Buckets(_WAITS)
        """Of exchanges that failed, by servo (+1) and outcome."""
        self.retries = TimedBuckets(_RETRIES)
        """Requests that were made again, by bucket and servo."""
        self.runs: list[Run] = []
        self.failed: list[Failed] = []
        self.answer_lengths = np.zeros(512, np.int64)
        """How many of the first answers have each length, in bytes."""
        self.in_flight = 0
        """Answered requests behind which another was made before their answer was over."""
        self.early = np.zeros(0, np.int64)
        """How often that was so, by kind."""
        self.hurried = Histograms()
        """How long the controller waited then, from the end of a request on; key 0."""
        self.overlaps = 0
        """Of these, how many answers were on the line before the next request was, and with it."""
        self.overlapping: list[tuple[int, int, int]] = []
        """The first of them: place, length and end of the request."""
        self.doubled = 0
        """Requests without an answer that were said once more right behind, byte for byte."""
        self.pairs = 0
        """Of these, how many are not what was said before them as well."""
        self.silent = 0
        """Requests that have no answer, and no need of one."""
        self._pauses: dict[str, I64] = {}
        self._run: Run | None = None
        self._open = Held.empty()
        self._seen = 0
        self._was_same = False
        """Whether the last request that is judged is the same as the one before it."""
        self._unsure_ns = NEVER_NS
        self._followers = Buckets(_FOLLOWS)

    @property
    def unsure_ns(self) -> int:
        """How unsure stamps are at best, whatever the rate.

        By what the host held, and by digits that a log does not have.
        """
        return 0 if self._unsure_ns == NEVER_NS else self._unsure_ns

    def add(self, batch: Batch, byte_ns: int) -> None:
        """Take the requests of a batch, and what became of requests, at a rate of the line."""
        f, self._byte_ns = batch.frames, byte_ns
        self.slower_ns = batch.slower_ns
        asks = np.flatnonzero((f.kind == REQUEST) & (f.flags & ECHO == 0))
        kind = self.kinds.add(batch, asks)
        self.moments.add(f.t_start[asks], kind)
        rows = RequestRows(batch, asks, self._open, kind)
        if len(rows) and len(batch.transactions):
            rows.tell(batch, self._protocol)
        many = self._close(rows, batch) if len(rows) > 1 else 0
        self._open = rows.behind(many)

    def _close(self, r: RequestRows, batch: Batch) -> int:
        """Judge what is told and followed by another request; return how many those are."""
        many = len(r) - 1
        untold = np.flatnonzero(r.outcome[:many] == UNTOLD)
        if len(untold) and many - untold[0] < OPEN_MOST:
            many = int(untold[0])
        if not many:
            return 0
        self.count += many
        outcome, next_start = r.outcome[:many], r.t_start[1 : many + 1]
        since = np.maximum(r.t_end[:many], r.answer_end[:many])
        failed, ok = has_failed(outcome), outcome == OK
        idle = next_start - since
        early = ok & (idle < 0)
        if early.any():
            self._hurried(r, np.flatnonzero(early), idle, torn_ends(batch))
        silent = outcome == NOT_EXPECTED
        self.silent += int(np.count_nonzero(silent))
        near = np.flatnonzero(silent & (idle <= 3 * self._byte_ns))
        if len(near):
            twice = r.same(near)
            self.doubled += int(twice.sum())
            self.pairs += int((twice & ~self._said_before(r, near)).sum())
        self._was_same = bool(r.same(np.array([many - 1]))[0])
        any_failed = bool(failed.any())
        self._usual(r, many, idle, ok & (idle >= 0), failed)
        self._rest(r, since, idle, ~failed)
        if any_failed or self._run is not None:
            rows = np.flatnonzero(failed)
            again = failed.copy()
            again[rows] = r.same(rows)
            self._went_wrong(r, rows, again)
        return many

    def _said_before(self, r: RequestRows, rows: I64) -> Mask:
        """Tell which requests are the same as the ones before them, byte for byte."""
        out = np.full(len(rows), self._was_same)
        later = rows > 0
        out[later] = r.same(rows[later] - 1)
        return out

    def _hurried(self, r: RequestRows, rows: I64, idle: I64, torn: I64) -> None:
        """Note requests that came before the answer to the last one was over.

        What stands right behind torn bytes, or behind a request that has no answer, may be the
        answer to that: one without a checksum (LSS) holds though its id is altered here.
        """
        rows = rows[~within(r.answer_at[rows], torn) & (r.outcome[rows + 1] != NO_RESPONSE)]
        unsure = np.maximum(r.unsure(rows), r.unsure(rows + 1)) + self._byte_ns // 4
        # The answer stands before the next request: its stamps are off by less than they may be,
        # or both were on the line at once.
        first = r.answer_at[rows] < r.places(rows + 1)
        over = first & (idle[rows] < -unsure)
        rows, over = rows[~first | over], over[~first | over]
        self.in_flight += len(rows)
        more = np.bincount(np.maximum(r.kind[rows], 0), minlength=len(self.early))
        more[: len(self.early)] += self.early
        self.early = more
        wait = r.t_start[rows + 1] - r.t_end[rows]
        self.hurried.add(np.zeros(len(rows), np.int64), wait, wait)
        both = rows[over]
        self.overlaps += len(both)
        some = both[: KEPT - len(self.overlapping)]
        columns = (r.places(some), r.lengths(some), r.t_end[some])
        self.overlapping += zip(*(column.tolist() for column in columns), strict=True)

    def _usual(self, r: RequestRows, many: int, idle: I64, ok: Mask, failed: Mask) -> None:
        """Count what sound exchanges take, of the first ones."""
        first = min(FIRST - self._seen, many)
        if first <= 0:
            return
        self._seen += first
        told = np.flatnonzero(~failed[:first])
        at = r.places(told)
        # Where something else stands between two requests, one may be in it.
        clean = r.places(told + 1) == at + r.lengths(told) + r.answer_length[told]
        told, at = told[clean], at[clean]
        t_ns = r.t_end[told]
        self._followers.add(
            (r.kind[told] + 1) * _NEXT + r.kind[told + 1] + 1,
            n=1,
            rest_min=idle[told],
            at=at,
            t_first=t_ns,
            t_last=t_ns,
        )
        rows = np.flatnonzero(ok[:first])
        length = np.minimum(r.answer_length[rows], len(self.answer_lengths) - 1)
        self.answer_lengths += np.bincount(length, minlength=len(self.answer_lengths))
        # a cycle may end with what nobody answers, as goals for all servos
        still = np.flatnonzero(~failed[:first] & (idle[:first] >= 0))
        least = idle[still] - self.slower_ns * r.lengths(still + 1)
        self.idle.add(np.zeros(len(still), np.int64), least, idle[still])
        turn = r.t_start[rows + 1] - r.t_end[rows]
        self.turns.add(r.kind[rows], turn, turn)
        if len(rows):
            unsure = r.unsure(rows) - self.slower_ns * r.lengths(rows)
            self._unsure_ns = min(int(unsure.min()), self._unsure_ns)
        span = r.answer_end[rows] - r.t_end[rows]
        self.spans.add(r.kind[rows], span, span)

    def _rest(self, r: RequestRows, since: I64, idle: I64, sound: Mask) -> None:
        """Keep the longest pauses."""
        full = len(self._pauses.get("sure", ())) == LONGEST
        floor = self._pauses["sure"][-1] if full else 0
        rows = np.flatnonzero((idle > floor) & sound)
        if not len(rows):
            return
        new = {
            "sure": idle[rows] - r.unsure(rows + 1),
            "t": since[rows],
            "at": r.places(rows),
            "kind": r.kind[rows],
            "next": r.kind[rows + 1],
        }
        if self._pauses:
            new = {name: np.concatenate([self._pauses[name], new[name]]) for name in new}
        # Of equal ones the first comes first, whatever the cut.
        order = np.lexsort((new["at"], -new["sure"]))[:LONGEST]
        self._pauses = {name: column[order] for name, column in new.items()}

    def _went_wrong(self, r: RequestRows, rows: I64, again: Mask) -> None:
        """Note how long the controller waited for answers that failed, and what it did then."""
        if len(rows):
            wait = r.t_start[rows + 1] - r.t_end[rows]
            unsure = np.maximum(r.unsure(rows + 1), r.unsure(rows))
            at, length, servo = r.places(rows), r.lengths(rows), r.servos(rows)
            outcome, t_ns, asked_again = r.outcome[rows], r.t_end[rows], again[rows]
            self.waits.add(
                (servo + 1) * 8 + outcome,
                n=np.ones(len(rows), np.int64),
                wait_sum=wait,
                wait_min=wait,
                wait_max=wait,
                again=asked_again.astype(np.int64),
                hasty=(wait + unsure < r.window[rows]).astype(np.int64),
                at=at,
                length=length,
                t_first=t_ns,
                t_last=t_ns,
            )
            some = slice(0, KEPT - len(self.failed))
            columns: list[I64 | Mask] = [at, length, t_ns, servo, r.kind[rows], outcome]
            columns += [wait, unsure, r.kind[rows + 1], asked_again]
            kept = (column[some].tolist() for column in columns)
            self.failed += map(Failed._make, zip(*kept, strict=True))
        self._retried(r, again)

    def _retried(self, r: RequestRows, again: Mask) -> None:
        rows = np.flatnonzero(again)
        if len(rows):
            self.retries.add(
                r.t_end[rows],
                r.servos(rows),
                n=1,
                lost_ns=r.t_start[rows + 1] - r.t_start[rows],
                at=r.places(rows),
                t_first=r.t_start[rows],
                t_last=r.t_end[rows],
            )
        if self._run is not None and not again[0]:
            self._end_run()
        runs = np.flatnonzero(np.diff(again.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
        full = KEPT - len(self.runs) + 1
        # of more than are kept the last one counts, which may go on
        for a, b in runs if len(runs) <= full else [*runs[:full], runs[-1]]:
            until, more = int(r.t_end[b]), int(b - a)
            if self._run is None:
                row = np.array([a])
                at, length, servo = (int(c(row)[0]) for c in (r.places, r.lengths, r.servos))
                self._run = Run(int(r.t_start[a]), until, at, length, servo, more, int(r.kind[a]))
            else:
                self._run = self._run._replace(again=self._run.again + more, until_ns=until)
            if b < len(again):
                self._end_run()

    def _end_run(self) -> None:
        if self._run is not None and len(self.runs) < KEPT:
            self.runs.append(self._run)
        self._run = None

    def followers(self) -> dict[str, I64]:
        """Return which kind (``next``) came right behind which exchange that did not fail."""
        key, columns = self._followers.table()
        return {**columns, "kind": key // _NEXT - 1, "next": key % _NEXT - 1}

    @property
    def pauses(self) -> Sequence[Pause]:
        """The longest pauses that no missing answer explains, the longest first."""
        if not self._pauses:
            return ()
        columns = (self._pauses[name].tolist() for name in ("sure", "t", "at", "kind", "next"))
        return [Pause(*row) for row in zip(*columns, strict=True)]

    @property
    def all_runs(self) -> Sequence[Run]:
        """Rows of retries, the one that is not over among them."""
        return self.runs if self._run is None else [*self.runs, self._run]

    def sizes(self) -> tuple[float, float]:
        """Return how many bytes a request has on average, and an answer."""
        n, lengths = self.kinds.n, [len(one) for one in self.kinds.example]
        asked = float(np.average(lengths, weights=n)) if n.sum() else 1.0
        answers = self.answer_lengths
        told = float(np.average(np.arange(len(answers)), weights=answers)) if answers.sum() else 1.0
        return asked, told

    def waited(self) -> dict[str, I64]:
        """Return ``waits`` as columns, with ``servo_id`` and ``outcome``."""
        key, columns = self.waits.table()
        return {**columns, "servo_id": key // 8 - 1, "outcome": key % 8}

    def retried(self) -> dict[str, I64]:
        """Return ``retries`` as columns, with ``servo_id`` and ``bucket``."""
        return self.retries.table()
