"""From one value to the next: how far, and the greatest steps of what inertia bounds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.diagnosis.ledger.buckets import in_groups
from sniffer.ground.distinct import numbers
from sniffer.ground.model import NEVER_NS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.model import I64
    from sniffer.protocols.base import BusProtocol

WATCHED: Final = frozenset({"position", "temperature", "goal_position"})
"""Quantities that cannot step as they like, and goals: a path of them has small steps."""

SPEED: Final = {"deg": 500.0, "mm": 400 / 3}
"""What no servo with positions in such units exceeds in a second, without load: the fastest ones
take 0.11 s for 60 degrees, or go 112 mm/s."""

KEPT: Final = 24
"""Of each servo and register the greatest so many: a value that jumps and comes back is two."""


class Leap(NamedTuple):
    """From one value to the next, in thousandths of the unit; ``took_ns`` lies between the two."""

    size: int
    at: int
    t_ns: int
    took_ns: int
    before: int
    after: int


class Steps:
    """Follows all values, servo by servo and register by register."""

    def __init__(self, protocol: BusProtocol) -> None:
        watched = [r.quantity in WATCHED for r in protocol.registers]
        self._count = len(watched)
        self._watched = np.array(watched, bool)
        self._last: dict[int, tuple[int, int]] = {}
        self._kept: dict[int, list[Leap]] = {}

    def add(self, who: I64, value: I64, t_ns: I64, at: I64) -> I64:
        """Return how far each value is from the one before it of its servo and register.

        ``who`` is the servo times the number of registers, plus the register.
        """
        order, begins = in_groups(who)
        v = value[order]
        sizes = np.diff(np.append(begins, len(order)))
        last = begins + sizes - 1
        of = who[order[begins]].tolist()
        firsts = zip(v[begins].tolist(), t_ns[order[begins]].tolist(), strict=True)
        known = [self._last.get(key, own) for key, own in zip(of, firsts, strict=True)]
        ends = zip(v[last].tolist(), t_ns[order[last]].tolist(), strict=True)
        self._last.update(zip(of, ends, strict=True))
        before = np.concatenate([[0], v[:-1]])
        before[begins] = [value for value, _ in known]
        size = np.abs(v - before)
        tall = np.flatnonzero(size > np.repeat([self._floor(key) for key in of], sizes))
        if len(tall):
            group = np.searchsorted(begins, tall, "right") - 1
            since = np.where(
                tall == begins[group],
                np.array([t for _, t in known])[group],
                t_ns[order[np.maximum(tall - 1, 0)]],
            )
            row = order[tall]
            columns = (size[tall], at[row], t_ns[row], t_ns[row] - since, before[tall], v[tall])
            self._keep(who[row], columns)
        out = np.empty(len(value), np.int64)
        out[order] = size
        return out

    def _floor(self, key: int) -> int:
        """Return the size that a step must exceed to be kept."""
        if not self._watched[key % self._count]:
            return NEVER_NS
        kept = self._kept.get(key, [])
        return kept[-1].size if len(kept) == KEPT else 0

    def _keep(self, key: I64, columns: tuple[I64, ...]) -> None:
        """Keep the greatest, of those of one size the first."""
        size, at = columns[:2]
        rows = np.lexsort((at, -size, key))
        rank = np.arange(len(rows)) - np.searchsorted(key[rows], key[rows])
        rows = rows[rank < KEPT]
        told = zip(*(column[rows].tolist() for column in columns), strict=True)
        for k, step in zip(key[rows].tolist(), told, strict=True):
            self._kept.setdefault(k, []).append(Leap(*step))
        for k in numbers(key[rows]).tolist():
            self._kept[k].sort(key=lambda s: (-s.size, s.at))
            del self._kept[k][KEPT:]

    def of(self, servo_id: int, register: int) -> Sequence[Leap]:
        """Return the greatest steps of a servo's register, in order of time."""
        kept = self._kept.get((servo_id + 1) * self._count + register, ())
        return sorted(kept, key=lambda s: s.at)
