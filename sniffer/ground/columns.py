"""What the tables say of each register, in columns: one look-up tells it for all values of a pass.

Eight models have some five hundred registers; walking them takes a thousand times as long as
starting to decode. So it is done once for a protocol's registers, not for each bus.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.registers import scale_limit, unseen_scale

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.registers import Register

UNSEEN: Final = 256
"""Column of the scales for a mode nobody has seen yet."""

FAR: Final = 2**62
"""Beyond every number on the wire."""

MOST: Final = 32
"""Tables whose columns are kept: more than there are protocols in one program."""


class RegisterColumns:
    """One row a register, in the order of ``registers``; nothing in here ever changes.

    ``scale`` counts where no mode does; ``by_mode`` has a column for each of its 256 numbers and
    one for ``UNSEEN``, ``limit`` likewise the highest value that fits. ``unseen`` is the scale as
    long as nobody has seen a mode. ``low`` and ``high`` are the range, in raw numbers.
    """

    def __init__(self, registers: Sequence[Register]) -> None:
        n = len(registers)
        self.scale = np.array([r.scale for r in registers], np.float64)
        self.role = np.array([r.role for r in registers], np.uint8)
        self.sign_bit = np.array([r.sign_bit or 0 for r in registers], np.int64)
        self.is_signed = np.array([r.sign_bit is not None for r in registers], bool)
        self.special = {i: list(r.special) for i, r in enumerate(registers) if r.special}
        self.is_special = np.array([bool(r.special) for r in registers], bool)
        modes = [r.scale_by[0] if r.scale_by is not None else "" for r in registers]
        self.mode_of = np.array(modes)
        self.is_moded = np.array([r.scale_by is not None for r in registers], bool)
        self.by_mode = np.full((n, UNSEEN + 1), np.nan)
        self.limit = np.full((n, UNSEEN + 1), np.inf)
        for i, r in enumerate(registers):
            if r.scale_by is not None:
                table = r.scale_by[1]
                self.by_mode[i, list(table)] = list(table.values())
                self.by_mode[i, UNSEEN] = unseen_scale(r)
                self.limit[i, list(table)] = [scale_limit(r, mode) for mode in table]
        self.unseen = np.where(self.is_moded, self.by_mode[:, UNSEEN], self.scale)
        self.selects_mode = np.array([r.name in modes for r in registers], bool)
        self.effect = np.array([r.effect or "" for r in registers])
        self.low = np.array([r.range[0] if r.range else -FAR for r in registers], np.int64)
        self.high = np.array([r.range[1] if r.range else FAR for r in registers], np.int64)
        self.has_range = np.array([r.range is not None for r in registers], bool)
        self.effects = {i: r for i, r in enumerate(registers) if r.effect in ("servo_id", "baud")}
        self.has_effect = np.isin(np.arange(n), list(self.effects))
        self.alarms = {i: r for i, r in enumerate(registers) if r.alarms}


_KNOWN: Final[dict[int, tuple[Sequence[Register], RegisterColumns]]] = {}


def columns_of(registers: Sequence[Register]) -> RegisterColumns:
    """Return the columns of a protocol's registers; the same sequence is walked but once."""
    found = _KNOWN.get(id(registers))
    if found is None or found[0] is not registers:
        if len(_KNOWN) >= MOST:
            _KNOWN.clear()
        found = _KNOWN[id(registers)] = registers, RegisterColumns(registers)
    return found[1]
