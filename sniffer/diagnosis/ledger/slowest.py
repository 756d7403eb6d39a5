"""Where the slowest answer to each command stands: who is called slow is shown being it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from sniffer.ground.model import I64

SLOW_NS: Final = 1_000_000
"""Sooner answers make nobody slow. Servos of one kind differ by less: return delays are set in
steps of 2 to 50 us, and firmware answers within some hundred, that of text lines within a
millisecond."""


class SlowAnswer(NamedTuple):
    """How long an answer took at least, and the request that it answers."""

    took_ns: int
    t_ns: int
    at: int
    length: int


class SlowestAnswers:
    """Keeps by servo and command (``pair_key``) the slowest answer; of equal ones the first."""

    def __init__(self) -> None:
        self._slowest: dict[int, SlowAnswer] = {}

    def add(self, key: I64, took_ns: I64, t_ns: I64, at: I64, length: I64) -> None:
        """Take answers in order of the stream: how long each took at least, and its request."""
        rows = np.flatnonzero(took_ns > SLOW_NS)
        if not len(rows):
            return
        order = np.lexsort((rows, -took_ns[rows], key[rows]))
        first = np.flatnonzero(np.diff(key[rows][order], prepend=-1))
        for row in rows[order[first]].tolist():
            who = int(key[row])
            known = self._slowest.get(who)
            if known is None or int(took_ns[row]) > known.took_ns:
                self._slowest[who] = SlowAnswer(
                    int(took_ns[row]), int(t_ns[row]), int(at[row]), int(length[row])
                )

    def of(self, key: int) -> SlowAnswer | None:
        """Return the slowest answer of a servo to a command; None: none was slow."""
        return self._slowest.get(key)
