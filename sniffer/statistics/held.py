"""What servos' registers held: what was first and last said of each, and how often it changed.

A register is known as far as it was read or written; a write that was refused is none.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sniffer.decoding.narrowing import selected
from sniffer.decoding.sink import bus_of
from sniffer.ground.codes import REQUEST, WHOLE
from sniffer.ground.model import Clock

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.model import F64, I64, Batch, Chunk
    from sniffer.ground.register import Register
    from sniffer.protocols.base import BusProtocol


class StatedValue(NamedTuple):
    """A value as a frame said it: ``value`` in the register's unit, NaN where it has none.

    ``is_written``: a request told the servo so; else the servo answered it.
    """

    raw: int
    value: float
    t_ns: int
    offset: int
    is_written: bool


@dataclass(frozen=True, slots=True)
class HeldRegister:
    """One register of one servo: what was first and last said of it, how often, what changed.

    ``count``: how often it was said in all, ``writes`` of them by a request. ``servo_id`` may be
    one that all servos listen to: what was written to all is theirs, too.
    """

    bus: str
    protocol: BusProtocol
    servo_id: int
    register: Register
    first: StatedValue
    last: StatedValue
    count: int = 0
    writes: int = 0
    changes: int = 0

    @property
    def reads(self) -> int:
        """How often the servo said it."""
        return self.count - self.writes


class RegisterBook:
    """A sink that keeps what was said of each register, in memory that does not grow with time."""

    def __init__(self) -> None:
        self.clocked: set[str] = set()
        """Buses that have a clock."""
        self._held: dict[tuple[str, int, int], HeldRegister] = {}

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing: batches hold every byte."""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Take what a batch says of registers."""
        bus = bus_of(bus, protocol, batch)
        if len(batch.frames) and batch.clock != Clock.NONE:
            self.clocked.add(bus)
        batch = selected(batch)
        v, f = batch.values, batch.frames
        rows = np.flatnonzero(v.accepted & (v.part == WHOLE))
        if not len(rows):
            return
        order = np.lexsort((rows, v.register[rows], v.servo_id[rows]))
        rows = rows[order]
        servo, register = v.servo_id[rows], v.register[rows]
        news = np.flatnonzero((np.diff(servo) != 0) | (np.diff(register) != 0)) + 1
        raw: I64 = v.raw[rows]
        value: F64 = v.value[rows]
        written = f.kind[v.row[rows]] == REQUEST
        at = batch.base + f.start[v.row[rows]]
        t_ns = v.t_ns[rows]

        def said(k: int) -> StatedValue:
            return StatedValue(
                int(raw[k]), float(value[k]), int(t_ns[k]), int(at[k]), bool(written[k])
            )

        edges = [0, *news.tolist(), len(rows)]
        for begin, end in itertools.pairwise(edges):
            key = bus, int(servo[begin]), int(register[begin])
            changes = int((raw[begin + 1 : end] != raw[begin : end - 1]).sum())
            mine = self._held.get(key)
            if mine is None:
                what = protocol.registers[key[2]]
                mine = HeldRegister(bus, protocol, key[1], what, said(begin), said(begin))
            changes += int(raw[begin] != mine.last.raw)
            self._held[key] = replace(
                mine,
                last=said(end - 1),
                count=mine.count + end - begin,
                writes=mine.writes + int(written[begin:end].sum()),
                changes=mine.changes + changes,
            )

    def close(self) -> None:
        """Do nothing."""

    def held(self) -> list[HeldRegister]:
        """Return all registers, bus by bus and servo by servo, in the order of their table."""
        return [self._held[key] for key in sorted(self._held)]
