"""Where a part of a capture begins and ends, though its clock may be set meanwhile.

Seconds, and places that were found, count as though it had never been set. A time of day and a date
are what stamps say; where the clock was set back and they say it twice, the first time is meant.

Of a clock that is set back by 3600 s behind its 4th second, from second 5 to second 6::

    record  stamp   moved by   begins from   ends with
    0           0          0             5           6
    1           3          0             5           6
    2       -3596       3600         -3595       -3594     the clock was set
    3       -3594       3600         -3595       -3594     in the part
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.ground.heard import SET_BACK_NS, SteadyPass

if TYPE_CHECKING:
    from sniffer.ground.model import I64, Mask

_EARLIEST: Final = np.iinfo(np.int64).min
_LATEST: Final = np.iinfo(np.int64).max


class PartEnds(NamedTuple):
    """The first and the last time of a part, in ns; None: with the capture.

    ``starts_by_stamp`` and ``stops_by_stamp`` tell whether it is what stamps say, or a time that
    counts as though the clock had never been set.
    """

    start: int | None = None
    stop: int | None = None
    starts_by_stamp: bool = False
    stops_by_stamp: bool = False


EndsSince = Callable[[int | None], PartEnds]
"""Gives the ends of a part by the first stamp since the clock was set, None: it was not set.

A time of day is another moment for who was told the date meanwhile."""


class EdgeTimes(NamedTuple):
    """The first and the last stamp of a part, as the clock is at each record of a pass.

    Of a pass without records there is one row, as the clock was last.
    """

    records: SteadyPass
    low: I64
    high: I64
    ends: PartEnds

    def may_begin(self) -> Mask:
        """Tell with which records the part may begin."""
        t_ns = self.records.t_ns
        begun: Mask = t_ns >= self.low[: len(t_ns)]
        # stamps behind the end are no beginning: a clock that is set back may still come to it
        return begun & (t_ns <= self.high[: len(t_ns)]) if self.ends.starts_by_stamp else begun

    def are_beyond(self, is_begun: Mask) -> Mask:
        """Tell which records are behind its end; ``is_begun``: which are not before its begin."""
        t_ns = self.records.t_ns
        beyond: Mask = t_ns > self.high[: len(t_ns)]
        if not self.ends.stops_by_stamp:
            return beyond
        if self.ends.starts_by_stamp:  # the clock was set back to before its begin
            beyond |= t_ns < self.low[: len(t_ns)] - SET_BACK_NS
        return beyond & is_begun

    def has(self, t_ns: I64, start: I64) -> Mask:
        """Tell which times are within, of what begins at some bytes."""
        row = self.records.rows(start)
        within: Mask = (t_ns >= self.low[row]) & (t_ns <= self.high[row])
        return within


class BusEnds:
    """The ends of a part on one bus, pass by pass."""

    def __init__(self, since: EndsSince) -> None:
        self._since = since
        self._moved = 0
        self.ends = since(None)

    def edges(self, records: SteadyPass) -> EdgeTimes:
        """Return the ends at each record of a pass."""
        t_ns, moved = records.t_ns, records.moved
        low, high = (np.full(max(len(t_ns), 1), edge) for edge in (_EARLIEST, _LATEST))
        for row in [0, *np.flatnonzero(np.diff(moved)) + 1]:
            by = int(moved[row]) if len(moved) else self._moved
            if by != self._moved:
                self._moved, self.ends = by, self._since(int(t_ns[row]))
            ends = self.ends
            if ends.start is not None:
                low[row:] = ends.start - (0 if ends.starts_by_stamp else by)
            if ends.stop is not None:
                high[row:] = ends.stop - (0 if ends.stops_by_stamp else by)
        return EdgeTimes(records, low, high, self.ends)

    def have(self, t_ns: int, moved: int) -> bool:
        """Tell whether a time is within; ``moved``: by what the clock was set back before it."""
        at, t, by = (np.array([number], np.int64) for number in (0, t_ns, moved))
        return bool(self.edges(SteadyPass(at, t, by)).has(t, at)[0])
