"""Limits that are set in a servo: what they are, and since when they hold."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from sniffer.diagnosis.case import Case


class Limit(NamedTuple):
    """A limit as it was last; what was written holds since then, what was read did so before."""

    value: float
    since_ns: int
    """0: it was read, and nobody wrote it."""

    def told(self, case: Case) -> str:
        """Return what is said of when it was written, behind what it is."""
        return f", written at {case.since(self.since_ns)}" if self.since_ns else ""


def limit_told(case: Case, servo: int, register: int) -> Limit | None:
    """Return the limit that a register of a servo is; None: it was neither read nor written."""
    told = case.settings(case.protocol.registers[register].name, servo_id=servo)
    mine = told.take(told.what == register)
    if not len(mine):
        return None
    # a value that is read once it was written is the same setting, and no change
    since_ns = int(mine.t_ns[-1]) if mine.written[-1] else 0
    return Limit(float(mine.after[-1]) * case.protocol.registers[register].scale, since_ns)
