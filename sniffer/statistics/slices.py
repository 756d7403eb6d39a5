"""A bus by slices of time of a width that somebody chose: ``sniffer stats --every 1s``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.buckets import Buckets
from sniffer.diagnostics.found import SEVERITY, Anomalies
from sniffer.ground.codes import NO_RESPONSE, REQUEST
from sniffer.ground.gaps import Gaps
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

_SEVERITY: Final = np.array(SEVERITY, np.int64)


@dataclass(frozen=True, slots=True)
class EverySlice:
    """Counts in slices side by side: slice k begins at ``first_ns + k * width_ns``."""

    first_ns: int
    width_ns: int
    counts: dict[str, I64]


class SliceBook:
    """Counts what is said on a bus, slice by slice.

    Slices begin at multiples of their width (by the second: with the seconds of the clock), so
    they do not depend on where a stream begins, and are the same for all buses.
    """

    def __init__(self, width_ns: int) -> None:
        self.width_ns = width_ns
        self._rows = Buckets(dict.fromkeys(COUNTED, "sum"))

    def add(self, batch: Batch, mine: Batch) -> None:
        """Count in what is selected of a batch, ``mine``; the time is that of all of it."""
        f, gaps, t = mine.frames, Gaps.of(mine.gaps), mine.transactions
        self._count(batch.frames.t_end)
        self._count(f.t_end, bytes=f.length.astype(np.int64), frames=1)
        self._count(f.t_end[f.kind == REQUEST], requests=1)
        self._count(gaps.t_ns, bytes=gaps.length)
        self._count(mine.asked(t.request[t.outcome == NO_RESPONSE]).t_end, missing=1)
        found = Anomalies.of(mine.anomalies)
        for name, level in (("errors", Severity.ERROR), ("warnings", Severity.WARN)):
            self._count(found.t_ns[_SEVERITY[found.code] == level], **{name: 1})

    def slices(self) -> EverySlice:
        """Return all slices from the first to the last one, those without anything too.

        Raises:
            InputError: there are too many.
        """
        key, columns = self._rows.table()
        if not len(key):
            return EverySlice(0, self.width_ns, dict(columns))
        first, count = int(key[0]), int(key[-1] - key[0]) + 1
        if count > MOST:
            raise InputError(f"these are {count} slices of time: choose longer ones")
        counts = {}
        for name, column in columns.items():
            counts[name] = np.zeros(count, np.int64)
            counts[name][key - first] = column
        return EverySlice(first * self.width_ns, self.width_ns, counts)

    def _count(self, t_ns: I64, **columns: I64 | int) -> None:
        self._rows.add(t_ns // self.width_ns, **(dict.fromkeys(COUNTED, 0) | columns))
