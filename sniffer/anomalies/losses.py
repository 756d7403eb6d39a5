"""What the tap is known to have lost: what follows from that is no servo's fault."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.anomalies.answers import LATE_SPAN
from sniffer.anomalies.found import NUMBER
from sniffer.anomalies.tap import OPEN_ENDED
from sniffer.ground.memory import Remembering

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.anomalies.found import Anomalies
    from sniffer.ground.model import Batch

OF_ANSWERS: Final = frozenset({"late-response", "mismatched-response", "unsolicited-response"})
"""Codes that missing bytes explain, too: what is there answers what is not."""

_OURS: Final = np.array([NUMBER[code] for code in sorted(OPEN_ENDED | OF_ANSWERS)])


class TapLosses(Remembering):
    """Remembers where bytes are missing for as long as an answer to what stands there may come."""

    PASSING = ("_regions",)

    def __init__(self, reach: int) -> None:
        self._reach = max(LATE_SPAN, reach)
        self._regions: list[tuple[int, int]] = []

    def matters(self, at: int) -> Mapping[str, Any]:
        """Return the losses that an answer may still be late from."""
        return {"regions": [r for r in self._regions if at - r[1] <= self._reach]}

    def without(self, batch: Batch, found: Anomalies, new: Sequence[tuple[int, int]]) -> Anomalies:
        """Return the anomalies of a batch that no loss explains; ``new`` ones are remembered."""
        if not new and not self._regions:
            return found
        regions = [*self._regions, *new]
        behind = batch.base + len(batch.data)
        self._regions = [r for r in regions if behind - r[1] <= self._reach]
        ours = np.flatnonzero(np.isin(found.code, _OURS)).tolist()
        begins = [min(found[i].evidence)[0] for i in ours]
        gone = [
            i
            for i, at in zip(ours, begins, strict=True)
            if any(start <= at < end for start, end in regions)
        ]
        return found.take(np.delete(np.arange(len(found)), gone)) if gone else found
