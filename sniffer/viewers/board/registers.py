"""Every register of every servo as it was heard last, and when it changed."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from sniffer.ground.model import F64, I16, I64


class HeardRegister(NamedTuple):
    """A register of one servo: its number in the protocol's table, its last value, and when.

    ``changed_ns`` is when it was heard to have another value than before, 0 for never.
    """

    register: int
    raw: int
    value: float
    seen_ns: int
    changed_ns: int


class RegisterMemory:
    """The registers of one bus, a row a servo, a column a register of the protocol."""

    def __init__(self, registers: int) -> None:
        self._raw = np.zeros((0, registers), np.int64)
        self._value = np.zeros((0, registers))
        self._seen_ns = np.zeros((0, registers), np.int64)
        self.changed_ns = np.zeros((0, registers), np.int64)

    def grow(self, servos: int) -> None:
        """Make room for more servos."""
        for name in ("_raw", "_value", "_seen_ns", "changed_ns"):
            column = getattr(self, name)
            more = np.zeros((servos - len(column), column.shape[1]), column.dtype)
            setattr(self, name, np.concatenate([column, more]))

    def add(self, row: I64, register: I16, raw: I64, value: F64, t_ns: I64) -> None:
        """Take values in the order of the wire; the last one of a register stays."""
        at = row, register
        new = (raw != self._raw[at]) & (self._seen_ns[at] > 0)
        self.changed_ns[row[new], register[new]] = t_ns[new]
        self._raw[at], self._value[at], self._seen_ns[at] = raw, value, t_ns

    def of(self, row: int) -> list[HeardRegister]:
        """Return what was heard of a servo, in the order of the protocol's table."""
        known = np.flatnonzero(self._seen_ns[row])
        columns = (self._raw, self._value, self._seen_ns, self.changed_ns)
        told = [column[row, known].tolist() for column in columns]
        return [HeardRegister(*one) for one in zip(known.tolist(), *told, strict=True)]
