"""Requests that are alike: how far apart they are, and by how much that changes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.decoding.durations import Bounds, Quantiles
from sniffer.diagnosis.ledger.keys import pair_key
from sniffer.ground.heard import SteadyTime

if TYPE_CHECKING:
    from collections.abc import Container

    from sniffer.ground.model import I64, Batch

CYCLES: Final = 4096
"""Requests that are alike whose period is followed, the first ones met."""

LOOPS: Final = 512
"""Those of them that have figures of their own, the first ones that come again: each takes 64 kB.
Periods of others are among those of their command only."""


class LongestPeriod(NamedTuple):
    """The longest period of requests that are alike: its bounds, and when the later one began.

    That one is the longest for sure; another one may be longer where stamps are coarse.
    """

    bounds: Bounds
    t_ns: int


@dataclass(slots=True)
class Periods:
    """Durations in ns, each known within bounds.

    ``period``: from a request to the next like it; ``jitter``: by how much two such periods that
    follow each other differ, without sign.
    """

    period: Quantiles = field(default_factory=Quantiles)
    jitter: Quantiles = field(default_factory=Quantiles)

    def join(self, more: Periods) -> None:
        """Add those of other requests."""
        self.period.join(more.period)
        self.jitter.join(more.jitter)


@dataclass(frozen=True, slots=True)
class Loop:
    """What a command of a servo asks most often, and how far apart such requests are.

    ``address`` -1: there is none; ``offset`` is where the first of them begins; ``periods`` are
    None where they are not followed.
    """

    address: int
    requests: int
    offset: int
    longest: LongestPeriod
    periods: Periods | None


@dataclass(slots=True)
class _Cycle:
    """Requests that are alike: the last two of them, or the only one (when, and how uncertain).

    ``offset`` is where the first of them begins.
    """

    offset: int
    t_ns: list[int] = field(default_factory=list)
    spread: list[int] = field(default_factory=list)
    requests: int = 0
    longest: LongestPeriod | None = None
    periods: Periods | None = None


class Cycles:
    """Measures from each request to the one before that is like it."""

    def __init__(self) -> None:
        self._cycles: dict[tuple[int, ...], _Cycle] = {}
        self._others: dict[int, Periods] = {}
        self._loops = 0
        self._steady = SteadyTime()

    def follow(self, batch: Batch, rows: I64, kept: Container[int]) -> None:
        """Go on with some requests of a batch; periods are kept of ``kept`` commands of servos."""
        f = batch.frames
        rows = rows[f.uncertainty[rows] >= 0]
        if not len(rows):
            return
        pair = pair_key(f.servo_id[rows].astype(np.int64), f.op[rows])
        # two registers that are polled in turn are two cycles, and so are one and the block that
        # begins with it: the token says how much is asked for. Without an address the length is
        # no choice: in a line of text it is how many digits a goal has
        address = f.address[rows]
        size = np.where(address >= 0, f.data_length[rows], -1)
        names = (pair, address, size, f.token[rows])
        order = np.lexsort(names[::-1])
        columns = [column[order] for column in names]
        new = np.any([c[1:] != c[:-1] for c in columns], axis=0)
        begins = np.flatnonzero(np.concatenate([[True], new]))
        t, u = self._steady.of(f.t_start[rows])[order], f.uncertainty[rows][order]
        start = f.start[rows][order]
        ends = np.append(begins[1:], len(order))
        for k in np.argsort(order[begins]).tolist():
            a, b = int(begins[k]), int(ends[k])
            of = tuple(int(c[a]) for c in columns)
            if of not in self._cycles:
                if len(self._cycles) >= CYCLES:
                    continue
                self._cycles[of] = _Cycle(batch.base + int(start[a]))
            self._measure(self._cycles[of], of[0], t[a:b], u[a:b], kept)

    def _measure(self, cycle: _Cycle, pair: int, t: I64, u: I64, kept: Container[int]) -> None:
        """Count periods and their changes; the last requests were there before.

        A stamp is the latest moment: a request was up to its uncertainty earlier, never later.
        """
        known = len(cycle.t_ns)
        cycle.requests += len(t)
        t = np.concatenate([np.array(cycle.t_ns, np.int64), t])
        u = np.concatenate([np.array(cycle.spread, np.int64), u])
        cycle.t_ns, cycle.spread = t[-2:].tolist(), u[-2:].tolist()
        new = max(known - 1, 0)
        period = np.maximum(np.diff(t), 0)[new:]
        spread = np.maximum(u[1:], u[:-1])[new:]
        if not len(period):
            return
        cycle.longest = _longest(cycle.longest, period, spread, t[1 + new :])
        if pair not in kept:
            return
        periods = self._periods(cycle, pair)
        periods.period.add(period, spread)
        new = max(known - 2, 0)
        change = np.abs(np.diff(np.diff(t)))[new:]
        periods.jitter.add(change, np.maximum(u[2:] + u[:-2], 2 * u[1:-1])[new:])

    def _periods(self, cycle: _Cycle, pair: int) -> Periods:
        """Return where the periods of a cycle are counted."""
        if cycle.periods is None and self._loops < LOOPS:
            cycle.periods = Periods()
            self._loops += 1
        return cycle.periods or self._others.setdefault(pair, Periods())

    def all_periods(self) -> dict[int, Periods]:
        """Return the periods of each command of a servo, whatever it asks."""
        out: dict[int, Periods] = {}
        for (pair, *_), cycle in self._cycles.items():
            if cycle.periods is not None:
                out.setdefault(pair, Periods()).join(cycle.periods)
        for pair, others in self._others.items():
            out.setdefault(pair, Periods()).join(others)
        return out

    def loops(self) -> dict[int, Loop]:
        """Return of each command of a servo what it asks most often; of equal ones the first."""
        out: dict[int, Loop] = {}
        for (pair, address, *_), c in self._cycles.items():
            if c.longest and (pair not in out or c.requests > out[pair].requests):
                out[pair] = Loop(address, c.requests, c.offset, c.longest, c.periods)
        return out


def _longest(before: LongestPeriod | None, period: I64, spread: I64, t: I64) -> LongestPeriod:
    """Return the longest of some periods, each with when it ended, and of what was known before."""
    low = np.maximum(period - spread, 0)
    k = int(low.argmax())
    found = LongestPeriod(Bounds(int(low[k]), int((period + spread).max())), int(t[k]))
    if before is None:
        return found
    bounds = Bounds(*map(max, before.bounds, found.bounds))
    return LongestPeriod(bounds, (found if found.bounds.low > before.bounds.low else before).t_ns)
