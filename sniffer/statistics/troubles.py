"""Anomalies by code and servo: how many, when, how they spread over the time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.anomalies.found import CODES, SEVERITY, Anomalies
from sniffer.ground.distinct import distinct

if TYPE_CHECKING:
    from sniffer.ground.model import Batch, Severity
    from sniffer.statistics.grid import Grid

TIMES: Final = 16
"""The first ones are told one by one."""


@dataclass(slots=True)
class TroubleFigures:
    """One code of one servo (-1: nobody's).

    ``times`` and ``offsets`` are of the first ones, in the order in which they were found;
    ``curve`` is all of them over time.
    """

    code: str
    severity: Severity
    servo_id: int
    count: int
    first_ns: int
    last_ns: int
    times: list[int]
    offsets: list[int]
    curve: int


class TroubleBook:
    """Counts the anomalies of one protocol on one bus."""

    def __init__(self) -> None:
        self._figures: dict[int, TroubleFigures] = {}

    def add(self, batch: Batch, grid: Grid) -> None:
        """Count a batch in."""
        if not len(batch.anomalies):
            return
        found = Anomalies.of(batch.anomalies)
        keys, which, _ = distinct(found.code.astype(np.int64) << 32 | (found.servo_id + 1))
        first = np.full(len(keys), len(which))
        np.minimum.at(first, which, np.arange(len(which)))
        for k in np.argsort(first).tolist():
            rows = np.flatnonzero(which == k)
            t_ns = found.t_ns[rows]
            mine = self._figures.get(int(keys[k]))
            if mine is None:
                code, servo = int(keys[k]) >> 32, (int(keys[k]) & 0xFFFFFFFF) - 1
                told = CODES[code], SEVERITY[code], servo, 0, int(t_ns[0]), int(t_ns[0])
                mine = TroubleFigures(*told, [], [], grid.curve())
                self._figures[int(keys[k])] = mine
            mine.count += len(rows)
            mine.first_ns = min(mine.first_ns, int(t_ns.min()))
            mine.last_ns = max(mine.last_ns, int(t_ns.max()))
            left = TIMES - len(mine.times)
            mine.times += t_ns[:left].tolist()
            mine.offsets += found.at[rows][:left].tolist()
            grid.add(mine.curve, t_ns, np.ones(len(rows)))

    def figures(self) -> list[TroubleFigures]:
        """Return them, the worst severity first, then those with most."""
        return sorted(
            self._figures.values(), key=lambda f: (-f.severity, -f.count, f.code, f.servo_id)
        )
