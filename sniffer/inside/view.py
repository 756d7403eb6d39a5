"""Which lines of a capture are shown: all or some, single frames or whole exchanges.

Nothing here waits: what takes long is done in steps, as many as there is time for (``steps``).
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.codes import RESPONSE

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.ground.model import I64, Mask
    from sniffer.inside.filters import LineFilter
    from sniffer.inside.index import CaptureIndex

STEP: Final = 1 << 14
"""Lines that are judged at a time."""

SETTLES_S: Final = 0.03
"""The panes follow the cursor so late: a key that is held down is not slowed by them."""

FOLLOWS_S: Final = 0.2
"""They do so while it stays at the last line: nobody reads quicker."""

SLICE_S: Final = 0.03
"""How long steps may take before the screen has its turn."""


class LineView:
    """The lines that are shown, by position; ``count`` of them so far.

    ``judged`` is up to which line is known whether it is shown, less than before where something
    was found in earlier lines since; ``held`` (None: nothing) is the line from which on nothing is
    shown: the list is paused.
    """

    def __init__(self, index: CaptureIndex) -> None:
        self.index = index
        self.exchanges = False
        self.filter: LineFilter | None = None
        self.held: int | None = None
        self.judged = 0
        self._shown = np.empty(STEP, np.int64)
        self._count = 0
        self._seen = 0

    @property
    def end(self) -> int:
        """The line behind the last one that may be shown."""
        there = self.index.settled
        return there if self.held is None else min(self.held, there)

    @property
    def is_whole(self) -> bool:
        """Whether every line is shown."""
        return self.filter is None and not self.exchanges

    @property
    def count(self) -> int:
        """How many lines are shown so far."""
        return self.end if self.is_whole else self._count

    @property
    def is_behind(self) -> bool:
        """Whether there are lines that nobody has judged yet, or since they changed."""
        if self.is_whole:
            return False
        return self.judged < self.end or self._seen < len(self.index.changed)

    def knows(self, line: int) -> bool:
        """Tell whether it was judged if a line is shown."""
        return self.judged > line or not self.is_behind

    def choose(self, chosen: LineFilter | None, *, exchanges: bool) -> None:
        """Show other lines."""
        self.filter, self.exchanges = chosen, exchanges
        self._seen = len(self.index.changed)
        self.judged = self._count = 0

    def pause(self, held: bool) -> None:
        """Show no line that comes from now on, or all of them again."""
        self.held = self.index.settled if held else None

    def line(self, position: int) -> int:
        """Return the number of the line at a position."""
        return position if self.is_whole else int(self._shown[position])

    def numbers(self, positions: range) -> I64:
        """Return the numbers of the lines at positions that follow each other."""
        if self.is_whole:
            return np.arange(positions.start, positions.stop)
        return self._shown[positions.start : positions.stop]

    def shown(self) -> I64:
        """Return the numbers of all lines that are shown."""
        return np.arange(self.end) if self.is_whole else self._shown[: self._count]

    def frames(self) -> I64:
        """Return the numbers of the lines that are shown, of an exchange those of both halves."""
        shown = self.shown()
        if not self.exchanges:
            return shown.copy()
        partner = self.index.lines["partner"][shown].astype(np.int64)
        return np.unique(np.concatenate([shown, partner[partner >= 0]]))

    def position(self, line: int) -> int:
        """Return the position of a line, or that of the next one behind it that is shown."""
        if self.is_whole:
            return min(line, self.end)
        return int(np.searchsorted(self._shown[: self._count], line))

    def shows(self, lines: I64) -> Mask:
        """Tell which of some lines are shown so far; of an exchange both halves are."""
        shown = np.isin(lines, self.shown())
        if self.exchanges:
            partner = self.index.lines["partner"][np.maximum(lines, 0)]
            shown |= (lines >= 0) & (partner >= 0) & np.isin(partner, self.shown())
        return shown

    def steps(self, slice_s: float = SLICE_S) -> bool:
        """Judge lines for a while; tell whether there is more to do."""
        until = time.monotonic() + slice_s
        while self.is_behind:
            self._step()
            if time.monotonic() >= until:
                break
        return self.is_behind

    def _step(self) -> None:
        self._go_back()
        first = self.judged
        last = min(first + (self.filter.step if self.filter is not None else STEP), self.end)
        fits = self._fits(first, last)
        more = np.flatnonzero(fits) + first
        if self._count + len(more) > len(self._shown):
            self._shown = np.resize(self._shown, 2 * (self._count + len(more)))
        self._shown[self._count : self._count + len(more)] = more
        self._count += len(more)
        self.judged = last

    def _go_back(self) -> None:
        """Judge lines again that were changed since."""
        changed = self.index.changed
        first = int(changed[self._seen :].min(initial=self.judged))
        self._seen = len(changed)
        if first < self.judged:
            self.judged = first
            self._count = self.position(first)

    def _fits(self, first: int, last: int) -> Mask:
        lines = self.index.lines[first:last]
        fits = np.ones(len(lines), bool)
        if self.filter is not None:
            fits = self.filter.mask(self.index, np.arange(first, last))
        if not self.exchanges:
            return fits
        partner = lines["partner"].astype(np.int64)
        if self.filter is not None:
            some = np.flatnonzero(partner >= 0)
            fits[some] |= self.filter.mask(self.index, partner[some])
        begins: Mask = (lines["kind"] != RESPONSE) | (partner < 0)
        return fits & begins

    def next_wrong(self, position: int, least: int, *, back: bool = False) -> int:
        """Return the next position with a finding of at least a severity + 1, or -1."""
        numbers = self.shown()
        lines = self.index.lines
        at = position - 1 if back else position + 1
        while 0 <= at < len(numbers):
            some = numbers[max(at - STEP + 1, 0) : at + 1] if back else numbers[at : at + STEP]
            bad = lines["severity"][some] >= least
            if self.exchanges:
                partner = lines["partner"][some]
                bad |= (partner >= 0) & (lines["severity"][np.maximum(partner, 0)] >= least)
            found = np.flatnonzero(bad)
            if len(found):
                first = max(at - STEP + 1, 0) if back else at
                return first + int(found[-1 if back else 0])
            at += -STEP if back else STEP
        return -1

    def after(self, position: int, most: int) -> Iterator[range]:
        """Yield the positions behind one, then those up to it, some at a time: round it goes."""
        first = min(position + 1, self.count)
        for begin, end in ((first, self.count), (0, first)):
            for at in range(begin, end, most):
                yield range(at, min(at + most, end))
