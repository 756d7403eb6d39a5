"""From one value to the next: how far, and the greatest steps of what inertia bounds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.model import I64
    from sniffer.protocols.base import BusProtocol

WATCHED: Final = frozenset({"position", "temperature"})
"""Quantities that cannot step as they like."""

KEPT: Final = 24
"""Of each servo and register the greatest so many: a value that jumps and comes back is two."""


class Step(NamedTuple):
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
        self._kept: dict[int, list[Step]] = {}

    def add(self, who: I64, value: I64, t_ns: I64, at: I64) -> I64:
        """Return how far each value is from the one before it of its servo and register.

        ``who`` is the servo times the number of registers, plus the register.
        """
        order = np.argsort(who, kind="stable")
        k, v, t = who[order], value[order], t_ns[order]
        first = np.concatenate([[True], k[1:] != k[:-1]])
        last = np.concatenate([first[1:], [True]])
        before, since = np.concatenate([[0], v[:-1]]), np.concatenate([[0], t[:-1]])
        begins = np.flatnonzero(first)
        for i, key in zip(begins.tolist(), k[begins].tolist(), strict=True):
            before[i], since[i] = self._last.get(key, (int(v[i]), int(t[i])))
        ends = zip(v[last].tolist(), t[last].tolist(), strict=True)
        self._last.update(zip(k[last].tolist(), ends, strict=True))
        step = np.abs(v - before)
        tall = np.flatnonzero((step > 0) & self._watched[k % self._count])
        if len(tall):
            self._keep(k[tall], at[order[tall]], t[tall], since[tall], before[tall], v[tall])
        out = np.empty(len(value), np.int64)
        out[order] = step
        return out

    def _keep(self, key: I64, at: I64, t_ns: I64, since: I64, before: I64, after: I64) -> None:
        """Keep the greatest, of those of one size the first."""
        size = np.abs(after - before)
        of, which = np.unique(key, return_inverse=True)
        full: list[Sequence[Step]] = [self._kept.get(k, ()) for k in of.tolist()]
        floor = np.array([kept[-1].size if len(kept) == KEPT else 0 for kept in full])
        rows = np.flatnonzero(size > floor[which])
        rows = rows[np.lexsort((at[rows], -size[rows], key[rows]))]
        begins = np.searchsorted(key[rows], key[rows])
        rows = rows[np.arange(len(rows)) - begins < KEPT]
        for i in rows.tolist():
            kept = self._kept.setdefault(int(key[i]), [])
            took = int(t_ns[i] - since[i])
            kept.append(
                Step(int(size[i]), int(at[i]), int(t_ns[i]), took, int(before[i]), int(after[i]))
            )
        for k in np.unique(key[rows]).tolist():
            self._kept[k].sort(key=lambda s: (-s.size, s.at))
            del self._kept[k][KEPT:]

    def of(self, servo_id: int, register: int) -> Sequence[Step]:
        """Return the greatest steps of a servo's register, in order of time."""
        kept = self._kept.get((servo_id + 1) * self._count + register, ())
        return sorted(kept, key=lambda s: s.at)
