"""Values that are far away once and back with the next: positions that no joint reaches, and goals.

Who is there and back within a moment was not there: something else said so. Only bare answers are
followed: what spoils one that has a checksum does not pass for a value. A goal that is back where
the one before it was, sooner than a joint could go there, was stated by somebody else::

    one program    2047        2047        2047
    another one          1630        1655        1681
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.diagnosis.ledger.buckets import in_groups
from sniffer.diagnosis.ledger.steps import SPEED
from sniffer.ground.milli import MILLI
from sniffer.ground.model import NS
from sniffer.ground.register import unseen_scale

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sniffer.ground.model import F64, I64, Mask
    from sniffer.protocols.base import BusProtocol

LATE_NS: Final = 20_000_000
"""By how much one value may be stamped later than the next: an adapter's timer, and the host."""

TURN: Final = 0.8
"""A step of more than this part of the register's range is a turn that begins anew."""

FAR: Final = 0.01
"""Part of its range by which a goal is far from another, or of the way of the fastest servo in a
second, where that is less or no range is known: less is noise of what a program reckons with, or a
tremor that is meant to overcome friction."""

BACK: Final = 0.125
"""Part of the way there by which a program may have gone on when it states its next goal."""

SOON_NS: Final = 120_000_000
"""Time in which a joint is nowhere near such a goal and back."""

KEPT: Final = 48
"""Of each servo and register the first so many are kept, with their frames; ``Steps`` keeps the
greatest steps, which are few, and of no frame."""


class Return(NamedTuple):
    """A value far from the one before it and from the one behind it, with the frames of all.

    ``was`` and ``value`` are the one before and the far one, in thousandths of the unit.
    """

    at: int
    t_ns: int
    was: int
    value: int
    before: bytes
    there: bytes
    behind: bytes


@dataclass(slots=True)
class Returned:
    """How often one register's value was far away and back.

    ``of`` counts its values from the first of these to the last one; ``kept`` are the first ones.
    """

    n: int = 0
    of: int = 0
    first_ns: int = 0
    last_ns: int = 0
    kept: list[Return] = field(default_factory=list)


class _Met(NamedTuple):
    """A value that was stated: what, when, where, and the frame that did."""

    value: int
    t_ns: int
    at: int
    frame: bytes


class Returns:
    """Follows the positions of all servos, register by register."""

    def __init__(self, protocol: BusProtocol, quantity: str = "position") -> None:
        registers = protocol.registers
        self._count = len(registers)
        speeds = [SPEED.get(r.unit, 0.0) if r.quantity == quantity else 0.0 for r in registers]
        spans = [np.ptp(r.range) * abs(unseen_scale(r)) if r.range else np.inf for r in registers]
        self._speed: F64 = MILLI * np.array(speeds)
        self._span: F64 = MILLI * np.array(spans, np.float64)
        self._last: dict[int, tuple[_Met, ...]] = {}
        self._of: dict[int, Returned] = {}
        self._seen: dict[int, int] = {}
        """How many values there were, by key."""
        self._since: dict[int, int] = {}
        """Which of them was the first that was far away."""

    def add(self, who: I64, value: I64, t_ns: I64, at: I64, frame: Callable[[int], bytes]) -> None:
        """Take values: ``who`` is the servo times the number of registers, plus the register.

        ``frame`` returns the bytes of the frame that stated the value of a row.
        """
        mine = np.flatnonzero(self._speed[who % self._count])
        if not len(mine):
            return
        order, begins = in_groups(who[mine])
        order = mine[order]
        for rows in np.split(order, begins[1:]):
            self._follow(int(who[rows[0]]), rows, value, t_ns, at, frame)

    def _follow(
        self,
        key: int,
        rows: I64,
        value: I64,
        t_ns: I64,
        at: I64,
        frame: Callable[[int], bytes],
    ) -> None:
        """Take the values of one servo's register."""
        before = self._last.get(key, ())
        v = np.concatenate([np.array([m.value for m in before], np.int64), value[rows]])
        t = np.concatenate([np.array([m.t_ns for m in before], np.int64), t_ns[rows]])

        def met(k: int) -> _Met:
            if k < len(before):
                return before[k]
            row = int(rows[k - len(before)])
            return _Met(int(value[row]), int(t_ns[row]), int(at[row]), frame(row))

        step, took = np.diff(v), np.maximum(np.diff(t), 0)
        far = self._is_far(key % self._count, step, took)
        there = np.flatnonzero(far & ((step[:-1] > 0) != (step[1:] > 0))) + 1
        if len(there):
            begun = self._seen.get(key, 0) - len(before)
            self._count_in(key, there.tolist(), begun, met)
        self._seen[key] = self._seen.get(key, 0) + len(rows)
        self._last[key] = tuple(met(k) for k in range(max(len(v) - 2, 0), len(v)))

    def _is_far(self, register: int, step: I64, took: I64) -> Mask:
        """Tell of each value but the first and the last whether it is far from both beside it."""
        size = np.abs(step)
        far = size > self._speed[register] * (took + LATE_NS) / NS
        far &= size <= TURN * self._span[register]
        both: Mask = far[:-1] & far[1:]
        return both

    def _count_in(
        self, key: int, there: Sequence[int], begun: int, met: Callable[[int], _Met]
    ) -> None:
        """Take what is far away; ``begun`` values were stated before the first one in view."""
        found = self._of.setdefault(key, Returned())
        if not found.n:
            found.first_ns, self._since[key] = met(there[0]).t_ns, begun + there[0]
        found.n += len(there)
        found.last_ns = met(there[-1]).t_ns
        found.of = begun + there[-1] + 1 - self._since[key]
        for k in there[: KEPT - len(found.kept)]:
            was, it, then = met(k - 1), met(k), met(k + 1)
            found.kept.append(
                Return(it.at, it.t_ns, was.value, it.value, was.frame, it.frame, then.frame)
            )

    def of(self, servo_id: int, register: int) -> Returned:
        """Return what is known of a servo's register."""
        return self._of.get((servo_id + 1) * self._count + register, Returned())


class GoalsBack(Returns):
    """Follows the goals of all servos: which are far from two that are alike."""

    def __init__(self, protocol: BusProtocol) -> None:
        super().__init__(protocol, "goal_position")

    def take(self, who: I64, value: I64, t_ns: I64, at: I64) -> None:
        """Take values as ``add`` does, without the frames that stated them."""
        self.add(who, value, t_ns, at, lambda _: b"")

    def _is_far(self, register: int, step: I64, took: I64) -> Mask:
        size = np.abs(step)
        least = FAR * min(self._span[register], self._speed[register])
        back = np.abs(step[:-1] + step[1:])
        is_soon = took[:-1] + took[1:] <= SOON_NS
        far: Mask = is_soon & (size[:-1] >= least) & (back <= BACK * size[:-1])
        return far
