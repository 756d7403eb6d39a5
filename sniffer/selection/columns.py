"""The columns that an expression may name: those of the tables, taken from a batch when asked for.

Numbers are arrays with a mask of what is missing. Texts are numbers, too, with a name for each: a
text is tested once a name, not once a row. What is missing is NULL, never -1 or NaN.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from sniffer.anomalies.catalogue import CATALOGUE
from sniffer.anomalies.found import CODES, SEVERITY, Anomalies
from sniffer.decoding.called import SERVO_NAME, ServoNames
from sniffer.decoding.fields import tidied
from sniffer.ground.codes import KINDS, OUTCOMES, PARTS, PROVENANCES, ROLES
from sniffer.ground.distinct import FEW
from sniffer.ground.gaps import REASONS, Gaps
from sniffer.ground.limits import IDS
from sniffer.ground.model import Severity
from sniffer.ground.register import MEMORIES

if TYPE_CHECKING:
    from sniffer.ground.model import I64, Batch, Frames, Mask
    from sniffer.protocols.base import BusProtocol
    from sniffer.selection.texts import TextTest


NAMELESS: Final = ServoNames()
"""Where no servo has a name."""


class Numbers(NamedTuple):
    """A column of numbers; ``blank`` stands for what is missing: -1, NaN, or None for nothing."""

    values: Any
    blank: float | None = None


class Names(NamedTuple):
    """A column of texts: ``test`` gives the rows whose text passes, or one answer for all.

    ``present`` tells which rows have one, where not all do: the others pass no test.
    """

    test: Callable[[TextTest], Mask | bool]
    present: Callable[[], Mask] | None = None


def _no_negative(column: Any) -> bool:
    """Tell whether nothing is below 0; of few rows Python knows ten times as fast."""
    if len(column) <= FEW:
        return not len(column) or min(column.tolist()) >= 0
    return bool(column.min() >= 0)


class Rows:
    """The rows of one batch, and what several of their columns need."""

    __slots__ = ("_all_asked", "_asked", "_found", "_gaps", "batch", "bus", "names", "protocol")

    def __init__(
        self, bus: str, protocol: BusProtocol, batch: Batch, names: ServoNames = NAMELESS
    ) -> None:
        self.bus, self.protocol, self.batch, self.names = bus, protocol, batch, names
        self._all_asked: bool | None = None
        self._asked: tuple[Frames, I64] | None = None
        self._found: Anomalies | None = None
        self._gaps: Gaps | None = None

    @property
    def asked(self) -> tuple[Frames, I64]:
        """What transactions are of: frames, and the row of each in them.

        It is that of the request, or of a lone answer.
        """
        if self._asked is None:
            t = self.batch.transactions
            if self.all_asked:
                self._asked = self.batch.frames, t.request
            else:
                asked = np.where(t.request == -1, t.response, t.request)
                self._asked = self.batch.asking(asked)
        return self._asked

    @property
    def all_asked(self) -> bool:
        """Whether all transactions were asked in this batch, as nearly always."""
        if self._all_asked is None:
            self._all_asked = _no_negative(self.batch.transactions.request)
        return self._all_asked

    @property
    def last(self) -> I64:
        """The row of each transaction's last frame in the batch."""
        t = self.batch.transactions
        return np.maximum(self.batch.rows_of(t.request), t.response)

    @property
    def found(self) -> Anomalies:
        """The anomalies."""
        if self._found is None:
            self._found = Anomalies.of(self.batch.anomalies)
        return self._found

    @property
    def gaps(self) -> Gaps:
        """The gaps."""
        if self._gaps is None:
            self._gaps = Gaps.of(self.batch.gaps)
        return self._gaps

    def count(self, table: str) -> int:
        """Return how many rows a table has; samples are counted with those that were refused."""
        return _COUNTS[table](self.batch)


_COUNTS: Final[dict[str, Callable[[Batch], int]]] = {
    "frames": lambda batch: len(batch.frames.start),
    "transactions": lambda batch: len(batch.transactions.request),
    "samples": lambda batch: len(batch.values.row),
    "anomalies": lambda batch: len(batch.anomalies),
    "gaps": lambda batch: len(batch.gaps),
}
"""How many rows a table has, without asking a record which columns it has: batches are small."""

Column = Callable[[Rows], Numbers | Names]


class ColumnKind(NamedTuple):
    """What is known of a column before there are rows."""

    is_text: bool
    take: Column
    names: tuple[str, ...] = ()
    """All texts that it can have, where these are known."""


def _number(take: Callable[[Rows], Any]) -> ColumnKind:
    return ColumnKind(False, lambda rows: Numbers(take(rows)))


