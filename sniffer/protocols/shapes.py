"""Register values in columns: rows of one shape share a plan, one strided read a register."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.ground.clues import Clues
from sniffer.ground.codes import REQUEST, WHOLE
from sniffer.ground.distinct import groups_of, numbers
from sniffer.ground.registers import TYPES, Entry
from sniffer.protocols.base import Sightings, Values

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from sniffer.ground.clues import Check, Clue
    from sniffer.ground.framing import Block
    from sniffer.ground.model import I16, I64, U8, Frames, Mask
    from sniffer.ground.registers import RegisterMap
    from sniffer.protocols.base import Extremes, State


MANY: Final = 1 << 13
"""From so many values on, the extremes of each register are noted while it is a column of its own.
To find what is out of range costs a tenth then of asking every value for its range."""

FEW_SHAPES: Final = 12
"""Shapes looked for one by one before the rest is sorted."""


class Parts(NamedTuple):
    """Spans of registers as frames carry them, one a servo, in order."""

    row: I64
    servo_id: I16
    address: I64
    length: I64
    at: I64
    written: Mask


def by_shape(
    block: Block,
    parts: Parts,
    keys: I64,
    shape: Callable[[int], Sequence[Entry]],
    look: Callable[[int, I64, Mapping[tuple[int, str], I64]], None] | None = None,
) -> Values:
    """Read the values of ``parts``; those of equal ``keys`` carry the same registers alike.

    Entries count from ``at``; ``shape(key)`` is asked once a key and a pass, cache it. ``look`` is
    shown the part numbers of each key and the numbers read, by where they stand and their type.
    """
    # Four writes of a goal and a read of position and speed, as ``_parts`` gave them:
    #
    #     number      0       1       2       3             4
    #     bytes       00 04   10 02   20 03   D0 07 10 00   00 05
    #     keys        35389445 35389445 35389445 (one shape), then 36962312, 35389445
    #     groups      [0 1 2 4] [3]                            parts of equal keys
    #     per_part    1       1       1       2             1  registers in each
    #     first       0       1       2       3             5  place of a part's first value
    #     register    goal    goal    goal    pos., speed   goal
    #     raw         1024    528     800     2000, 16      1280
    #
    # Two shapes, so three reads in all (goal, position, speed), each of one column for all parts
    # that have it. Values are written where they belong in the end: ``first`` is known before any
    # is read, so nothing is sorted. What holds: values stand by part, and parts by row.
    data = block.data
    groups = list(groups_of(keys, FEW_SHAPES))
    plans = [shape(int(keys[g[0]])) for g in groups]
    per_part = np.zeros(len(keys), np.int64)
    for group, plan in zip(groups, plans, strict=True):
        per_part[group] = len(plan)
    first = np.cumsum(per_part) - per_part
    total = int(per_part.sum())
    register, raw = np.empty(total, np.int16), np.empty(total, np.int64)
    part = np.zeros(total, np.uint8)
    loose = np.zeros(total, bool) if any(e.loose for plan in plans for e in plan) else None
    extremes: dict[int, Extremes] | None = {} if total >= MANY else None
    filled = [g for g, plan in zip(groups, plans, strict=True) if plan]
    alone = len(filled) == 1
    for group, plan in zip(groups, plans, strict=True):
        at, out = parts.at[group], first[group]
        read = {}
        for k, entry in enumerate(plan):
            # Where all values are of one shape of n, a register is every n-th of them.
            here = slice(k, None, len(plan)) if alone else out + k
            column = _column(data, entry.type, at + entry.at)
            raw[here] = read[entry.at, entry.type] = column
            if extremes is not None:
                _widen(extremes, entry.register, column)
            register[here] = entry.register
            if entry.part != WHOLE:
                part[here] = entry.part
            if loose is not None and entry.loose:
                loose[here] = True
        if look is not None:
            look(int(keys[group[0]]), group, read)
    servo: I16 = np.repeat(parts.servo_id, per_part)
    row = np.repeat(parts.row, per_part)
    return Values(row, servo, register, raw, part, loose, extremes=extremes)


def _widen(extremes: dict[int, Extremes], register: int, column: I64) -> None:
    low, high = int(column.min()), int(column.max())
    known = extremes.get(register, (low, high))
    extremes[register] = min(low, known[0]), max(high, known[1])


def _column(data: U8, kind: str, at: I64) -> I64:
    dtype = TYPES[kind]
    # The bytes seen as numbers that begin at every byte (stride 1, nothing is copied); taking
    # ``at`` from that view reads them wherever they stand, aligned or not.
    column: I64 = np.ndarray((len(data) - dtype.itemsize + 1,), dtype, data, 0, (1,))[at]
    return column


class Addressed:
    """Shapes of packets that carry registers from an address on, to one servo or to several.

    In a packet to several, each servo's part is its id and its bytes: ``step`` bytes a servo, the
    first at ``first`` bytes from ``data_start``. ``step`` 0: a packet to one.
    """

    def __init__(self, models: Sequence[RegisterMap], first: int) -> None:
        self._models = models
        self._first = first
        self._shapes: dict[int, list[Entry]] = {}
        self._sights = Sights(models) if len(models) > 1 else None

    def values(
        self, block: Block, frames: Frames, rows: I64, address: I64, step: I64, state: State
    ) -> Values:
        """Read the values of ``rows``; a negative address: the row has none."""
        return self.read(block, self._parts(block, frames, rows, address, step), state)

    def read(self, block: Block, parts: Parts, state: State) -> Values:
        """Read the values of ``parts``; a negative address: the part has none."""
        model = state.models_of(parts.row, parts.servo_id)
        # All that a shape depends on, in one number: 35389445 is model 0, address 134 (+ 1, so that
        # "none" is 0), length 2, written. The table is asked once a shape, not once a packet.
        keys = (model << 36) | ((parts.address + 1) << 18) | (parts.length << 1) | parts.written
        if self._sights is None:
            return by_shape(block, parts, keys, self._shape)
        seen = self._sights.of(block, parts)
        values = by_shape(block, parts, keys, self._shape, seen.look)
        return replace(values, sightings=seen.found())

    def _parts(self, block: Block, frames: Frames, rows: I64, address: I64, step: I64) -> Parts:
        """Take packets to several servos apart."""
        servo, at = frames.servo_id[rows], frames.data_start[rows]
        length, written = frames.data_length[rows], frames.kind[rows] == REQUEST
        # A write to one servo, one to two at once (86: address, 2: length, then id and bytes of
        # each), an answer, a write:
        #
        #     row          0    1         3    4
        #     at           7    17        40   52     data_start; in row 1 the size
        #     length       2    7         4    2
        #     step         0    3         0    0      id and two bytes
        #     count        1    2         1    1      (7 - first) // 3, ``first`` being 1 here
        #     of           0    1    1    2    3      which of the rows a part is of
        #     nth          0    0    1    0    0      its number in that row
        #     head         7    18   21   40   52     its id, or in a packet to one its bytes
        #     Parts.at     7    19   22   40   52     its bytes
        #     .servo_id    1    1    2    1    3
        #
        # ``of`` and ``nth`` turn "so many each" into rows without a loop: repeat each row ``count``
        # times; a part's number less that of its row's first part is its place in the row.
        several = (step > 0) & (address >= 0)
        if not several.any():
            return Parts(rows, servo, address, length, at, written)
        count = np.ones(len(rows), np.int64)
        count[several] = (length[several] - self._first) // step[several]
        of = np.repeat(np.arange(len(rows)), count)
        nth = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
        several, step = several[of], step[of]
        head = at[of] + np.where(several, self._first + nth * step, 0)
        return Parts(
            rows[of],
            np.where(several, block.data[head], servo[of]).astype(np.int16),
            address[of],
            np.where(several, step - 1, length[of]),
            head + several,
            written[of],
        )

    def _shape(self, key: int) -> list[Entry]:
        found = self._shapes.get(key)
        if found is None:
            address, length = _span_of(key)
            table = self._models[key >> 36]
            found = table.span(address, length) if address >= 0 else []
            self._shapes[key] = found
        return found


def _span_of(key: int) -> tuple[int, int]:
    """Return address and length of a shape: 17 bits each, and one for an address that is none."""
    return (key >> 18 & 0x3FFFF) - 1, key >> 1 & 0x1FFFF


class Sights:
    """Looks for clues to the models in the parts of packets, shape by shape."""

    def __init__(self, models: Sequence[RegisterMap]) -> None:
        self.rules = Clues(models)
        self.clues: list[Clue] = []
        self._number: dict[Clue, int] = {}
        self.sets: list[tuple[int, ...]] = [()]
        self._told: dict[tuple[int, str, bool], I16] = {}

    def of(self, block: Block, parts: Parts) -> Look:
        """Begin a pass."""
        return Look(self, block, parts)

    def number(self, clue: Clue) -> int:
        """Return a clue's row in ``clues``."""
        n = self._number.setdefault(clue, len(self.clues))
        if n == len(self.clues):
            self.clues.append(clue)
        return n

    def told_by(self, check: Check, raw: I64, *, written: bool) -> I64:
        """Return which of ``sets`` each number tells; every number is worked out but once."""
        key = check.address, check.type, written
        table = self._told.get(key)
        if table is None:
            table = self._told[key] = np.full(1 << 16, -1, np.int16)
        # One table of 65,536 cells a check, from number to set of clues: filled where a number is
        # new, it makes the next million a look-up (16 bits name every number: no clue is wider). It
        # is told in sets, as one number may be two clues.
        place = raw.astype(np.int64) & 0xFFFF
        for new in numbers(raw[table[place] < 0]).tolist():
            found = tuple(self.number(c) for c in self.rules.value(check, new, written=written))
            if found not in self.sets:
                self.sets.append(found)
            table[new & 0xFFFF] = self.sets.index(found)
        told: I64 = table[place].astype(np.int64)
        return told


