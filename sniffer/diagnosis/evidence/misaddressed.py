"""Servos that nobody meant: items of a command to several that are longer or shorter than it says.

Whoever reads items of another length than they were written with takes values for ids::

    written      1 FF 07 2C 01    2 FF 07 2C 01
    read         1 FF 07    44 1 2    255 7 44    1 ...
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.codes import COMMANDED
from sniffer.ground.distinct import numbers, within

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sniffer.diagnosis.case import Case

LEAST: Final = 3
"""Servos that nobody asks or hears, and that get goals out of range."""

SELDOM: Final = 0.1
"""Part of the commands to several in which such a servo is named at most: one that is there gets
its goals each time, and values that are taken for ids change."""


def misaddressed(case: Case) -> Mapping[int, int]:
    """Return servos that commands to several name by mistake, and how often; empty: none does."""
    return case.once(_misaddressed)


def _misaddressed(case: Case) -> Mapping[int, int]:
    w, t = case.writes, case.traffic
    to_all = within(t["servo_id"], case.everyone)
    told = int(t["requests"][to_all].sum())
    is_seldom = (w["n"] <= SELDOM * told) & ~within(w["servo_id"], t["servo_id"])
    goals = [
        i
        for i, r in enumerate(case.protocol.registers)
        if r.role == COMMANDED and r.range is not None
    ]
    is_goal = is_seldom & within(w["register"], goals)
    low, high = np.zeros((2, len(case.protocol.registers)), np.int64)
    for i in goals:
        low[i], high[i] = case.protocol.registers[i].range or (0, 0)
    beyond = is_goal & ((w["low"] < low[w["register"]]) | (w["high"] > high[w["register"]]))
    wrong = numbers(w["servo_id"][beyond])
    if len(wrong) < LEAST:
        return {}
    rows = np.flatnonzero(is_seldom)
    whose = w["servo_id"][rows]
    return {s: int(w["n"][rows[whose == s]].max()) for s in numbers(whose).tolist()}
