"""Curves that nobody stated: following errors, and what a bus did in each second.

Used by ``sniffer.sinks.rerun.sink``. All of it is reckoned as batches come, in memory that does not
grow with the traffic.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.codes import NO_RESPONSE, NOT_EXPECTED, UNSOLICITED
from sniffer.ground.model import NS
from sniffer.sinks.rerun.plots import FOLLOWING_ERROR, POSITION

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.ground.model import F64, I64, Batch

Rows = tuple["I64", "F64"]
"""Times in ns, and values."""

HELD: Final = 4096
"""Seconds whose last position is kept, for marks that are set afterwards: an hour."""


class Following:
    """Following errors of one servo: the last goal before it less the position that is measured."""

    def __init__(self) -> None:
        self._goal_times = np.empty(0, np.int64)
        self._goals = np.empty(0)
        self._seconds: dict[int, float] = {}
        self._recent = self._recent_errors = np.empty(0, np.int64), np.empty(0)

    def aim(self, times: I64, goals: F64) -> None:
        """Take goals."""
        times = np.concatenate([self._goal_times, times])
        order = np.argsort(times, kind="stable")
        self._goal_times = times[order]
        self._goals = np.concatenate([self._goals, goals])[order]

    def measure(self, times: I64, positions: F64) -> Rows:
        """Take positions; return the error of those that have a goal before them."""
        known = ~np.isnan(positions)
        times, positions = times[known], positions[known]
        # what a second ends with is enough for marks that are set afterwards
        seconds = times // NS
        last = np.flatnonzero(np.append(seconds[1:] != seconds[:-1], True))[: len(times)]
        self._seconds |= zip(seconds[last].tolist(), positions[last].tolist(), strict=True)
        for second in list(self._seconds)[:-HELD]:
            del self._seconds[second]
        before = np.searchsorted(self._goal_times, times, "right") - 1
        aimed = before >= 0
        errors = self._goals[before[aimed]] - positions[aimed]
        self._goal_times, self._goals = self._goal_times[-1:], self._goals[-1:]
        if len(times):
            self._recent = times, positions
        if len(errors):
            self._recent_errors = times[aimed], errors
        return times[aimed], errors

    def at(self, t_ns: int) -> dict[str, float]:
        """Return where its curves were: exact in the latest batch, to a second before it."""
        places = {}
        times, positions = self._recent
        second = t_ns // NS
        if len(times) and t_ns < times[0] - NS and second in self._seconds:
            return {POSITION: self._seconds[second]}
        if len(times):
            places[POSITION] = float(np.interp(t_ns, times, positions))
        times, errors = self._recent_errors
        if len(times):
            places[FOLLOWING_ERROR] = float(np.interp(t_ns, times, errors))
        return places


class SecondFold:
    """One value for each second: what comes in it, added up or the largest of it.

    A second is given out when a later one begins. Behind one that nothing follows ``blank`` stands:
    0 where nothing is nothing, NaN where it is not known.
    """

    def __init__(self, fold: np.ufunc, blank: float) -> None:
        self._fold, self._blank = fold, blank
        self._open: tuple[int, float] | None = None

    def add(self, times: I64, values: F64) -> Rows:
        """Take values; return the seconds that are over."""
        if not len(times):
            return _rows([])
        seconds = times // NS
        if self._open is not None:
            seconds = np.append(self._open[0], np.maximum(seconds, self._open[0]))
            values = np.append(self._open[1], values)
        order = np.argsort(seconds, kind="stable")
        which, first = np.unique(seconds[order], return_index=True)
        folded = self._fold.reduceat(values[order], first)
        self._open = int(which[-1]), float(folded[-1])
        pairs: list[tuple[int, float]] = []
        followers = which[1:].tolist()
        for second, value, follower in zip(
            which[:-1].tolist(), folded[:-1].tolist(), followers, strict=True
        ):
            pairs.append((second, value))
            if follower > second + 1:
                pairs.append((second + 1, self._blank))
        return _rows(pairs)

    def rest(self) -> Rows:
        """Return the last second, with its end, once nothing more comes."""
        if self._open is None:
            return _rows([])
        second, value = self._open
        self._open = None
        return _rows([(second, value), (second + 1, value)])


def _rows(pairs: list[tuple[int, float]]) -> Rows:
    times = np.array([second * NS for second, _ in pairs], np.int64)
    return times, np.array([value for _, value in pairs], np.float64)


def line_use(batch: Batch) -> Rows:
    """Return when frames ended, and how much of a second each took on the line, in percent."""
    f = batch.frames
    return f.t_end, (f.t_end - f.t_start) / NS * 100


def unanswered(batch: Batch) -> Iterator[tuple[int, I64, F64]]:
    """Yield for each servo when it was asked something, and 1 where no answer came, else 0."""
    t = batch.transactions
    asked = (t.request != -1) & (t.outcome != NOT_EXPECTED) & (t.outcome != UNSOLICITED)
    asked &= batch.shows("transactions", len(t))
    if not asked.any():
        return
    requests = batch.asked(t.request[asked])
    missing = (t.outcome[asked] == NO_RESPONSE).astype(np.float64)
    known = np.flatnonzero(requests.servo_id >= 0)
    for servo, at in groups(requests.servo_id[known].astype(np.int64)):
        mine = known[at]
        yield servo, requests.t_end[mine], missing[mine]


def groups(keys: I64) -> Iterator[tuple[int, I64]]:
    """Yield each key with its rows, in order."""
    if not len(keys):
        return
    # Sorting 16-bit numbers is a radix sort, ten times faster.
    narrow = keys.astype(np.uint16) if int(keys.max()) < 1 << 16 else keys
    order = np.argsort(narrow, kind="stable")
    ordered = narrow[order]
    edges = [0, *(np.flatnonzero(ordered[1:] != ordered[:-1]) + 1).tolist(), len(keys)]
    for a, b in itertools.pairwise(edges):
        yield int(ordered[a]), order[a:b]
