"""A selection: which records are shown, read from an expression or put together from shorthands."""

from __future__ import annotations

import contextlib
import functools
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.decoding.called import SERVO_NAME, ServoNames
from sniffer.ground.limits import IDS
from sniffer.ground.model import InputError
from sniffer.ground.wording import Sentence, and_, spelled
from sniffer.selection.columns import LENT, NAMELESS, TABLES, TAKEN, VALUES, Rows
from sniffer.selection.expression import Expression, near, read

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from sniffer.ground.model import Batch, Mask
    from sniffer.protocols.base import BusProtocol
    from sniffer.selection.columns import Names, Numbers

SHORTHANDS: Final = {
    "servos": "servo_id",
    "ops": "op",
    "kinds": "kind",
    "codes": "code",
    "buses": "bus",
}
"""The column that each shorthand is about; several of them are joined with AND."""


_SOMEBODY: Final = "servo_id IS NOT NULL AND bus IS NOT NULL"
"""Has the columns of a condition on servos, while it is not known yet who is called so."""

WHOSE: Final = frozenset(("bus", "protocol", "servo_id", SERVO_NAME, "t_ns"))
"""Columns that say of whatever rows whose they are, and when."""


class Selection:
    """Which rows are shown: those of the tables that have all columns of an expression.

    Where none has, some tables have a few more (``columns.LENT``).

    ``text`` is the expression, valid SQL; ``tables`` are the tables it speaks of, names of
    ``columns.TABLES``. Rows of other tables are not shown.
    """

    def __init__(self, expression: Expression, names: ServoNames = NAMELESS) -> None:
        self._named: Callable[[ServoNames], Selection] | None = None
        """Makes it of servos that were told by names: who is called so is known later."""
        self._names = names
        named = set(expression.columns)
        self.text = expression.text
        self.tables = tuple(name for name, columns in TABLES.items() if named <= columns.keys())
        if not self.tables:
            self.tables = tuple(name for name in LENT if named <= TAKEN[name].keys())
        self._expression = expression
        if not self.tables:
            raise InputError(Sentence("{where}: {why}", why=_apart(self.columns)))

    def __repr__(self) -> str:
        return f"Selection({self.text!r})"

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns that the expression names."""
        return tuple(self._expression.columns)

    def missing_in(self, table: str) -> tuple[str, ...]:
        """Return the columns of the expression that a table does not have."""
        if table in self.tables:
            return ()
        return tuple(name for name in self.columns if name not in TABLES[table])

    def lacking_in(self, table: str) -> str | None:
        """Return why a table has no rows of it, whatever was said, and what to ask for; or None."""
        lacking = self.missing_in(table)
        if not lacking:
            return None
        told = f"{table} have no {and_(list(lacking))}"
        if LENT.get(table, {}).keys() >= set(lacking):
            return f"{told}; ask for `value IS NOT NULL`, too, to have what these frames state"
        return f'{told}; `sniffer query "SELECT * FROM {self.tables[0]}" FILE` has, as CSV, too'

    def about(self, table: str) -> Selection | None:
        """Return what of it can be asked of a table's rows, None: nothing.

        That is all of it where it is about them, else those of the parts joined with AND that say
        whose rows are meant, or when.
        """
        if table in self.tables:
            return self
        known = WHOSE & TABLES[table].keys()
        parts = [part for part in _parts(self._expression) if set(part.columns) <= known]
        if not parts:
            return None
        return Selection(read(" AND ".join(part.text for part in parts)), self._names)

    @classmethod
    def parse(cls, text: str) -> Selection:
        """Read an expression.

        Raises:
            InputError: it is none, or no table has all its columns; in one line, with the place.
        """
        return cls(read(text))

    @classmethod
    def of(
        cls,
        where: str | None = None,
        *,
        servos: Iterable[int | str] = (),
        ops: Iterable[str] = (),
        kinds: Iterable[str] = (),
        codes: Iterable[str] = (),
        buses: Iterable[str] = (),
        names: ServoNames | None = None,
    ) -> Selection | None:
        """Return what an expression and shorthands say together, None where nothing is said.

        Servos may be told by what they are called; where ``names`` are None, ``named`` has to be
        asked for the selection once they are known.

        Raises:
            InputError: as ``parse`` does; or a shorthand is no servo id, name, kind or code.
        """
        who = list(servos)
        if names is None and any(isinstance(servo, str) for servo in who):
            later: dict[str, Any] = {
                "ops": [*ops],
                "kinds": [*kinds],
                "codes": [*codes],
                "buses": [*buses],
            }
            waiting = cls.of(_SOMEBODY if where is None else f"({where}) AND {_SOMEBODY}", **later)
            assert waiting is not None
            waiting._named = functools.partial(cls._of_named, where, who, later)
            return waiting
        if where is not None:
            cls.parse(where)  # what is wrong with it alone is told with its own places
        asked: dict[str, list[str]] = {
            "ops": [_text(op) for op in ops],
            "kinds": [_text(_known("kinds", kind)) for kind in kinds],
            "codes": [_text(_known("codes", code)) for code in codes],
            "buses": [_text(bus) for bus in buses],
        }
        parts = [_servos(who, names or ServoNames())] if who else []
        parts += [_one_of(SHORTHANDS[name], told) for name, told in asked.items() if told]
        if where is not None:
            parts.append(f"({where.strip()})" if parts else where)
        return cls.parse(" AND ".join(parts)) if parts else None

    @classmethod
    def _of_named(
        cls,
        where: str | None,
        servos: list[int | str],
        asked: dict[str, Any],
        names: ServoNames,
    ) -> Selection:
        out = cls.of(where, servos=servos, names=names, **asked)
        assert out is not None
        return out

    def named(self, names: ServoNames) -> Selection:
        """Return it with what servos are called: the ids of those told by name, ``servo_name``.

        Raises:
            InputError: no servo is called so.
        """
        known = self if self._named is None else self._named(names)
        return Selection(known._expression, names)

    def rows(self, bus: str, protocol: BusProtocol, batch: Batch) -> Callable[[str], Mask]:
        """Return what gives, by the name of a table, which of a batch's rows are shown.

        Samples are the rows of ``batch.values``: those that did not become true are in no table.
        A mask is made when it is first asked for.
        """
        rows = Rows(bus, protocol, batch, self._names)
        known: dict[str, Mask] = {}

        def shown(table: str) -> Mask:
            mask = known.get(table)
            if mask is None:
                mask = known[table] = self.mask(table, rows)
            return mask

        return shown

    def mask(self, table: str, rows: Rows) -> Mask:
        """Return which rows of one table are shown."""
        if self._named is not None:
            raise TypeError("the names of servos are not known yet: ask for `named`")
        n = rows.count(table)
        if not n or table not in self.tables:
            return np.zeros(n, bool)
        taken = TAKEN[table]
        known: dict[str, Numbers | Names] = {}

        def ask(name: str) -> Numbers | Names:
            column = known.get(name)
            if column is None:
                column = known[name] = taken[name].take(rows)
            return column

        found = self._expression.holds(ask)
        mask = np.full(n, found) if isinstance(found, bool) else found
        return mask & rows.batch.values.accepted if table == "samples" else mask


def _parts(expression: Expression) -> list[Expression]:
    """Return what is joined with AND, outermost and in parentheses that hold nothing else."""
    if len(expression.ands) > 1:
        return [part for text in expression.ands for part in _parts(read(text))]
    text = expression.text
    if text.startswith("(") and text.endswith(")"):
        with contextlib.suppress(InputError):  # the two are no pair: (a) OR (b)
            inside = _parts(read(text[1:-1]))
            return inside if len(inside) > 1 else [expression]
    return [expression]


def complaint(error: InputError) -> str:
    """Return what is wrong with a selection that was typed alone: no argument has a name there."""
    return spelled(error, lambda names, _: SHORTHANDS.get(names[0], "")).lstrip(",: ")


def _apart(columns: Iterable[str]) -> str:
    """Return why no table has all these columns."""
    where: dict[tuple[str, ...], list[str]] = {}
    for name in columns:
        holders = tuple(table for table, known in TABLES.items() if name in known)
        where.setdefault(holders, []).append(name)
    told = [f"{and_(names)} {'is' if len(names) == 1 else 'are'} of {and_(list(tables))}"
            for tables, names in where.items()]  # fmt: skip
    return f"no table has all of its columns: {'; '.join(told)}"


def _servos(who: Iterable[int | str], names: ServoNames) -> str:
    """Return a condition on ids; what a name means on one bus only is asked of that bus."""
    ids: list[str] = []
    others: list[str] = []
    for servo in who:
        if isinstance(servo, int):
            ids.append(_servo(servo))
            continue
        for called, elsewhere in names.having(servo):
            if isinstance(called, tuple):
                others.append(f"bus = {_text(called[0])} AND servo_id = {called[1]}")
            elif elsewhere:
                told = ", ".join(map(_text, elsewhere))
                others.append(f"servo_id = {called} AND bus NOT IN ({told})")
            else:
                ids.append(str(called))
    every = [_one_of("servo_id", list(dict.fromkeys(ids)))] if ids else []
    every += others
    return every[0] if len(every) == 1 else f"({' OR '.join(f'({part})' for part in every)})"


def _servo(servo: int) -> str:
    if not 0 <= servo < IDS:
        raise InputError(
            Sentence("{servos}: ids are 0..{most}, not {servo}", most=IDS - 1, servo=servo)
        )
    return str(servo)


def _known(shorthand: str, name: str) -> str:
    names = VALUES[SHORTHANDS[shorthand]]
    if name not in names:
        told = f"{{{shorthand}}}: there is no {{name}}: {{near}}"
        raise InputError(Sentence(told, name=repr(name[:40]), near=near(name, names)))
    return name


def _text(text: str) -> str:
    return "'" + text.replace("'", "''") + "'"


def _one_of(column: str, told: list[str]) -> str:
    return f"{column} = {told[0]}" if len(told) == 1 else f"{column} IN ({', '.join(told)})"
