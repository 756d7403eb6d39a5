"""A bus by slices of time of a width that somebody chose: ``sniffer stats --every 1s``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.anomalies.found import SEVERITY, Anomalies
from sniffer.decoding.durations import BINS, Bounds, bins_of, edge_of
from sniffer.diagnosis.ledger.buckets import Buckets
from sniffer.ground.codes import NO_RESPONSE, OK, REQUEST
from sniffer.ground.gaps import Gaps
from sniffer.ground.heard import SteadyTime
from sniffer.ground.model import InputError, Severity

if TYPE_CHECKING:
    from sniffer.ground.model import I64, Batch

FINEST_NS: Final = 10_000_000
"""The shortest slice that can be asked for: a frame counts where it ends, and may take 5 ms."""

MOST: Final = 1 << 20
"""Slices that are told at most: 12 days by the second."""

COUNTED: Final = ("bytes", "frames", "requests", "missing", "errors", "warnings")
"""What is counted in each slice. Bytes are those in gaps, too; ``missing`` are requests that
nothing came for, where they end."""

QUANTILES: Final = {"p50": 0.5, "p95": 0.95, "max": 1.0}
"""The figures of the response times in a slice, and the share of them that stay below."""

_SEVERITY: Final = np.array(SEVERITY, np.int64)


@dataclass(frozen=True, slots=True)
class EverySlice:
    """Counts in slices side by side: slice k begins at ``first_ns + k * width_ns``."""

    first_ns: int
    width_ns: int
    counts: dict[str, I64]
    answers: I64
    """How many response times each slice has."""
    replies: dict[str, list[Bounds | None]]
    """Their ``QUANTILES``, None where there are none."""


class SliceBook:
    """Counts what is said on a bus, slice by slice.

    Slices begin at multiples of their width (by the second: with the seconds of the clock), so
    they do not depend on where a stream begins, and are the same for all buses. Where the clock
    was set, they go on as though it had not been.
    """

    def __init__(self, width_ns: int) -> None:
        self.width_ns = width_ns
        self._rows = Buckets(dict.fromkeys(COUNTED, "sum"))
        self._replies = ReplyBook()
        self._steady = SteadyTime()

    def add(self, batch: Batch, mine: Batch) -> None:
        """Count in what is selected of a batch, ``mine``; the time is that of all of it."""
        f, gaps, t = mine.frames, Gaps.of(mine.gaps), mine.transactions
        steady = self._steady.records([batch]).of
        ended = steady(f.t_end, f.start)
        self._count(steady(batch.frames.t_end, batch.frames.start))
        self._count(ended, bytes=f.length.astype(np.int64), frames=1)
        self._count(ended[f.kind == REQUEST], requests=1)
        self._count(steady(gaps.t_ns, gaps.start), bytes=gaps.length)
        lost = mine.asked(t.request[t.outcome == NO_RESPONSE])
        self._count(steady(lost.t_end, lost.start), missing=1)
        found = Anomalies.of(mine.anomalies)
        for name, level in (("errors", Severity.ERROR), ("warnings", Severity.WARN)):
            rows = _SEVERITY[found.code] == level
            at = found.known_at[rows] - batch.base
            self._count(steady(found.t_ns[rows], at), **{name: 1})
        known = (t.outcome == OK) & (t.response_time_ns >= 0)
        ends = ended[t.response[known]]
        self._replies.add(ends // self.width_ns, t.response_time_ns[known], t.uncertainty_ns[known])

    def slices(self) -> EverySlice:
        """Return all slices from the first to the last one, those without anything too.

        Raises:
            InputError: there are too many.
        """
        key, columns = self._rows.table()
        if not len(key):
            return EverySlice(0, self.width_ns, dict(columns), *self._replies.figures(0, 0))
        first, count = int(key[0]), int(key[-1] - key[0]) + 1
        if count > MOST:
            raise InputError(f"these are {count} slices of time: choose longer ones")
        counts = {}
        for name, column in columns.items():
            counts[name] = np.zeros(count, np.int64)
            counts[name][key - first] = column
        replies = self._replies.figures(first, count)
        return EverySlice(first * self.width_ns, self.width_ns, counts, *replies)

    def _count(self, t_ns: I64, **columns: I64 | int) -> None:
        self._rows.add(t_ns // self.width_ns, **(dict.fromkeys(COUNTED, 0) | columns))


class ReplyBook:
    """Response times slice by slice, each known within bounds, as ``Quantiles`` has those of all.

    A row for each bin of a slice that has any: the times of a slice are much alike.
    """

    def __init__(self) -> None:
        self._bins = Buckets({"n": "sum"})
        self._ends = Buckets(
            {"n": "sum", "least": "min", "least_of_most": "min"}
            | {"most_of_least": "max", "most": "max"}
        )

    def add(self, number: I64, ns: I64, spread: I64) -> None:
        """Count durations in, in ns, each known to ``spread``, by the number of its slice."""
        spread = np.maximum(spread, 0)
        low, high = np.maximum(ns - spread, 0), ns + spread
        for side, bound in enumerate((low, high)):
            self._bins.add((2 * number + side) * BINS + bins_of(bound), n=1)
        self._ends.add(number, n=1, least=low, least_of_most=high, most_of_least=low, most=high)

    def figures(self, first: int, count: int) -> tuple[I64, dict[str, list[Bounds | None]]]:
        """Return of so many slices how many times each has, and their quantiles."""
        answers = np.zeros(count, np.int64)
        out: dict[str, list[Bounds | None]] = {name: [None] * count for name in QUANTILES}
        key, ends = self._ends.table()
        answers[key - first] = ends["n"]
        bins, columns = self._bins.table()
        begins = np.searchsorted(bins, np.ravel([2 * key, 2 * key + 1], "F") * BINS)
        edges = np.append(begins, len(bins)).tolist()
        below = np.cumsum(columns["n"])
        sides = ("least", "most_of_least"), ("least_of_most", "most")
        for i, n in enumerate(ends["n"].tolist()):
            for name, share in QUANTILES.items():
                if share >= 1:
                    out[name][int(key[i]) - first] = Bounds(
                        int(ends["most_of_least"][i]), int(ends["most"][i])
                    )
                    continue
                bounds = []
                for side, (least, most) in enumerate(sides):
                    a, b = edges[2 * i + side], edges[2 * i + side + 1]
                    before = int(below[a - 1]) if a else 0
                    at = a + int(np.searchsorted(below[a:b], before + share * n))
                    within = int(ends[least][i]), int(ends[most][i])
                    bounds.append(edge_of(int(bins[at] % BINS), side, *within))
                out[name][int(key[i]) - first] = Bounds(*bounds)
        return answers, out
