"""Where the least of some quantities stands: what is far below all others is to be shown itself."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.model import I64


class Low(NamedTuple):
    """The least number of a register (in thousandths), when it was stated, and by which byte."""

    value: int
    t_ns: int
    at: int


class Lowest:
    """Keeps, of some registers, the least number of each servo; of equal ones the first."""

    def __init__(self, of: Sequence[bool]) -> None:
        self._of = np.array(of, bool)
        self._least: dict[tuple[int, int], Low] = {}

    def add(self, register: I64, servo_id: I64, value: I64, t_ns: I64, at: I64) -> None:
        """Take numbers in order of the stream."""
        rows = np.flatnonzero(self._of[register])
        if not len(rows):
            return
        key = register[rows] << 16 | servo_id[rows] + 1
        order = np.lexsort((rows, value[rows], key))
        first = np.flatnonzero(np.diff(key[order], prepend=-1))
        for row in rows[order[first]].tolist():
            who = int(servo_id[row]), int(register[row])
            known = self._least.get(who)
            if known is None or int(value[row]) < known.value:
                self._least[who] = Low(int(value[row]), int(t_ns[row]), int(at[row]))

    def of(self, servo_id: int, register: int) -> Low | None:
        """Return the least number of a servo's register; None: it has none."""
        return self._least.get((servo_id, register))
