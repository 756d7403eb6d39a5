"""A filter line in the language of ``--where``: batches are asked, page by page."""

from __future__ import annotations

from collections import OrderedDict
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.decoding.narrowing import meant
from sniffer.inside.columns import GAP
from sniffer.selection.selection import Selection

if TYPE_CHECKING:
    from collections.abc import Callable

    from sniffer.decoding.called import ServoNames
    from sniffer.ground.model import I64, Mask
    from sniffer.inside.index import CaptureIndex

PAGES_KEPT: Final = 32
"""Pages whose answers are kept."""


class SelectionFilter:
    """Wants the lines of which the selection shows something: the frame, a value, a finding.

    Raises:
        InputError: the text is no expression.
    """

    step = 1 << 12

    def __init__(self, text: str, names: ServoNames) -> None:
        self._selection = Selection.parse(text).named(names)
        self._known: OrderedDict[int, tuple[Mask, Mask, Callable[[str], Mask]]] = OrderedDict()

    def mask(self, index: CaptureIndex, numbers: I64) -> Mask:
        """Tell for each line number whether it is wanted."""
        lines = index.lines[numbers]
        out = np.zeros(len(numbers), bool)
        is_gap = lines["kind"] == GAP
        for page in np.unique(lines["page"]).tolist():
            frames, gaps, _ = self._of(index, page)
            mine = lines["page"] == page
            for kind, shown in ((~is_gap, frames), (is_gap, gaps)):
                rows = np.flatnonzero(mine & kind)
                out[rows] = shown[lines["row"][rows]]
        found = index.found
        found = found[np.isin(found["line"], numbers)]
        for page in np.unique(found["page"]).tolist():
            mine = found[found["page"] == page]
            shown = self._of(index, page)[2]("anomalies")[mine["row"]]
            out |= np.isin(numbers, mine["line"][shown])
        return out

    def _of(self, index: CaptureIndex, number: int) -> tuple[Mask, Mask, Callable[[str], Mask]]:
        """Return which frames and gaps of a page are shown, and what tells of its tables."""
        if number not in self._known:
            page = index.pages.get(number)
            batch = page.batch
            shown = self._selection.rows(index.wires[page.bus], page.protocol, batch)
            self._known[number] = meant(batch, shown), shown("gaps"), shown
            if len(self._known) > PAGES_KEPT:
                self._known.popitem(last=False)
        return self._known[number]
