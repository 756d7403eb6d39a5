"""Columns of arrow tables; those of names have a number a row, and each name once.

What names there are changes with the protocol, not with the batch: they are laid out once. Rows
that all have one name share their numbers.
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pyarrow as pa

from sniffer.decoding.called import SERVO_NAME
from sniffer.ground.limits import IDS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.decoding.called import ServoNames
    from sniffer.ground.model import I64
    from sniffer.ground.registers import Register

NAME: Final = pa.dictionary(pa.int32(), pa.string())
"""The type of such a column."""

MOST: Final = 32
"""Protocols whose names are kept: more than there are in one program."""

_ZEROS: Final[list[Any]] = []
"""As many as were needed so far."""


def always(name: str, kind: Any, metadata: dict[str, str] | None = None) -> Any:
    """Return a column that has a value in every row: nobody need write down where it has one."""
    return pa.field(name, kind, nullable=False, metadata=metadata)


def named(index: Any, names: Sequence[str]) -> Any:
    """Return the names of rows by their numbers; several numbers may have one name."""
    number, texts = _laid_out(tuple(names))
    index = np.ascontiguousarray(index, np.int32) if number is None else number.take(index)
    return pa.DictionaryArray.from_arrays(pa.array(index), texts)


def constant(name: str, n: int) -> Any:
    """Return ``n`` rows of one name."""
    if not _ZEROS or n > len(_ZEROS[0]):
        _ZEROS[:] = [pa.array(np.zeros(max(2 * n, 1 << 12), np.int32))]
    _, texts = _laid_out((name,))
    # nothing but noughts: that each of them has a name need not be looked up
    return pa.DictionaryArray.from_arrays(_ZEROS[0].slice(0, n), texts, safe=False)


CALLED: Final = pa.field(SERVO_NAME, NAME)
"""The column of what servos are called; there only where names are known."""


def with_names(table: Any, names: ServoNames) -> Any:
    """Return a table with what the servos of its rows are called behind its other columns."""
    return table.append_column(CALLED, _called(table, names))


def _called(table: Any, names: ServoNames) -> Any:
    """Return what the servos of a table's rows are called, null where they have no name."""
    if not len(table):
        return pa.array([], NAME)
    bus = table["bus"].unify_dictionaries().combine_chunks()
    servo = table["servo_id"].fill_null(-1).to_numpy().astype(np.int64)
    known = [names.on_bus(name) for name in bus.dictionary.to_pylist()]
    texts = list(dict.fromkeys(name for each in known for name in each.values()))
    of = np.full((len(known), IDS + 1), -1, np.int64)  # the last column is nobody's
    for row, each in enumerate(known):
        for who, name in each.items():
            of[row, who] = texts.index(name)
    which = of[bus.indices.to_numpy(), servo]
    codes = pa.array(which.astype(np.int32), mask=which < 0)
    return pa.DictionaryArray.from_arrays(codes, pa.array(texts, pa.string()))


class RegisterNames:
    """What registers are called; ``of`` keeps it by protocol."""

    _known: Final[dict[int, tuple[Sequence[Register], RegisterNames]]] = {}

    def __init__(self, registers: Sequence[Register]) -> None:
        self._name = _laid_out(tuple(r.name for r in registers))
        self._quantity = _laid_out(tuple(r.quantity for r in registers))
        self._unit = _laid_out(tuple(r.unit for r in registers))

    @classmethod
    def of(cls, registers: Sequence[Register]) -> RegisterNames:
        """Return the names of a protocol's registers; the same sequence is walked but once."""
        found = cls._known.get(id(registers))
        if found is None or found[0] is not registers:
            if len(cls._known) >= MOST:
                cls._known.clear()
            found = cls._known[id(registers)] = registers, cls(registers)
        return found[1]

    def columns(self, register: Any) -> tuple[Any, Any, Any]:
        """Return name, quantity and unit of rows by their registers."""
        wide = register.astype(np.intp)  # as numpy looks up fastest
        name, quantity, unit = (
            pa.DictionaryArray.from_arrays(
                pa.array(register.astype(np.int32) if number is None else number[wide]),
                texts,
            )
            for number, texts in (self._name, self._quantity, self._unit)
        )
        return name, quantity, unit


@functools.lru_cache(maxsize=256)
def _laid_out(names: tuple[str, ...]) -> tuple[I64 | None, Any]:
    """Return the place of each name (None: they stand as they are), and every name once."""
    told = list(dict.fromkeys(names))
    texts = pa.array(told, pa.string())
    if len(told) == len(names):
        return None, texts
    place = {name: i for i, name in enumerate(told)}
    number: Any = np.array([place[name] for name in names], np.int32)
    return number, texts


def absent(column: Any, missing: Any) -> Any:
    """Return a column in which some rows have no value."""
    return pa.array(column, mask=missing) if missing.any() else pa.array(column)
