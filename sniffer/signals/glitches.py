"""Pulses that are too short to be a bit are left out, as a glitch filter at the pin would."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from sniffer.ground.model import I64

SHORTEST: Final = 0.3
"""Share of a bit below which a pulse is none: the transmitter of a UART makes none shorter than a
whole bit, and with three samples a bit one sample more or less must not count."""

HELD_MOST: Final = 1 << 16
"""So many edges are decided however close the next ones are: it bounds memory."""


class GlitchFilter:
    """Edges in, edges without short pulses out.

    A run of m short pulses has m + 1 edges: none of them stays if it begins and ends on one level,
    one (the middle) if it does not.
    """

    def __init__(self, shortest: float) -> None:
        self._shortest = shortest
        self._held: I64 = np.empty(0, np.int64)
        self.removed = 0
        """Short pulses, or runs of them, that were left out."""

    def take(self, edges: I64, until: int, *, last: bool = False) -> tuple[I64, int]:
        """Return the edges that are decided, and up to when they are; ``last``: no more comes."""
        e = np.concatenate([self._held, edges]) if len(self._held) else edges
        self._held = e[:0]
        if not len(e):
            return e, until
        short = np.diff(e) < self._shortest
        if not last and until - e[-1] < self._shortest and len(e) < HELD_MOST:
            # a run of short pulses that may go on is decided when its end is known
            begin = len(short) - int(np.argmin(short[::-1])) if not short.all() else 0
            self._held = e[begin:]
            e, short, until = e[:begin], short[: max(begin - 1, 0)], int(e[begin]) - 1
        if not short.any():
            return e, until
        step = np.diff(np.concatenate([[0], short.view(np.int8), [0]]))
        first, behind = np.flatnonzero(step == 1), np.flatnonzero(step == -1)
        inside = np.zeros(len(e) + 1, np.int64)
        inside[first] += 1
        inside[behind + 1] -= 1
        keep = np.cumsum(inside[:-1]) == 0
        moved = (behind - first) % 2 == 0  # an even number of pulses: the level is another one
        keep[(first[moved] + behind[moved]) // 2] = True
        self.removed += len(first)
        return e[keep], until
