"""Servo by servo and command by command: how often, how regularly, how fast, what is missing."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.decoding.durations import Quantiles
from sniffer.decoding.pairing import unasked
from sniffer.diagnosis.ledger.buckets import Buckets
from sniffer.diagnosis.ledger.keys import pair_key, pair_of
from sniffer.ground.codes import DAMAGED, NO_RESPONSE, NOT_EXPECTED, OK, REQUEST
from sniffer.ground.distinct import distinct
from sniffer.ground.model import ECHO
from sniffer.statistics.cycles import Cycles, Loop, Periods
from sniffer.statistics.retries import FAILED, Retries

if TYPE_CHECKING:
    from sniffer.ground.model import I64, Batch
    from sniffer.protocols.base import BusProtocol

TIMED: Final = 256
"""Servos times commands whose times are kept, the first ones met: 16 servos that are asked 16
things are as many. Each takes 32 kB, and twice that for what it asks again and again."""

_SUMS: Final = (
    "requests",
    "responses",
    "bytes",
    "asked",
    "ok",
    "missing",
    "damaged",
    "failed",
    "unasked",
)

Z95: Final = 1.959963984540054
"""The normal distribution's 97.5 % point: an interval that holds in 95 of 100 cases."""


def wilson(k: int, n: int) -> tuple[float, float]:
    """Return between which shares the true one lies where k of n were met, with 95 % confidence.

    Wilson's score interval (1927): sound for few cases and for none, where k / n says too much.
    """
    if not n:
        return 0.0, 1.0
    share, square = k / n, Z95 * Z95 / n
    middle = (share + square / 2) / (1 + square)
    half = Z95 / (1 + square) * math.sqrt(share * (1 - share) / n + square / (4 * n))
    # at the ends rounding leaves some 1e-18 where there is nothing
    return (max(0.0, middle - half) if k else 0.0), (min(1.0, middle + half) if k < n else 1.0)


class Slowest(NamedTuple):
    """An answer: how long it took at least, about how long, when it ended, and where it begins."""

    least_ns: int
    ns: int
    t_ns: int
    offset: int


@dataclass(slots=True)
class Replies:
    """Response times of one command of one servo, in ns, each known within bounds.

    ``slowest``: the answer that took longest for sure, None where no time is told from none.
    """

    times: Quantiles = field(default_factory=Quantiles)
    slowest: Slowest | None = None


@dataclass(frozen=True, slots=True)
class CommandFigures:
    """One command of one servo; servo -1 is nobody's.

    ``asked`` are requests whose answer had to come, ``failed`` those of them that had none that
    fits (``missing``: nothing at all; ``damaged``: one that was torn), ``unasked`` answers that fit
    no request and are none that come of their own once something is done. ``periods`` are of all
    that it asks, ``loop`` is what it asks most often; None: nothing twice.
    """

    servo_id: int
    op: int
    requests: int
    responses: int
    bytes: int
    asked: int
    ok: int
    missing: int
    damaged: int
    failed: int
    unasked: int
    retries: int
    replies: Replies
    periods: Periods
    loop: Loop | None

    @property
    def missing_share(self) -> float | None:
        """The share of requests that nothing came for; None: none had to be answered."""
        return self.missing / self.asked if self.asked else None


