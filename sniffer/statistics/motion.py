"""How far servos are from their goals, and how they get there."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from sniffer.decoding.durations import Quantiles
from sniffer.ground.milli import in_milli
from sniffer.statistics.figures import Extreme
from sniffer.statistics.firstmotion import FirstMotions
from sniffer.statistics.following import Follower
from sniffer.statistics.goalsteps import GoalSteps
from sniffer.statistics.lags import Lags

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.ground.model import Batch
    from sniffer.protocols.base import BusProtocol
    from sniffer.statistics.following import Course


@dataclass(slots=True)
class ErrorFigures:
    """Following errors of one servo in one unit: goal less position.

    ``size``: without sign, in thousandths; ``worst``: the greatest, with its sign.
    """

    size: Quantiles = field(default_factory=Quantiles)
    worst: Extreme | None = None


class Motion:
    """Follows all servos of one protocol."""

    def __init__(self, protocol: BusProtocol) -> None:
        self._follower = Follower(protocol)
        self.steps = GoalSteps(protocol.registers)
        self.starts = FirstMotions(protocol.registers)
        self.lags = Lags()
        self.errors: dict[tuple[int, str], ErrorFigures] = {}
        """By servo and unit."""

    def add(self, batch: Batch) -> Iterator[Course]:
        """Take a batch, all of it; yield what it tells, servo by servo."""
        for course in self._follower.add(batch):
            self.steps.add(course)
            self.starts.add(course)
            self.lags.add(course)
            self._measure(course)
            yield course

    def _measure(self, course: Course) -> None:
        error = course.goal - course.position
        rows = np.flatnonzero(~np.isnan(error) & course.shown)
        if not len(rows):
            return
        mine = self.errors.setdefault((course.servo_id, course.unit), ErrorFigures())
        size = np.abs(error[rows])
        mine.size.add(in_milli(size), np.zeros(len(rows), np.int64))
        k = int(size.argmax())
        if mine.worst is None or size[k] > abs(mine.worst.value):
            row = rows[k]
            mine.worst = Extreme(float(error[row]), int(course.t_ns[row]), int(course.at[row]))
