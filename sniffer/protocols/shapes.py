"""Register values in columns: rows of one shape share a plan, one strided read a register."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sniffer.model import WHOLE
from sniffer.protocols.base import Values
from sniffer.registers import TYPES

if TYPE_CHECKING:
    from collections.abc import Callable

    from sniffer.framing import Block
    from sniffer.model import I16, I64, Frames
    from sniffer.registers import Entry


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
    shapes, which = np.unique(keys, return_inverse=True)
    entries = [shape(k) for k in shapes.tolist()]
    count = np.array([len(e) for e in entries], np.int64)
    per_row = count[which] if len(shapes) else np.empty(0, np.int64)
    first = np.cumsum(per_row) - per_row
    total = int(per_row.sum())
    register, raw = np.empty(total, np.int16), np.empty(total, np.int64)
    part = np.zeros(total, np.uint8)
    servo: I16 = np.repeat(frames.servo_id[rows], per_row)
    data_start = frames.data_start[rows]
    for j, plan in enumerate(entries):
        mine = np.flatnonzero(which == j)
        at, out = data_start[mine], first[mine]
        for k, entry in enumerate(plan):
            dtype = TYPES[entry.type]
            strided = np.ndarray((len(data) - dtype.itemsize + 1,), dtype, data, 0, (1,))
            raw[out + k] = strided[at + entry.at]
            register[out + k] = entry.register
            if entry.part != WHOLE:
                part[out + k] = entry.part
            if entry.servo_at is not None:
                servo[out + k] = data[at + entry.servo_at]
            elif entry.servo is not None:
                servo[out + k] = entry.servo
    return Values(np.repeat(rows, per_row), servo, register, raw, part)
