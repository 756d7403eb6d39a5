"""Goals and who acknowledged them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.codes import COMMANDED, NOT_EXPECTED, OK, REQUEST
from sniffer.ground.model import ECHO
from sniffer.statistics.figures import FATES

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sniffer.ground.model import I64, Batch
    from sniffer.protocols.base import BusProtocol
    from sniffer.statistics.figures import ServoFigures

BEGINS: Final = "goal_"
"""What the quantities of goals begin with: position, speed, time, current."""

PENDING: Final = 4096
"""Goals whose outcome is not told yet, the latest ones: no bus has more requests under way."""

ACKNOWLEDGED, REFUSED, FAILED, UNANSWERED = range(len(FATES))


class GoalBook:
    """Tells what became of each request that carries a goal, once it is known."""

    def __init__(self, protocol: BusProtocol) -> None:
        self._protocol = protocol
        told = [r.role == COMMANDED and r.quantity.startswith(BEGINS) for r in protocol.registers]
        self._is_goal = np.array(told, bool)
        self._pending: dict[int, list[int]] = {}

    def add(self, batch: Batch, servos: Mapping[int, ServoFigures]) -> None:
        """Count in the goals of a batch that are shown, and what became of those before it."""
        f, v, t = batch.frames, batch.values, batch.transactions
        fates = self._fates(batch)
        offset = batch.base + f.start
        rows = np.flatnonzero(self._is_goal[v.register])
        rows = rows[(f.kind[v.row[rows]] == REQUEST) & (f.flags[v.row[rows]] & ECHO == 0)]
        if batch.chosen is not None:  # what was refused is no sample: its frame is asked for
            refused = ~v.accepted & batch.chosen("frames")[v.row]
            rows = rows[(batch.chosen("samples") | refused)[rows]]
        told = set(zip(v.row[rows].tolist(), v.servo_id[rows].tolist(), strict=True))
        for row, servo in sorted(told):
            self._pending.setdefault(int(offset[row]), []).append(servo)
        if not self._pending:
            return
        asked = t.request != -1
        starts = batch.base + batch.asked(t.request[asked]).start
        for start, fate in zip(starts.tolist(), fates[asked].tolist(), strict=True):
            for servo in self._pending.pop(start, ()):
                if servo in servos:
                    servos[servo].goals[FATES[fate]] += 1
        for start in list(self._pending)[:-PENDING]:
            del self._pending[start]

    def _fates(self, batch: Batch) -> I64:
        """Return what became of each transaction's request, if it was a goal."""
        f, t = batch.frames, batch.transactions
        fates = np.full(len(t), FAILED, np.int64)
        fates[t.outcome == NOT_EXPECTED] = UNANSWERED
        ok = np.flatnonzero((t.outcome == OK) & (t.response >= 0))
        refused = self._protocol.refused(f.status[t.response[ok]])
        fates[ok] = np.where(refused, REFUSED, ACKNOWLEDGED)
        return fates
