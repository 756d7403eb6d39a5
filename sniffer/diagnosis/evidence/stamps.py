"""On which grid the stamps of a capture lie: what is steadier than the grid cannot be told by them.

An adapter hands bytes over once in a USB frame, and a logger writes so many digits. Two moments on
a grid of a millisecond are whole milliseconds apart, whatever the servo did in between: its time to
answer looks as if it never varied, and so does everybody else's.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from sniffer.diagnosis.case import Case
    from sniffer.ground.model import I64

EXACT_NS: Final = 2_000_000
"""Stamps that are worse tell no place in a cycle, nor a second answer from one that is late."""

GRIDS_NS: Final = (1_000_000, 100_000, 10_000)
"""The frame of a full-speed USB host, and the decimal places that loggers write."""

LEAST: Final = 8
"""Differences from which on a grid shows."""

NEAR: Final = 0.1
"""By which part of the grid's width a difference may be beside it: a busy host stamps late."""

SHARE: Final = 0.8
"""Part of the differences that must lie on a grid: by chance it is twice ``NEAR``, a fifth."""


def grid_ns(case: Case) -> int:
    """Return the width of the grid on which requests are stamped; 0: none is seen."""
    return case.once(_grid)


def _grid(case: Case) -> int:
    seconds = case.ledger.second_answers.kept
    places = (*(d.asked_before for d in case.damages), *(s.asked_before for s in seconds))
    moments = [np.array([asked.t_ns for asked in some], np.int64) for some in places]
    return grid_of(np.concatenate([np.diff(m) for m in moments] or [np.zeros(0, np.int64)]))


ANSWERED: Final = 20
"""Answers to one command from which on it shows how steadily they come."""


def steadiest_ns(case: Case) -> int:
    """Return by how much the answers vary that are stamped the most steadily; 0: not known.

    Nine tenths of them, those of one servo to one command. A servo takes as long as it always does:
    what varies is when its bytes, or those of its request, were handed over. Of a host that asks
    its adapter when it has time all answers come unsteadily, on no grid.
    """
    return case.once(_steadiest)


def _steadiest(case: Case) -> int:
    took = case.ledger.took
    varies = []
    for key in took.keys:
        low, high = took.at(key, 0.05), took.at(key, 0.95)
        if took.count(key) >= ANSWERED and low is not None and high is not None:
            varies.append(high.high - low.high)
    return min(varies, default=0)


def grid_of(differences: I64) -> int:
    """Return the widest grid on which differences of moments lie."""
    if len(differences) < LEAST:
        return 0
    for grid in GRIDS_NS:
        beside = np.abs((differences + grid // 2) % grid - grid // 2)
        if float((beside <= NEAR * grid).mean()) >= SHARE:
            return grid
    return 0
