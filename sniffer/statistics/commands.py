"""Servo by servo and command by command: how often, how regularly, how fast, what is missing."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.decoding.durations import Bounds, Quantiles
from sniffer.diagnosis.buckets import Buckets
from sniffer.diagnosis.ledger import pair_key
from sniffer.ground.codes import NO_RESPONSE, NOT_EXPECTED, OK, REQUEST, UNSOLICITED
from sniffer.ground.distinct import distinct
from sniffer.ground.model import ECHO
from sniffer.statistics.retries import FAILED, Retries

if TYPE_CHECKING:
    from sniffer.ground.model import I64, Batch
    from sniffer.protocols.base import BusProtocol

TIMED: Final = 256
"""Servos times commands whose times are kept, the first ones met: each takes 100 kB, and 16 servos
that are asked 16 things are as many."""

CYCLES: Final = 4096
"""Requests that are alike whose period is followed, the first ones met."""

_SUMS: Final = ("requests", "responses", "bytes", "asked", "ok", "missing", "failed", "unasked")

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


class LongestPeriod(NamedTuple):
    """The longest period of requests that are alike: its bounds, and when the later one began.

    That one is the longest for sure; another one may be longer where stamps are coarse.
    """

    bounds: Bounds
    t_ns: int


@dataclass(slots=True)
class Durations:
    """Durations of one command of one servo, in ns, each known within bounds.

    ``period``: from a request to the next like it; ``jitter``: between two such periods that follow
    each other, without sign; ``reply``: response times; ``slowest``: the answer that took longest
    for sure, None where no time is told from none.
    """

    period: Quantiles = field(default_factory=Quantiles)
    jitter: Quantiles = field(default_factory=Quantiles)
    reply: Quantiles = field(default_factory=Quantiles)
    slowest: Slowest | None = None


@dataclass(frozen=True, slots=True)
class CommandFigures:
    """One command of one servo; servo -1 is nobody's.

    ``asked`` are requests whose answer had to come, ``failed`` those of them that had none that
    fits (``missing``: nothing at all), ``unasked`` answers that fit no request. ``longest`` is the
    longest period of what is asked most often: what is asked once in a while is no loop.
    """

    servo_id: int
    op: int
    requests: int
    responses: int
    bytes: int
    asked: int
    ok: int
    missing: int
    failed: int
    unasked: int
    retries: int
    times: Durations
    longest: LongestPeriod | None

    @property
    def missing_share(self) -> float | None:
        """The share of requests that nothing came for; None: none had to be answered."""
        return self.missing / self.asked if self.asked else None


class _Cycle(NamedTuple):
    """The last two requests that are alike, or the only one: when, and how uncertain.

    ``periods`` counts what is between such requests, ``longest`` is the longest of them.
    """

    t_ns: tuple[int, ...]
    spread: tuple[int, ...]
    periods: int
    longest: LongestPeriod | None


_NEW: Final = _Cycle((), (), 0, None)


class CommandBook:
    """Counts what one protocol says on one bus."""

    def __init__(self, protocol: BusProtocol) -> None:
        self._counts = Buckets(dict.fromkeys(_SUMS, "sum"))
        self._times: dict[int, Durations] = {}
        self._cycles: dict[tuple[int, ...], _Cycle] = {}
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
            self._follow(batch, np.flatnonzero(asks))
        if len(batch.transactions):
            self._judge(batch)

    def _meet(self, key: I64) -> None:
        """Keep times of those whose frames come first."""
        keys, which, _ = distinct(key)
        first = np.full(len(keys), len(which))
        np.minimum.at(first, which, np.arange(len(which)))
        for pair in keys[np.argsort(first)].tolist():
            if len(self._times) < TIMED:
                self._times.setdefault(pair, Durations())

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
            failed=wanted & np.isin(t.outcome, FAILED),
            unasked=t.outcome == UNSOLICITED,
        )
        known = (t.outcome == OK) & (t.response_time_ns >= 0)
        took, spread = t.response_time_ns[known], t.uncertainty_ns[known]
        self._time("reply", key[known], took, spread)
        self._find_slowest(batch, key[known], t.response[known], took, took - spread)

    def _find_slowest(self, batch: Batch, key: I64, answer: I64, took: I64, least: I64) -> None:
        """Keep of each command the answer that took longest for sure; of equal ones the first."""
        for pair in distinct(key[least > 0])[0].tolist():
            times = self._times.get(pair)
            if times is None:
                continue
            i = int(np.where(key == pair, least, 0).argmax())
            if times.slowest is None or int(least[i]) > times.slowest.least_ns:
                row = int(answer[i])
                end, start = batch.frames.t_end[row], batch.frames.start[row]
                times.slowest = Slowest(
                    int(least[i]), int(took[i]), int(end), batch.base + int(start)
                )

    def _follow(self, batch: Batch, rows: I64) -> None:
        """Measure from each request to the one before that is like it."""
        f = batch.frames
        rows = rows[f.uncertainty[rows] >= 0]
        if not len(rows):
            return
        pair = pair_key(f.servo_id[rows].astype(np.int64), f.op[rows])
        # two registers that are polled in turn are two cycles, and so are one and the block that
        # begins with it: the token says how much is asked for
        names = (f.address, f.data_length, f.token)
        order = np.lexsort((*(c[rows] for c in reversed(names)), pair))
        columns = (pair[order], *(c[rows][order] for c in names))
        new = np.any([c[1:] != c[:-1] for c in columns], axis=0)
        begins = np.flatnonzero(np.concatenate([[True], new]))
        t, u = f.t_start[rows][order], f.uncertainty[rows][order]
        ends = np.append(begins[1:], len(order))
        for k in np.argsort(order[begins]).tolist():
            a, b = int(begins[k]), int(ends[k])
            of = tuple(int(c[a]) for c in columns)
            last = self._cycles.get(of, _NEW)
            if last is _NEW and len(self._cycles) >= CYCLES:
                continue
            at = np.array([*last.t_ns, *t[a:b].tolist()], np.int64)
            unsure = np.array([*last.spread, *u[a:b].tolist()], np.int64)
            self._cycles[of] = self._measure(of[0], at, unsure, last)

    def _measure(self, pair: int, t: I64, u: I64, last: _Cycle) -> _Cycle:
        """Count periods and their changes; the ``last`` requests were there before.

        A stamp is the latest moment: a request was up to its uncertainty earlier, never later.
        """
        known = len(last.t_ns)
        period = np.maximum(np.diff(t), 0)
        new = max(known - 1, 0)
        key = np.full(len(period) - new, pair)
        spread = np.maximum(u[1:], u[:-1])
        self._time("period", key, period[new:], spread[new:])
        longest = _longest(last.longest, period[new:], spread[new:], t[1 + new :])
        change = np.abs(np.diff(np.diff(t)))
        spread = np.maximum(u[2:] + u[:-2], 2 * u[1:-1])
        earlier, new = new, max(known - 2, 0)
        self._time("jitter", np.full(len(change) - new, pair), change[new:], spread[new:])
        periods = last.periods + len(period) - earlier
        return _Cycle(tuple(t[-2:].tolist()), tuple(u[-2:].tolist()), periods, longest)

    def _time(self, name: str, key: I64, ns: I64, spread: I64) -> None:
        if not len(key):
            return
        keys, which, _ = distinct(key)
        for k, pair in enumerate(keys.tolist()):
            if pair in self._times:
                times: Quantiles = getattr(self._times[pair], name)
                mine = which == k
                times.add(ns[mine], spread[mine])

    def figures(self) -> list[CommandFigures]:
        """Return the figures of all commands, by servo and number of the command."""
        key, columns = self._counts.table()
        busiest: dict[int, _Cycle] = {}
        for (of, *_), cycle in self._cycles.items():  # of equal ones the first
            if of not in busiest or cycle.periods > busiest[of].periods:
                busiest[of] = cycle
        out = []
        for i, pair in enumerate(key.tolist()):
            servo, op = (pair >> 32) - 1, _signed(pair & 0xFFFFFFFF)
            sums = {name: int(columns[name][i]) for name in _SUMS}
            times, retries = self._times.get(pair, Durations()), self._retries.counts[servo, op]
            longest = busiest.get(pair, _NEW).longest
            out.append(
                CommandFigures(servo, op, **sums, retries=retries, times=times, longest=longest)
            )
        return out


def _longest(
    before: LongestPeriod | None, period: I64, spread: I64, t: I64
) -> LongestPeriod | None:
    """Return the longest of some periods, each with when it ended, and of what was known before."""
    if not len(period):
        return before
    low = np.maximum(period - spread, 0)
    k = int(low.argmax())
    found = LongestPeriod(Bounds(int(low[k]), int((period + spread).max())), int(t[k]))
    if before is None:
        return found
    bounds = Bounds(*map(max, before.bounds, found.bounds))
    return LongestPeriod(bounds, (found if found.bounds.low > before.bounds.low else before).t_ns)


def _signed(op: int) -> int:
    """Return the command of a key: 32 bits of a number that may be below 0."""
    return op - (1 << 32) if op >> 31 else op
