"""Register values in columns: rows of one shape share a plan, one strided read a register."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.model import WHOLE
from sniffer.protocols.base import Values
from sniffer.registers import TYPES, Entry

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from sniffer.framing import Block
    from sniffer.model import I16, I64, Frames
    from sniffer.protocols.base import State
    from sniffer.registers import RegisterMap


FEW_SHAPES: Final = 12
"""Shapes looked for one by one before the rest is sorted."""


def by_shape(
    block: Block,
    frames: Frames,
    rows: I64,
    keys: I64,
    shape: Callable[[int], list[Entry]],
) -> Values:
    """Read the values of ``rows``; rows of equal ``keys`` carry the same registers alike.

    Entries count from ``data_start``; ``shape(key)`` is asked once a key and a pass, cache it.
    """
    data = block.data
    groups = _alike(keys)
    plans = [shape(int(keys[g[0]])) for g in groups]
    per_row = np.zeros(len(rows), np.int64)
    for group, plan in zip(groups, plans, strict=True):
        per_row[group] = len(plan)
    first = np.cumsum(per_row) - per_row
    total = int(per_row.sum())
    register, raw = np.empty(total, np.int16), np.empty(total, np.int64)
    part = np.zeros(total, np.uint8)
    servo: I16 = np.repeat(frames.servo_id[rows], per_row)
    data_start = frames.data_start[rows]
    for group, plan in zip(groups, plans, strict=True):
        at, out = data_start[group], first[group]
        for k, entry in enumerate(plan):
            dtype = TYPES[entry.type]
            strided = np.ndarray((len(data) - dtype.itemsize + 1,), dtype, data, 0, (1,))
            here = out + k
            raw[here] = strided[at + entry.at]
            register[here] = entry.register
            if entry.part != WHOLE:
                part[here] = entry.part
            if entry.servo_at is not None:
                servo[here] = data[at + entry.servo_at]
            elif entry.servo is not None:
                servo[here] = entry.servo
    return Values(np.repeat(rows, per_row), servo, register, raw, part)


def _alike(keys: I64) -> list[I64]:
    """Return the row numbers of each distinct key.

    A bus repeats itself: a few comparisons find all keys sooner than sorting them would.
    """
    out: list[I64] = []
    left = np.arange(len(keys))
    while len(left) and len(out) < FEW_SHAPES:
        same = keys[left] == keys[left[0]]
        out.append(left[same])
        left = left[~same]
    if len(left):
        _, which = np.unique(keys[left], return_inverse=True)
        order = np.argsort(which, kind="stable")
        edges = np.flatnonzero(np.diff(which[order])) + 1
        out += [left[part] for part in np.split(order, edges)]
    return out


class Addressed:
    """Shapes of packets that carry registers from an address on, to one servo or to several.

    In a packet to several, each servo's part is its id and its bytes: ``step`` bytes a servo, the
    first at ``first`` bytes from ``data_start``. ``step`` 0: a packet to one.
    """

    def __init__(self, models: Sequence[RegisterMap], first: int) -> None:
        self._models = models
        self._first = first
        self._shapes: dict[int, list[Entry]] = {}

    def values(
        self, block: Block, frames: Frames, rows: I64, address: I64, step: I64, state: State
    ) -> Values:
        """Read the values of ``rows``; a negative address: the row has none."""
        model = state.model[frames.servo_id[rows] & 255]
        keys = (model << 27) | ((address + 1) << 18) | (frames.data_length[rows] << 9) | step
        return by_shape(block, frames, rows, keys, self._shape)

    def _shape(self, key: int) -> list[Entry]:
        found = self._shapes.get(key)
        if found is None:
            found = self._shapes[key] = self._entries(key)
        return found

    def _entries(self, key: int) -> list[Entry]:
        table = self._models[key >> 27]
        address, length, step = (key >> 18 & 511) - 1, key >> 9 & 511, key & 511
        if address < 0:
            return []
        if not step:
            return table.span(address, length)
        one = table.span(address, step - 1)
        return [
            Entry(e.register, at + 1 + e.at, e.type, e.part, servo_at=at)
            for at in range(self._first, length, step)
            for e in one
        ]


def slow_spans(
    table: RegisterMap, address: int, parts: Iterable[tuple[int, bytes]]
) -> list[tuple[int, int, int, int]]:
    """Split each servo's bytes by the table, one value after the other, for the reference."""
    out = []
    for servo_id, data in parts:
        for e in table.span(address, len(data)):
            size = TYPES[e.type].itemsize
            signed = e.part == WHOLE and e.type.startswith("i")
            raw = int.from_bytes(data[e.at : e.at + size], "little", signed=signed)
            out.append((servo_id, e.register, raw, e.part))
    return out