class Look:
    """The clues of one pass."""

    def __init__(self, sights: Sights, block: Block, parts: Parts) -> None:
        self._sights = sights
        self._data = block.data
        self._parts = parts
        self._found: list[tuple[I64, int, int]] = []

    def look(self, key: int, group: I64, read: Mapping[tuple[int, str], I64]) -> None:
        """Look at the parts ``group``, which are alike."""
        (address, length), written = _span_of(key), bool(key & 1)
        if address < 0:
            return
        rules = self._sights.rules
        span = rules.span(address, length, written=written)
        if span is not None:
            self._found.append((group, self._sights.number(span.clue), span.at))
        for check in rules.checks(address, length, written=written):
            raw = read.get((check.at, check.type))
            if raw is None:
                raw = _column(self._data, check.type, self._parts.at[group] + check.at)
            # Nearly all numbers tell nothing: two or three comparisons of the column leave the few
            # that do.
            odd = raw > check.high
            if check.low > np.iinfo(raw.dtype).min:
                odd |= raw < check.low
            for other in check.others:
                odd |= raw == other
            if not odd.any():
                continue
            some = group[odd]
            told = self._sights.told_by(check, raw[odd], written=written)
            for which in np.flatnonzero(np.bincount(told)).tolist():
                same = some[told == which]
                self._found += [(same, number, check.at) for number in self._sights.sets[which]]

    def found(self) -> Sightings | None:
        """Return what was found, in the order of the rows."""
        if not self._found:
            return None
        part = np.concatenate([group for group, _, _ in self._found])
        times = [len(group) for group, _, _ in self._found]
        clue = np.repeat([number for _, number, _ in self._found], times)
        at = np.repeat([at for _, _, at in self._found], times)
        if len(times) > 1:
            order = np.lexsort((clue, at, part))
            part, clue, at = part[order], clue[order], at[order]
        p = self._parts
        return Sightings(p.row[part], p.servo_id[part], clue, p.at[part] + at, self._sights.clues)


def slow_spans(
    models: Sequence[RegisterMap], state: State, parts: Iterable[tuple[int, int, bytes]]
) -> list[tuple[int, int, int, int]]:
    """Split each servo's bytes by its table, one value after the other, for the reference."""
    out = []
    for servo_id, address, data in parts:
        for e in models[int(state.model[servo_id & 255])].span(address, len(data)):
            size = TYPES[e.type].itemsize
            signed = e.part == WHOLE and e.type.startswith("i")
            said = data[e.at : e.at + size]
            if e.type.endswith("be"):
                said = said[::-1]
            raw = int.from_bytes(said, "little", signed=signed)
            out.append((servo_id, e.register, raw, e.part))
    return out