class CommandBook:
    """Counts what one protocol says on one bus."""

    def __init__(self, protocol: BusProtocol) -> None:
        self._counts = Buckets(dict.fromkeys(_SUMS, "sum"))
        self._replies: dict[int, Replies] = {}
        self._cycles = Cycles()
        self._retries = Retries()
        self._nobody = np.array([-1, *protocol.everyone])

    def add(self, whole: Batch, batch: Batch) -> None:
        """Count a batch in; ``batch`` is what is selected of the whole one, or the same."""
        self._retries.add(whole)
        f = batch.frames
        if len(f):
            asks = (f.kind == REQUEST) & (f.flags & ECHO == 0)
            said = (f.kind != REQUEST) & (f.flags & ECHO == 0)
            key = pair_key(f.servo_id.astype(np.int64), f.op)
            self._meet(key)
            self._count(key, asks, said, f.length)
            self._cycles.follow(batch, np.flatnonzero(asks), self._replies)
        if len(batch.transactions):
            self._judge(batch)

    def _meet(self, key: I64) -> None:
        """Keep times of those whose frames come first."""
        keys, which, _ = distinct(key)
        first = np.full(len(keys), len(which))
        np.minimum.at(first, which, np.arange(len(which)))
        for pair in keys[np.argsort(first)].tolist():
            if len(self._replies) < TIMED:
                self._replies.setdefault(pair, Replies())

    def _count(self, key: I64, asks: I64, said: I64, length: I64) -> None:
        none = dict.fromkeys(_SUMS[3:], 0)
        self._counts.add(key, requests=asks, responses=said, bytes=length, **none)

    def _judge(self, batch: Batch) -> None:
        """Count what became of requests, and how long the answers took."""
        f, t = batch.frames, batch.transactions
        asked, which = batch.asking(np.where(t.request == -1, 0, t.request))
        is_asked = t.request != -1
        answer = np.maximum(t.response, 0)
        who = np.where(is_asked, asked.servo_id[which], f.servo_id[answer]).astype(np.int64)
        op = np.where(is_asked, asked.op[which], f.op[answer])
        # what is said to all is answered under the servo's own id
        bare = np.isin(who, self._nobody) & (t.response >= 0)
        who[bare] = f.servo_id[t.response[bare]]
        key = pair_key(who, op)
        wanted = is_asked & (t.outcome != NOT_EXPECTED)
        self._counts.add(
            key,
            requests=0,
            responses=0,
            bytes=0,
            asked=wanted,
            ok=wanted & (t.outcome == OK),
            missing=wanted & (t.outcome == NO_RESPONSE),
            damaged=wanted & (t.outcome == DAMAGED),
            failed=wanted & np.isin(t.outcome, FAILED),
            unasked=unasked(batch),
        )
        known = (t.outcome == OK) & (t.response_time_ns >= 0)
        took, spread = t.response_time_ns[known], t.uncertainty_ns[known]
        self._time(key[known], took, spread)
        self._find_slowest(batch, key[known], t.response[known], took, took - spread)

    def _find_slowest(self, batch: Batch, key: I64, answer: I64, took: I64, least: I64) -> None:
        """Keep of each command the answer that took longest for sure; of equal ones the first."""
        for pair in distinct(key[least > 0])[0].tolist():
            replies = self._replies.get(pair)
            if replies is None:
                continue
            i = int(np.where(key == pair, least, 0).argmax())
            if replies.slowest is None or int(least[i]) > replies.slowest.least_ns:
                row = int(answer[i])
                end, start = batch.frames.t_end[row], batch.frames.start[row]
                replies.slowest = Slowest(
                    int(least[i]), int(took[i]), int(end), batch.base + int(start)
                )

    def _time(self, key: I64, ns: I64, spread: I64) -> None:
        if not len(key):
            return
        keys, which, _ = distinct(key)
        for k, pair in enumerate(keys.tolist()):
            if pair in self._replies:
                mine = which == k
                self._replies[pair].times.add(ns[mine], spread[mine])

    def figures(self) -> list[CommandFigures]:
        """Return the figures of all commands, by servo and number of the command."""
        key, columns = self._counts.table()
        periods, loops = self._cycles.all_periods(), self._cycles.loops()
        out = []
        for i, pair in enumerate(key.tolist()):
            servo, op = pair_of(pair)
            out.append(
                CommandFigures(
                    servo,
                    op,
                    **{name: int(columns[name][i]) for name in _SUMS},
                    retries=self._retries.counts[servo, op],
                    replies=self._replies.get(pair, Replies()),
                    periods=periods.get(pair, Periods()),
                    loop=loops.get(pair),
                )
            )
        return out