def _known(take: Callable[[Rows], Any]) -> ColumnKind:
    """Return a column in which -1 stands for what is missing, and nothing else is negative."""
    return ColumnKind(False, lambda rows: Numbers(take(rows), -1))


def _coded(names: tuple[str, ...], take: Callable[[Rows], Any]) -> ColumnKind:
    return ColumnKind(True, lambda rows: Names(lambda test: test.table(names)[take(rows)]), names)


def _called(who: ColumnKind) -> ColumnKind:
    """Return a column of what servos are called; ``who`` are their ids."""

    def column(rows: Rows) -> Names:
        known, ids = rows.names.on_bus(rows.bus), who.take(rows)
        assert isinstance(ids, Numbers)

        def holding(holds: Callable[[str], bool]) -> Mask:
            passing = np.zeros(IDS + 1, bool)  # -1, nobody's, is the last one
            passing[[servo for servo, name in known.items() if holds(name)]] = True
            mask: Mask = passing[ids.values]
            return mask

        return Names(lambda test: holding(test.of), lambda: holding(bool))

    return ColumnKind(True, column)


def _of_servos(who: ColumnKind) -> Mapping[str, ColumnKind]:
    """Return the columns that say whose rows are; both stand in each table that has one of them."""
    return {"servo_id": who, SERVO_NAME: _called(who)}


def _register(called: Callable[[Any], str]) -> ColumnKind:
    """Return a column of what registers are called in some way: each has a table of its own."""

    def column(rows: Rows) -> Names:
        registers = rows.protocol.registers
        return Names(lambda test: test.table(registers, called)[rows.batch.values.register])

    return ColumnKind(True, column)


def _asked_id(rows: Rows) -> Any:
    frames, at = rows.asked
    who = frames.servo_id[at]
    if _no_negative(who):
        return who
    return np.where(who >= 0, who, rows.batch.frames.servo_id[rows.last])


def _asked_op(rows: Rows) -> Names:
    frames, at = rows.asked
    return Names(lambda test: test.ops(rows.protocol, frames.op[at]))


def _asked_at(rows: Rows) -> Any:
    frames, at = rows.asked
    here = frames.start[at] + rows.batch.base
    if rows.all_asked:
        return here
    return np.where(rows.batch.transactions.request == -1, -1, here)


def _answered_at(rows: Rows) -> Any:
    answer, start = rows.batch.transactions.response, rows.batch.frames.start
    if not len(start) or not len(answer):
        return answer
    here = start[answer] + rows.batch.base
    return here if _no_negative(answer) else np.where(answer < 0, -1, here)


def _spread(rows: Rows) -> Any:
    t = rows.batch.transactions
    return np.where(t.response_time_ns < 0, -1, t.uncertainty_ns)


def _said_op(rows: Rows) -> Names:
    ops = rows.batch.frames.op[rows.batch.values.row]
    return Names(lambda test: test.ops(rows.protocol, ops))


def _details(rows: Rows) -> Names:
    return Names(lambda test: np.array([test.holds(a.detail) for a in rows.batch.anomalies], bool))


_BUS: Final = ColumnKind(True, lambda rows: Names(lambda test: test.of(rows.bus)))
_PROTOCOL: Final = ColumnKind(True, lambda rows: Names(lambda test: test.of(rows.protocol.name)))

SEVERITIES: Final = tuple(level.name.lower() for level in Severity)
_LEVELS: Final = tuple(level.name.lower() for level in SEVERITY)
_GROUPS: Final = tuple(CATALOGUE[code].group for code in CODES)

