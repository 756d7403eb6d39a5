"""A test of texts, asked once a name: of tables of names, and of what commands are called."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sniffer.ground.distinct import FEW, distinct

if TYPE_CHECKING:
    from collections.abc import Callable

    from sniffer.ground.model import I64, Mask
    from sniffer.protocols.base import BusProtocol


class TextTest:
    """A test of texts, ``holds``, whose outcome is kept by name."""

    __slots__ = ("_known", "_ops", "_tables", "holds")

    def __init__(self, holds: Callable[[str], bool]) -> None:
        self.holds = holds
        self._known: dict[str, bool] = {}
        self._tables: dict[int, tuple[object, Mask]] = {}
        self._ops: dict[int, tuple[BusProtocol, dict[int, bool]]] = {}

    def of(self, name: str) -> bool:
        """Test a name of which there are few."""
        if name not in self._known:
            self._known[name] = self.holds(name)
        return self._known[name]

    def table(self, names: tuple[Any, ...], called: Callable[[Any], str] | None = None) -> Mask:
        """Test all names of a table; ``called`` says what an entry of it is called."""
        # by the table itself: the names of registers are not to be asked for with each batch
        found = self._tables.get(id(names))
        if found is None or found[0] is not names:
            told = names if called is None else map(called, names)
            found = names, np.array([self.holds(name) for name in told], bool)
            self._tables[id(names)] = found
        return found[1]

    def ops(self, protocol: BusProtocol, ops: I64) -> Mask:
        """Test the names of commands."""
        found = self._ops.get(id(protocol))
        if found is None or found[0] is not protocol:
            found = self._ops[id(protocol)] = protocol, {}
        known = found[1]
        if len(ops) > FEW:
            numbers, which, _ = distinct(ops)
            mask: Mask = self.ops_few(protocol, known, numbers.tolist())[which]
            return mask
        return self.ops_few(protocol, known, ops.tolist())

    def ops_few(self, protocol: BusProtocol, known: dict[int, bool], ops: list[int]) -> Mask:
        """Test the names of some commands, one by one."""
        try:
            return np.array([known[op] for op in ops], bool)
        except KeyError:
            known.update((op, self.holds(protocol.op_name(op))) for op in ops)
            return np.array([known[op] for op in ops], bool)