TABLES: Final[Mapping[str, Mapping[str, ColumnKind]]] = MappingProxyType(
    {
        "frames": {
            "t_ns": _number(lambda r: r.batch.frames.t_end),
            "t_start_ns": _number(lambda r: r.batch.frames.t_start),
            "uncertainty_ns": _known(lambda r: r.batch.frames.uncertainty),
            "bus": _BUS,
            "offset": _number(lambda r: r.batch.frames.start + r.batch.base),
            "length": _number(lambda r: r.batch.frames.length),
            "kind": _coded(KINDS, lambda r: r.batch.frames.kind),
            **_of_servos(_known(lambda r: r.batch.frames.servo_id)),
            "op": ColumnKind(
                True, lambda r: Names(lambda test: test.ops(r.protocol, r.batch.frames.op))
            ),
            "address": _known(lambda r: r.batch.frames.address),
            "data_length": _number(lambda r: r.batch.frames.data_length),
            "status": _known(lambda r: r.batch.frames.status),
            "flags": _number(lambda r: r.batch.frames.flags),
            "protocol": _PROTOCOL,
        },
        "gaps": {
            "t_ns": _number(lambda r: r.gaps.t_ns),
            "bus": _BUS,
            "offset": _number(lambda r: r.gaps.start + r.batch.base),
            "length": _number(lambda r: r.gaps.length),
            "reason": _coded(REASONS, lambda r: r.gaps.kind),
            "protocol": _PROTOCOL,
        },
        "transactions": {
            "t_ns": _number(lambda r: r.batch.frames.t_end[r.last]),
            "bus": _BUS,
            **_of_servos(_known(_asked_id)),
            "op": ColumnKind(True, _asked_op),
            "outcome": _coded(OUTCOMES, lambda r: r.batch.transactions.outcome),
            "response_time_ns": _known(lambda r: r.batch.transactions.response_time_ns),
            "uncertainty_ns": _known(_spread),
            "request_offset": _known(_asked_at),
            "response_offset": _known(_answered_at),
            "protocol": _PROTOCOL,
        },
        "samples": {
            "t_ns": _number(lambda r: r.batch.values.t_ns),
            "bus": _BUS,
            **_of_servos(_known(lambda r: r.batch.values.servo_id)),
            "register": _register(lambda register: str(register.name)),
            "quantity": _register(lambda register: str(register.quantity)),
            "role": _coded(ROLES, lambda r: r.batch.values.role),
            "raw": _number(lambda r: r.batch.values.raw),
            "value": ColumnKind(False, lambda r: Numbers(tidied(r.batch.values.value), math.nan)),
            "unit": _register(lambda register: str(register.unit)),
            "scale": _coded(PROVENANCES, lambda r: r.batch.values.provenance),
            "part": _coded(PARTS, lambda r: r.batch.values.part),
            "offset": _number(lambda r: r.batch.frames.start[r.batch.values.row] + r.batch.base),
            "protocol": _PROTOCOL,
        },
        "anomalies": {
            "t_ns": _number(lambda r: r.found.t_ns),
            "bus": _BUS,
            **_of_servos(_known(lambda r: r.found.servo_id)),
            "severity": _coded(_LEVELS, lambda r: r.found.code)._replace(names=SEVERITIES),
            "group": _coded(_GROUPS, lambda r: r.found.code),
            "code": _coded(CODES, lambda r: r.found.code),
            "detail": ColumnKind(True, _details),
            "offset": _number(lambda r: r.found.at),
            "length": _number(lambda r: r.found.length),
            "protocol": _PROTOCOL,
        },
    }
)
"""The kinds of rows, each with its columns: what Parquet files and the JSON lines call them.

Of a gap's reason, a frame's kind and the like all names are known; a command's or a register's are
those of the protocol. A name means the same in every table that has it.
"""

LENT: Final[Mapping[str, Mapping[str, ColumnKind]]] = MappingProxyType(
    {
        "samples": {
            "kind": _coded(KINDS, lambda r: r.batch.frames.kind[r.batch.values.row]),
            "op": ColumnKind(True, _said_op),
            "address": _known(lambda r: r.batch.frames.address[r.batch.values.row]),
            "status": _known(lambda r: r.batch.frames.status[r.batch.values.row]),
            "memory": _register(lambda register: str(register.memory))._replace(names=MEMORIES),
        },
        "gaps": _of_servos(_known(lambda r: r.gaps.servo_id)),
    }
)
"""Columns that a table has beside its own, for expressions that no table has all columns of.

Samples have those of the frames which state them, and where their registers stand: what was written
to a register is ``register = 'goal_position' AND kind = 'request'``, what wears memory is ``memory
= 'non-volatile' AND kind = 'request'``. Gaps have the servo whose frame they may have been, as far
as the torn bytes tell: they are asked for it by name (``servo_id = 3 AND reason = 'truncated'``),
and are not among what is surely that servo's."""

TAKEN: Final[Mapping[str, Mapping[str, ColumnKind]]] = MappingProxyType(
    {table: {**LENT.get(table, {}), **columns} for table, columns in TABLES.items()}
)
"""The columns that may be asked for, by the rows that are tested."""

IS_TEXT: Final[Mapping[str, bool]] = MappingProxyType(
    {name: kind.is_text for columns in TAKEN.values() for name, kind in columns.items()}
)
"""Whether a column holds texts, by name."""

REALS: Final = frozenset({"value"})
"""Columns of numbers that are not whole."""

VALUES: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        name: tuple(dict.fromkeys(kind.names))
        for columns in TAKEN.values()
        for name, kind in columns.items()
        if kind.names
    }
)
"""All texts that a column can have, where these are known."""
